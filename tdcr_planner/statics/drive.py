"""Displacement drive: the tensions that give every tendon the length that the drive leaves it, or let it go slack.

The displacement q that the drive pulls in is what the tendon's path is shorter by, and what tendon and transmission
stretch by (theory, displacement drive):

    gap = q + l - l0 - (tau - tau0) / k - (S - tau0 l0) / EA = 0   where tau > 0,   gap <= 0   where tau = 0

with l the path's length, l0 in the rest shape, S the integral of the tension along the path, tau0 the pretension, k the
stiffness of the transmission and EA that of the tendon.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.branch import (
    CAUTIOUS_CONTRACTION,
    CONTRACTION,
    CONVERGED,
    INTEGRATION_LIMIT,
    LARGEST_MOMENT,
    LIMIT_DETERMINANT,
    LIMIT_POINT,
    NOT_CONVERGED,
    SMALLEST_LOAD_STEP,
    UNSTABLE,
    unloaded_strain,
    unloaded_tangent,
)
from tdcr_planner.statics.complementarity import negative_pivots, solve_active, solve_complementary
from tdcr_planner.statics.cut_loads import CutLoads, empty_loads, scale_loads
from tdcr_planner.statics.integration import add_lengths, integrate, pull_directions
from tdcr_planner.statics.options import OPTIONS
from tdcr_planner.statics.rod import RodArrays
from tdcr_planner.statics.small_matrices import invert3
from tdcr_planner.statics.tension import TendonTension, fill_tension

NEWTON_LIMIT = 20
START_LIMIT = 60
GAP_TOLERANCE = 0.5
"""Of the relative tolerance, times the robot's length: the largest gap of a solved case."""


class DriveArrays(NamedTuple):
    """What lies between the drive and the path of each of t tendons.

    Attributes:
        compliance: 1 / stiffness of the transmission, shape (t,), m/N.
        stretch: 1 / axial stiffness of the tendon, shape (t,), 1/N.
        pretension: Shape (t,), N.
        rest_lengths: Path length in the rest shape, shape (t,), m.
    """

    compliance: FloatArray
    stretch: FloatArray
    pretension: FloatArray
    rest_lengths: FloatArray


class DriveState(NamedTuple):
    """Room for what is measured of one case: unbalanced moment, gaps, their derivatives, and work space.

    Attributes:
        end: M(l) less what is asked for, shape (3,), N m.
        gaps: Shape (t,), m.
        angle: d theta(l) by M(0) and tensions, shape (3, 3 + t).
        moment: dM(l) by M(0) and tensions, shape (3, 3 + t).
        lengths: Path lengths and integrals of the tension along them, shape (2, t).
        length_rates: Derivative of the path lengths, shape (t, 3 + t).
        inverse: Of dM(l)/dM(0), shape (3, 3).
        compliance: -d gap / d tension at M(l) = M_tip, shape (t, t), m/N.
        right: Right side of the linear problem, shape (t,).
        active: Taut tendons, shape (t,).
        work: Shape (t, t + 1).
    """

    end: FloatArray
    gaps: FloatArray
    angle: FloatArray
    moment: FloatArray
    lengths: FloatArray
    length_rates: FloatArray
    inverse: FloatArray
    compliance: FloatArray
    right: FloatArray
    active: BoolArray
    work: FloatArray


@njit(**OPTIONS)
def empty_state(tendons: int) -> DriveState:
    """Returns room for one case."""
    return DriveState(
        np.empty(3),
        np.empty(tendons),
        np.empty((3, 3 + tendons)),
        np.empty((3, 3 + tendons)),
        np.empty((2, tendons)),
        np.empty((tendons, 3 + tendons)),
        np.empty((3, 3)),
        np.empty((tendons, tendons)),
        np.empty(tendons),
        np.empty(tendons, dtype=np.bool_),
        np.empty((tendons, tendons + 1)),
    )


@njit(**OPTIONS)
def measure_gaps(drive: DriveArrays, displacements: FloatArray, tensions: FloatArray, state: DriveState) -> None:
    """Writes the gap of each tendon from the lengths in the state."""
    for i in range(tensions.shape[0]):
        rest, before = drive.rest_lengths[i], drive.pretension[i]
        gap = displacements[i] + state.lengths[0, i] - rest - (tensions[i] - before) * drive.compliance[i]
        state.gaps[i] = gap - (state.lengths[1, i] - before * rest) * drive.stretch[i]


@njit(**OPTIONS)
def largest_gap(tensions: FloatArray, state: DriveState) -> float:
    """Returns the largest violation of the gap conditions, m; the slack of slack tendons is none."""
    largest = 0.0
    for i in range(tensions.shape[0]):
        gap = state.gaps[i]
        largest = max(largest, abs(gap) if tensions[i] > 0.0 else gap)
    return largest


@njit(**OPTIONS)
def eliminate_moment(drive: DriveArrays, tensions: FloatArray, state: DriveState) -> float:
    """Writes the compliance of the tendons' ends and the right side of the linearised complementarity problem.

    Returns:
        The determinant of dM(l)/dM(0); at 0 nothing is written.
    """
    determinant = invert3(state.moment[:, :3], state.inverse)
    if determinant == 0.0:
        return 0.0
    total = tensions.shape[0]
    inverse, moment, rates = state.inverse, state.moment, state.length_rates
    for i in range(total):
        factor = 1.0 - tensions[i] * drive.stretch[i]
        # Row of d length / d M(0) times the inverse of dM(l)/dM(0).
        x = rates[i, 0] * inverse[0, 0] + rates[i, 1] * inverse[1, 0] + rates[i, 2] * inverse[2, 0]
        y = rates[i, 0] * inverse[0, 1] + rates[i, 1] * inverse[1, 1] + rates[i, 2] * inverse[2, 1]
        z = rates[i, 0] * inverse[0, 2] + rates[i, 1] * inverse[1, 2] + rates[i, 2] * inverse[2, 2]
        right = state.gaps[i] - factor * (x * state.end[0] + y * state.end[1] + z * state.end[2])
        for j in range(total):
            follows = rates[i, 3 + j] - x * moment[0, 3 + j] - y * moment[1, 3 + j] - z * moment[2, 3 + j]
            value = -factor * follows
            if i == j:
                value += drive.compliance[i] + state.lengths[0, i] * drive.stretch[i]
            state.compliance[i, j] = value
            right += value * tensions[j]
        state.right[i] = right
    return determinant


@njit(**OPTIONS)
def set_active(tensions: FloatArray, state: DriveState) -> None:
    """Marks the tendons that pull, or are too short not to."""
    for i in range(tensions.shape[0]):
        state.active[i] = tensions[i] > 0.0 or state.gaps[i] > 0.0


@njit(**OPTIONS)
def measure_unloaded(rod: RodArrays, tension: TendonTension, state: DriveState) -> bool:
    """Writes the path lengths of the rod without outside loads and their derivatives by the tensions.

    Every cross-section stands by itself then; that of the middle is taken for the step.
    """
    total = rod.tendons.shape[1]
    strain, zero, inverse, effect = np.empty(6), np.zeros(6), np.empty((6, 6)), np.empty(6)
    pulled = np.empty((total, 7))
    part, own = np.zeros((2, total)), np.zeros((total, total))
    for i in range(total):
        state.lengths[0, i] = state.lengths[1, i] = 0.0
        for j in range(3 + total):
            state.length_rates[i, j] = 0.0
    for c in range(rod.step_lengths.shape[0]):
        count, h = rod.tendon_counts[c], rod.step_lengths[c]
        if not rod.repeats[c]:
            if not unloaded_strain(rod, tension, c, zero, strain, inverse):
                return False
            pull_directions(rod, tension, c, strain, pulled)
            for i in range(total):
                part[0, i] = part[1, i] = 0.0
            add_lengths(rod, tension, c, 1, strain, 1.0, part)
            for column in range(count):
                for k in range(6):
                    effect[k] = 0.0
                    for m in range(6):
                        effect[k] += inverse[k, m] * pulled[column, m]
                for row in range(count):
                    value = 0.0
                    for k in range(6):
                        value += pulled[row, k] * effect[k]
                    own[row, column] = value
        for row in range(count):
            i = rod.tendons[c, row]
            state.lengths[0, i] += h * part[0, i]
            state.lengths[1, i] += h * part[1, i]
            for column in range(count):
                state.length_rates[i, 3 + rod.tendons[c, column]] -= h * own[row, column]
    return True


@njit(**OPTIONS)
def unloaded_tensions(
    rod: RodArrays,
    drive: DriveArrays,
    displacements: FloatArray,
    tension: TendonTension,
    tensions: FloatArray,
    state: DriveState,
) -> bool:
    """Finds the tensions of the rod without outside loads: a convex problem with one solution.

    Newton's method on the linearised complementarity problem, shortened until what is left over falls.

    Args:
        rod: RodArrays.
        drive: DriveArrays.
        displacements: Shape (t,), m.
        tension: Room for the tensions along the tendons; written.
        tensions: Where to start, shape (t,), N; written.
        state: Room; holds the unloaded compliance at the end.

    Returns:
        Whether they were found.
    """
    total = tensions.shape[0]
    trial, found = tensions.copy(), np.empty(total)
    best, reach = np.inf, 1.0
    for _ in range(START_LIMIT):
        fill_tension(rod, trial, tension)
        ok = measure_unloaded(rod, tension, state)
        size = np.inf
        if ok:
            measure_gaps(drive, displacements, trial, state)
            for i in range(3):
                state.end[i] = 0.0
                for j in range(3 + total):
                    state.moment[i, j] = 1.0 if i == j else 0.0
            eliminate_moment(drive, trial, state)
            size = 0.0
            for i in range(total):
                gap, pull = state.gaps[i], trial[i] * state.compliance[i, i]
                size += (gap if gap > -pull else -pull) ** 2
            size = np.sqrt(size)
        if size < best:
            best, reach = size, 1.0
            for i in range(total):
                tensions[i] = trial[i]
            if size <= 1e-9 * rod.length[0]:
                set_active(tensions, state)
                return True
            set_active(tensions, state)
            if not solve_complementary(state.compliance, state.right, state.active, state.work, found):
                return False
        else:
            reach *= 0.5
            if reach < 1e-3:
                return False
        for i in range(total):
            trial[i] = tensions[i] + reach * (found[i] - tensions[i])
    return False


@njit(**OPTIONS)
def drive_newton(
    rod: RodArrays,
    drive: DriveArrays,
    loads: CutLoads,
    displacements: FloatArray,
    tension: TendonTension,
    base_moment: FloatArray,
    tensions: FloatArray,
    tolerances: tuple[float, float],
    cautious: bool,
    state: DriveState,
    positions: FloatArray,
    rotations: FloatArray,
) -> tuple[bool, float, int, bool, float]:
    """Newton's method on M(0) and the tensions: each step solves the linearised complementarity problem.

    As `branch.newton` it is given up as soon as it does not contract.

    Args:
        rod: RodArrays.
        drive: DriveArrays.
        loads: The loads.
        displacements: Shape (t,), m.
        tension: Room for the tensions along the tendons; written.
        base_moment: Where to start, shape (3,), N m; written.
        tensions: Where to start, shape (t,), N; written.
        tolerances: Largest residual, N m, and largest gap, m.
        cautious: Whether to ask for more contraction, and to end at a stable shape or not at all.
        state: Room; written.
        positions: Shape (d, 3); written.
        rotations: Shape (d, 3, 3); written.

    Returns:
        Whether it converged, residual in N m, integrations made, whether the equilibrium is stable, determinant of the
        derivative of all conditions by M(0) and the tensions of taut tendons.
    """
    limit = CAUTIOUS_CONTRACTION if cautious else CONTRACTION
    total = tensions.shape[0]
    none = np.empty((0, 4, 21))
    found, change = np.empty(total), np.empty(total)
    moment_scale = rod.stiffness[rod.step_lengths.shape[0] - 1, 1, 3] / rod.length[0]
    tension_scale = moment_scale / (0.02 * rod.length[0])
    before, made = np.inf, 0
    while True:
        fill_tension(rod, tensions, tension)
        ok, modes = integrate(
            rod, loads, tension, base_moment, True, positions, rotations, state.end, state.angle, state.moment,
            state.lengths, state.length_rates, none,
        )  # fmt: skip
        made += 1
        if not ok:
            return False, np.inf, made, False, 0.0
        for j in range(3):
            state.end[j] -= loads.tip_moment[j]
        residual = np.sqrt(state.end[0] ** 2 + state.end[1] ** 2 + state.end[2] ** 2)
        measure_gaps(drive, displacements, tensions, state)
        determinant = eliminate_moment(drive, tensions, state)
        if determinant == 0.0:
            return False, residual, made, False, 0.0
        set_active(tensions, state)
        if residual <= tolerances[0] and largest_gap(tensions, state) <= tolerances[1]:
            break
        if made > NEWTON_LIMIT:
            return False, residual, made, False, 0.0
        if not solve_complementary(state.compliance, state.right, state.active, state.work, found):
            return False, residual, made, False, 0.0
        size = 0.0
        for i in range(total):
            change[i] = found[i] - tensions[i]
            size += (change[i] / tension_scale) ** 2
        for i in range(3):
            step = 0.0
            for j in range(3):
                rest = state.end[j]
                for k in range(total):
                    rest += state.moment[j, 3 + k] * change[k]
                step += state.inverse[i, j] * rest
            base_moment[i] -= step
            size += (step / moment_scale) ** 2
        if not size <= limit**2 * before or not size < LARGEST_MOMENT:
            return False, residual, made, False, 0.0
        before = size
        for i in range(total):
            tensions[i] = found[i]
    for i in range(total):
        state.active[i] = tensions[i] > 0.0
    # Elastic tendons hold modes that constant tensions would let go (Sylvester's law on the bordered second variation).
    stable = modes == 0 or modes == negative_pivots(state.compliance, state.active, state.work)
    determinant *= solve_active(state.compliance, state.right, state.active, state.work, found)
    return stable or not cautious, residual, made, stable, determinant


@njit(**OPTIONS)
def follow_drive(
    rod: RodArrays,
    drive: DriveArrays,
    loads: CutLoads,
    displacements: FloatArray,
    tension: TendonTension,
    base_moment: FloatArray,
    tensions: FloatArray,
    tolerances: tuple[float, float],
    first_step: float,
    state: DriveState,
    positions: FloatArray,
    rotations: FloatArray,
) -> tuple[int, float, int, float]:
    """Follows the equilibrium at given displacements from the shape without loads to the full loads.

    Returns:
        Status code, residual in N m, integrations made, fraction of the loads reached.
    """
    total = tensions.shape[0]
    scaled = empty_loads(rod)
    tangent, last, guess = np.zeros(3), np.zeros(3), np.zeros(3)
    pull_tangent, last_pulls = np.zeros(total), np.empty(total)
    for i in range(total):
        tensions[i] = drive.pretension[i]
    if not unloaded_tensions(rod, drive, displacements, tension, tensions, state):
        return NOT_CONVERGED, np.inf, 0, 0.0
    unloaded = state.compliance.copy()
    for i in range(total):
        last_pulls[i] = tensions[i]
    fill_tension(rod, tensions, tension)
    if not unloaded_tangent(rod, loads, tension, tangent):
        return NOT_CONVERGED, np.inf, 0, 0.0
    made_in_all, fraction, step = 0, 0.0, first_step
    residual, determinant, on_stable = np.inf, 1.0, True
    while True:
        target = min(1.0, fraction + step)
        for j in range(3):
            guess[j] = last[j] + tangent[j] * (target - fraction)
        for i in range(total):
            tensions[i] = max(0.0, last_pulls[i] + pull_tangent[i] * (target - fraction))
        scale_loads(loads, target, scaled)
        cautious = on_stable and step > 2.0 * SMALLEST_LOAD_STEP
        converged, residual, made, stable, found = drive_newton(
            rod, drive, scaled, displacements, tension, guess, tensions, tolerances, cautious, state, positions,
            rotations,
        )  # fmt: skip
        made_in_all += made
        if converged:
            if target == 1.0:
                for j in range(3):
                    base_moment[j] = guess[j]
                return (CONVERGED if stable else UNSTABLE), residual, made_in_all, 1.0
            for j in range(3):
                tangent[j] = (guess[j] - last[j]) / (target - fraction)
                last[j] = guess[j]
            for i in range(total):
                pull_tangent[i] = (tensions[i] - last_pulls[i]) / (target - fraction)
                last_pulls[i] = tensions[i]
            start = solve_active(unloaded, state.right, state.active, state.work, state.gaps)
            fraction, on_stable = target, stable
            determinant = found / start if start != 0.0 else 1.0
            if made <= 4:
                step *= 2.0
        else:
            step = 0.5 * min(step, 1.0 - fraction)
            if step < SMALLEST_LOAD_STEP or made_in_all > INTEGRATION_LIMIT:
                return (
                    (LIMIT_POINT if abs(determinant) < LIMIT_DETERMINANT else NOT_CONVERGED),
                    residual,
                    made_in_all,
                    fraction,
                )
