"""Dead loads as the cut form sees them: the force across the cut, and the moment that loads add along a step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.options import INLINED, OPTIONS
from tdcr_planner.statics.rod import RodArrays


class LoadBatch(NamedTuple):
    """Dead loads of n cases in the base frame; `disk_forces` and `disk_moments` may have one row for all cases.

    Attributes:
        gravity: Shape (n, 3), m/s^2.
        tip_force: Shape (n, 3), N.
        tip_moment: Shape (n, 3), N m.
        distributed_force: Shape (n, 3), N/m.
        distributed_moment: Shape (n, 3), N m/m.
        disk_forces: Shape (n or 1, d, 3), N.
        disk_moments: Shape (n or 1, d, 3), N m.
    """

    gravity: FloatArray
    tip_force: FloatArray
    tip_moment: FloatArray
    distributed_force: FloatArray
    distributed_moment: FloatArray
    disk_forces: FloatArray
    disk_moments: FloatArray


class CutLoads(NamedTuple):
    """Dead loads of one case, laid out by step, base frame.

    Attributes:
        forces: Force across the cut just behind the start of each step, shape (c, 3), N.
        line_loads: Load from the step's start to its middle and to its end, shape (c, 2, 3), N.
        line_moment: Moment per length, shape (3,), N m/m.
        disk_moments: Moment at each disk, shape (d, 3), N m.
        tip_moment: Shape (3,), N m.
        payload: Weight of the payload, which acts at its own place, shape (3,), N.
    """

    forces: FloatArray
    line_loads: FloatArray
    line_moment: FloatArray
    disk_moments: FloatArray
    tip_moment: FloatArray
    payload: FloatArray


@njit(**OPTIONS)
def empty_loads(rod: RodArrays) -> CutLoads:
    """Returns room for the loads of one case."""
    steps, disks = rod.step_lengths.shape[0], rod.disk_masses.shape[0]
    return CutLoads(
        np.empty((steps, 3)), np.empty((steps, 2, 3)), np.empty(3), np.empty((disks, 3)), np.empty(3), np.empty(3)
    )


@njit(**OPTIONS)
def fill_loads(rod: RodArrays, batch: LoadBatch, case: int, loads: CutLoads) -> float:
    """Writes the loads of one case.

    Returns:
        The scale of the moment that the loads can exert, N m: length times the largest cut force, plus the moments.
    """
    many_forces, many_moments = batch.disk_forces.shape[0] > 1, batch.disk_moments.shape[0] > 1
    disk_forces = batch.disk_forces[case if many_forces else 0]
    disk_moments = batch.disk_moments[case if many_moments else 0]
    total = np.zeros(3)
    moment = 0.0
    for j in range(3):
        total[j] = batch.tip_force[case, j]
        loads.tip_moment[j] = batch.tip_moment[case, j]
        loads.line_moment[j] = batch.distributed_moment[case, j]
        loads.payload[j] = rod.payload[0] * batch.gravity[case, j]
        moment += loads.tip_moment[j] ** 2
    moment = np.sqrt(moment)
    line = np.sqrt(loads.line_moment[0] ** 2 + loads.line_moment[1] ** 2 + loads.line_moment[2] ** 2)
    moment += line * rod.length[0]
    for disk in range(disk_moments.shape[0]):
        size = 0.0
        for j in range(3):
            loads.disk_moments[disk, j] = disk_moments[disk, j] if disk > 0 else 0.0
            size += loads.disk_moments[disk, j] ** 2
        moment += np.sqrt(size)
    largest = 0.0
    for c in range(loads.forces.shape[0] - 1, -1, -1):
        disk, h = rod.step_disks[c], rod.step_lengths[c]
        size = 0.0
        for j in range(3):
            if disk >= 0:
                total[j] += rod.disk_masses[disk] * batch.gravity[case, j] + disk_forces[disk, j]
            spread = batch.distributed_force[case, j]
            loads.line_loads[c, 0, j] = rod.step_masses[c, 0] * batch.gravity[case, j] + 0.5 * h * spread
            loads.line_loads[c, 1, j] = rod.step_masses[c, 1] * batch.gravity[case, j] + h * spread
            total[j] += loads.line_loads[c, 1, j]
            loads.forces[c, j] = total[j]
            size += total[j] ** 2
        largest = max(largest, size)
    return np.sqrt(largest) * rod.length[0] + moment


@njit(**OPTIONS)
def scale_loads(loads: CutLoads, fraction: float, scaled: CutLoads) -> None:
    """Writes a fraction of the loads."""
    for j in range(3):
        for c in range(loads.forces.shape[0]):
            scaled.forces[c, j] = fraction * loads.forces[c, j]
            scaled.line_loads[c, 0, j] = fraction * loads.line_loads[c, 0, j]
            scaled.line_loads[c, 1, j] = fraction * loads.line_loads[c, 1, j]
        for disk in range(loads.disk_moments.shape[0]):
            scaled.disk_moments[disk, j] = fraction * loads.disk_moments[disk, j]
        scaled.line_moment[j] = fraction * loads.line_moment[j]
        scaled.tip_moment[j] = fraction * loads.tip_moment[j]
        scaled.payload[j] = fraction * loads.payload[j]


@njit(**OPTIONS)
def mix_loads(first: CutLoads, second: CutLoads, fraction: float, mixed: CutLoads) -> None:
    """Writes the loads at a fraction of the way from the first to the second."""
    scale_loads(first, 1.0 - fraction, mixed)
    for j in range(3):
        for c in range(mixed.forces.shape[0]):
            mixed.forces[c, j] += fraction * second.forces[c, j]
            mixed.line_loads[c, 0, j] += fraction * second.line_loads[c, 0, j]
            mixed.line_loads[c, 1, j] += fraction * second.line_loads[c, 1, j]
        for disk in range(mixed.disk_moments.shape[0]):
            mixed.disk_moments[disk, j] += fraction * second.disk_moments[disk, j]
        mixed.line_moment[j] += fraction * second.line_moment[j]
        mixed.tip_moment[j] += fraction * second.tip_moment[j]
        mixed.payload[j] += fraction * second.payload[j]


@njit(**INLINED)
def load_at(
    rotation: FloatArray,
    position: FloatArray,
    added: FloatArray,
    line_load: FloatArray,
    force: FloatArray,
    moment: FloatArray,
    load: FloatArray,
) -> None:
    """Writes the body-frame load at a point of a step from the load at its start, all in the start's frame.

    n = Q^T (n0 - W), m = Q^T (m0 - d x n0 + the integral of p' x W - l over the step so far), W the load that the
    step so far carries, l the moment per length.
    """
    dx, dy, dz = position[0], position[1], position[2]
    nx, ny, nz = force[0] - line_load[0], force[1] - line_load[1], force[2] - line_load[2]
    mx = moment[0] - dy * force[2] + dz * force[1] + added[0]
    my = moment[1] - dz * force[0] + dx * force[2] + added[1]
    mz = moment[2] - dx * force[1] + dy * force[0] + added[2]
    for j in range(3):
        load[j] = rotation[0, j] * nx + rotation[1, j] * ny + rotation[2, j] * nz
        load[3 + j] = rotation[0, j] * mx + rotation[1, j] * my + rotation[2, j] * mz


@njit(**INLINED)
def added_moment_rate(
    rotation: FloatArray, strain: FloatArray, line_load: FloatArray, line_moment: FloatArray, rate: FloatArray
) -> None:
    """Writes p' x W - l at a point of a step, in the frame of the step's start."""
    x = rotation[0, 0] * strain[0] + rotation[0, 1] * strain[1] + rotation[0, 2] * strain[2]
    y = rotation[1, 0] * strain[0] + rotation[1, 1] * strain[1] + rotation[1, 2] * strain[2]
    z = rotation[2, 0] * strain[0] + rotation[2, 1] * strain[1] + rotation[2, 2] * strain[2]
    rate[0] = y * line_load[2] - z * line_load[1] - line_moment[0]
    rate[1] = z * line_load[0] - x * line_load[2] - line_moment[1]
    rate[2] = x * line_load[1] - y * line_load[0] - line_moment[2]
