"""Motions with friction: every state from the one before, with what sticks and what slides along each tendon."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.complementarity import negative_pivots, solve_complementary
from tdcr_planner.statics.cut_loads import CutLoads
from tdcr_planner.statics.drive import (
    DriveArrays,
    DriveState,
    eliminate_moment,
    largest_gap,
    measure_gaps,
    set_active,
)
from tdcr_planner.statics.integration import integrate
from tdcr_planner.statics.options import OPTIONS
from tdcr_planner.statics.rod import RodArrays
from tdcr_planner.statics.small_matrices import invert3
from tdcr_planner.statics.tension import TendonTension, rubbing_tension

NEWTON_LIMIT = 40
SLIDE_TOLERANCE = 1e-10
"""Largest relative change of a tension from one iteration to the next in a solved state."""
GIVEN_UP = 1e3
"""Growth of the correction at which the iteration is given up."""


class Actuation(NamedTuple):
    """How the tendons are driven, and how they rub.

    Attributes:
        drive: DriveArrays.
        friction: Friction coefficient of each tendon, shape (t,).
        sheath_angles: Angle of each tendon's way from drive to base, shape (t,), rad.
        displaced: Whether displacements are given, shape (1,).
    """

    drive: DriveArrays
    friction: FloatArray
    sheath_angles: FloatArray
    displaced: BoolArray


class FrictionState(NamedTuple):
    """Room for one state of a motion.

    Attributes:
        tension: Tensions along the tendons.
        base_moment: M(0), shape (3,), N m.
        tensions: At the drive, shape (t,), N.
        positions: Shape (d, 3), m.
        rotations: Shape (d, 3, 3).
    """

    tension: TendonTension
    base_moment: FloatArray
    tensions: FloatArray
    positions: FloatArray
    rotations: FloatArray


@njit(**OPTIONS)
def empty_friction_state(rod: RodArrays, actuation: Actuation) -> FrictionState:
    """Returns room for one state; its tendons have not pulled before."""
    disks, total = rod.disk_masses.shape[0], rod.tendons.shape[1]
    return FrictionState(
        rubbing_tension(rod, actuation.friction, actuation.sheath_angles), np.zeros(3), np.zeros(total),
        np.zeros((disks, 3)), np.zeros((disks, 3, 3)),
    )  # fmt: skip


@njit(**OPTIONS)
def copy_state(source: FrictionState, target: FrictionState) -> None:
    """Copies a state; what its tendons had is what they have now."""
    target.tension.pulls[:] = source.tension.pulls
    target.tension.earlier[:] = source.tension.earlier
    target.tension.angles[:] = source.tension.angles
    target.base_moment[:] = source.base_moment
    target.tensions[:] = source.tensions
    target.positions[:] = source.positions
    target.rotations[:] = source.rotations


@njit(**OPTIONS)
def friction_newton(
    rod: RodArrays,
    actuation: Actuation,
    loads: CutLoads,
    displacements: FloatArray,
    state: FrictionState,
    room: DriveState,
    tolerances: tuple[float, float],
) -> tuple[bool, float, int, bool]:
    """Newton's method on M(0), and on the tensions where displacements are given, with friction.

    The derivative holds the tensions along the tendons where they stick, and their ratio to that at the base where they
    slide. What it leaves out, how the angles follow, is made up by a secant step (Anderson 1965, depth 1).

    Args:
        rod: RodArrays.
        actuation: Drive and friction.
        loads: The loads.
        displacements: Shape (t,), m; not read where tensions are given.
        state: Where to start; `tension.earlier` holds what the tendons had. Written.
        room: Room; written. Its columns are 3 where tensions are given, 3 + t else.
        tolerances: Largest residual, N m, and largest gap, m.

    Returns:
        Whether it converged, residual in N m, integrations made, whether the equilibrium is stable.
    """
    total = state.tensions.shape[0]
    displaced = actuation.displaced[0]
    lengths = room.lengths if displaced else room.lengths[:0]
    rates = room.length_rates if displaced else room.length_rates[:0]
    none = np.empty((0, 4, 21))
    found, change = np.empty(total), np.zeros(total)
    unknowns = 3 + (total if displaced else 0)
    step, last_step, x, last_x = np.empty(unknowns), np.empty(unknowns), np.empty(unknowns), np.empty(unknowns)
    moment_scale = rod.stiffness[rod.step_lengths.shape[0] - 1, 1, 3] / rod.length[0]
    scale = np.full(unknowns, 1.0 / moment_scale)
    scale[3:] = 0.02 * rod.length[0] / moment_scale
    made, smallest = 0, np.inf
    while True:
        state.tension.base[:] = state.tensions
        ok, modes = integrate(
            rod, loads, state.tension, state.base_moment, True, state.positions, state.rotations, room.end, room.angle,
            room.moment, lengths, rates, none,
        )  # fmt: skip
        made += 1
        if not ok:
            return False, np.inf, made, False
        turned = state.tension.running[2].max()
        for j in range(3):
            room.end[j] -= loads.tip_moment[j]
        residual = np.sqrt(room.end[0] ** 2 + room.end[1] ** 2 + room.end[2] ** 2)
        gap = 0.0
        if displaced:
            measure_gaps(actuation.drive, displacements, state.tensions, room)
            if eliminate_moment(actuation.drive, state.tensions, room) == 0.0:
                return False, residual, made, False
            set_active(state.tensions, room)
            gap = largest_gap(state.tensions, room)
        elif invert3(room.moment[:, :3], room.inverse) == 0.0:
            return False, residual, made, False
        if residual <= tolerances[0] and gap <= tolerances[1] and turned <= SLIDE_TOLERANCE:
            break
        if made > NEWTON_LIMIT:
            return False, residual, made, False
        if displaced:
            if not solve_complementary(room.compliance, room.right, room.active, room.work, found):
                return False, residual, made, False
            for i in range(total):
                change[i] = found[i] - state.tensions[i]
                x[3 + i], step[3 + i] = state.tensions[i], change[i]
        for i in range(3):
            x[i], step[i] = state.base_moment[i], 0.0
            for j in range(3):
                rest = room.end[j]
                if displaced:
                    for k in range(total):
                        rest += room.moment[j, 3 + k] * change[k]
                step[i] -= room.inverse[i, j] * rest
        size = 0.0
        for i in range(unknowns):
            size += (step[i] * scale[i]) ** 2
        size = np.sqrt(size)
        smallest = min(smallest, size)
        if not size <= GIVEN_UP * smallest:
            return False, residual, made, False
        mixed = 0.0
        if made > 1:
            top = bottom = 0.0
            for i in range(unknowns):
                difference = (step[i] - last_step[i]) * scale[i]
                top += step[i] * scale[i] * difference
                bottom += difference * difference
            if bottom > 0.0:
                mixed = min(1.0, max(-1.0, top / bottom))
        for i in range(unknowns):
            moved = x[i] + step[i]
            if made > 1:
                moved -= mixed * (x[i] + step[i] - last_x[i] - last_step[i])
            last_x[i], last_step[i] = x[i], step[i]
            if i < 3:
                state.base_moment[i] = moved
            else:
                state.tensions[i - 3] = max(0.0, moved) if found[i - 3] > 0.0 else 0.0
    stable = modes == 0
    if displaced and not stable:
        stable = modes == negative_pivots(room.compliance, room.active, room.work)
    return True, residual, made, stable
