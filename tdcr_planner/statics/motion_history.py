"""States with friction in compiled code: each by itself from a given history, or one after the other along a motion."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.batch import BatchResults
from tdcr_planner.statics.branch import CONVERGED, NOT_CONVERGED, UNSTABLE, follow_branch, smallest_level
from tdcr_planner.statics.cut_loads import CutLoads, LoadBatch, empty_loads, fill_loads, mix_loads
from tdcr_planner.statics.drive import GAP_TOLERANCE, DriveState, empty_state, follow_drive
from tdcr_planner.statics.friction import (
    Actuation,
    FrictionState,
    copy_state,
    empty_friction_state,
    friction_newton,
)
from tdcr_planner.statics.options import OPTIONS
from tdcr_planner.statics.rod import RodArrays
from tdcr_planner.statics.tension import fill_tension, frictionless_tension

FINEST_FRICTION = 1.0 / 64.0
MOST_PARTS = 64
PATH_TOLERANCE = 5e-7
"""Largest distance of a disk, m, that cutting a motion into twice as many parts may make.

The front at which a tendon begins to stick is known to a stage point, which moves disks by some 1e-7 m.
"""


@njit(**OPTIONS)
def room_for(rod: RodArrays, actuation: Actuation) -> DriveState:
    """Returns room for `friction_newton`, with columns for the tensions where displacements are given."""
    return empty_state(rod.tendons.shape[1] if actuation.displaced[0] else 0)


@njit(**OPTIONS)
def solve_from_rest(
    rod: RodArrays,
    actuation: Actuation,
    loads: CutLoads,
    driven: FloatArray,
    state: FrictionState,
    room: DriveState,
    tolerances: tuple[float, float],
    first_step: float,
) -> tuple[int, float, int, float]:
    """Solves a state whose history `state.tension.earlier` holds, without a neighbouring state to start from.

    The frictionless branch is followed to the full loads; from there friction grows to its full coefficient.

    Returns:
        Status code, residual in N m, integrations made, fraction of the loads reached.
    """
    plain = frictionless_tension(rod)
    if actuation.displaced[0]:
        code, residual, made, fraction = follow_drive(
            rod, actuation.drive, loads, driven, plain, state.base_moment, state.tensions, tolerances, first_step,
            room, state.positions, state.rotations,
        )  # fmt: skip
    else:
        state.tensions[:] = driven
        fill_tension(rod, driven, plain)
        code, residual, made, fraction = follow_branch(
            rod, loads, plain, state.base_moment, tolerances[0], first_step, state.positions, state.rotations
        )
    if code > UNSTABLE:
        return code, residual, made, fraction
    friction = actuation.friction.copy()
    trial = empty_friction_state(rod, actuation)
    copy_state(state, trial)
    reached, step = 0.0, 1.0
    while reached < 1.0:
        target = min(1.0, reached + step)
        trial.tension.friction[:] = target * friction
        ok, residual, tries, stable = friction_newton(rod, actuation, loads, driven, trial, room, tolerances)
        made += tries
        if ok:
            reached = target
            code = CONVERGED if stable else UNSTABLE
            copy_state(trial, state)
        else:
            copy_state(state, trial)
            step *= 0.5
            if step < FINEST_FRICTION:
                return NOT_CONVERGED, residual, made, fraction
    return code, residual, made, 1.0


@njit(**OPTIONS)
def walk(
    rod: RodArrays,
    actuation: Actuation,
    loads: tuple[CutLoads, CutLoads, CutLoads],
    driven: tuple[FloatArray, FloatArray, FloatArray],
    parts: int,
    start: FrictionState,
    end: FrictionState,
    known: bool,
    room: DriveState,
    tolerances: tuple[float, float],
) -> tuple[int, float, int]:
    """Goes from one state to the next in equal parts.

    Args:
        rod: RodArrays.
        actuation: Drive and friction.
        loads: At the start, at the end, and room for those between.
        driven: Tensions or displacements, alike.
        parts: Number of parts.
        start: The state at the start.
        end: Written. Where `known` it holds a state near the end, to start from.
        known: Whether it does.
        room: Room.
        tolerances: As for `friction_newton`.

    Returns:
        Status code, residual in N m, integrations made.
    """
    near = empty_friction_state(rod, actuation)
    copy_state(end if known else start, near)
    copy_state(start, end)
    made, residual, code = 0, np.inf, CONVERGED
    for part in range(1, parts + 1):
        fraction = part / parts
        mix_loads(loads[0], loads[1], fraction, loads[2])
        for i in range(driven[2].shape[0]):
            driven[2][i] = (1.0 - fraction) * driven[0][i] + fraction * driven[1][i]
        end.tension.earlier[:] = end.tension.pulls
        for j in range(3):
            end.base_moment[j] = (1.0 - fraction) * start.base_moment[j] + fraction * near.base_moment[j]
        if known:
            end.tension.angles[:] = (1.0 - fraction) * start.tension.angles + fraction * near.tension.angles
        for i in range(driven[2].shape[0]):
            if actuation.displaced[0]:
                end.tensions[i] = (1.0 - fraction) * start.tensions[i] + fraction * near.tensions[i]
            else:
                end.tensions[i] = driven[2][i]
        ok, residual, tries, stable = friction_newton(rod, actuation, loads[2], driven[2], end, room, tolerances)
        made += tries
        if not ok:
            return NOT_CONVERGED, residual, made
        code = CONVERGED if stable else UNSTABLE
    return code, residual, made


@njit(**OPTIONS)
def step_of_motion(
    rod: RodArrays,
    actuation: Actuation,
    loads: tuple[CutLoads, CutLoads, CutLoads],
    driven: tuple[FloatArray, FloatArray, FloatArray],
    start: FrictionState,
    end: FrictionState,
    room: DriveState,
    tolerances: tuple[float, float],
) -> tuple[int, float, int]:
    """Goes from one state to the next, in as many parts as leave the end where it is; see `walk`."""
    other = empty_friction_state(rod, actuation)
    known, made = False, 0
    parts, code, residual = 1, NOT_CONVERGED, np.inf
    rubs = actuation.friction.max() > 0.0
    while parts <= MOST_PARTS:
        if known:
            copy_state(end, other)
        code, residual, tries = walk(rod, actuation, loads, driven, parts, start, other, known, room, tolerances)
        made += tries
        parts *= 2
        if code == NOT_CONVERGED:
            continue
        largest = np.inf
        if known:
            largest = 0.0
            for disk in range(end.positions.shape[0]):
                distance = 0.0
                for j in range(3):
                    distance += (end.positions[disk, j] - other.positions[disk, j]) ** 2
                largest = max(largest, np.sqrt(distance))
        copy_state(other, end)
        known = True
        if largest <= PATH_TOLERANCE or not rubs:
            return code, residual, made
    return (code if known else NOT_CONVERGED), residual, made


@njit(**OPTIONS)
def store_state(
    case: int, state: FrictionState, code: int, residual: float, made: int, fraction: float, results: BatchResults,
    tensions: FloatArray, pulls: FloatArray,
) -> None:  # fmt: skip
    """Writes a state into its row of the results; NaN where none was found."""
    results.codes[case], results.residuals[case], results.iterations[case] = code, residual, made
    results.fractions[case] = fraction
    if code <= UNSTABLE:
        results.positions[case] = state.positions
        results.rotations[case] = state.rotations
        results.base_moments[case] = state.base_moment
        tensions[case] = state.tensions
        pulls[case] = state.tension.pulls
    else:
        results.positions[case] = np.nan
        results.rotations[case] = np.nan
        results.base_moments[case] = np.nan
        tensions[case] = np.nan
        pulls[case] = np.nan


@njit(**OPTIONS)
def solve_friction_cases(
    rod: RodArrays,
    actuation: Actuation,
    driven: FloatArray,
    batch: LoadBatch,
    histories: FloatArray,
    tolerance: float,
    first_step: float,
    results: BatchResults,
    tensions: FloatArray,
    pulls: FloatArray,
) -> None:
    """Solves cases with friction, each by itself.

    Args:
        rod: RodArrays.
        actuation: Drive and friction.
        driven: Tensions or displacements, shape (n, t).
        batch: Loads.
        histories: What each tendon had all along, shape (t,), N: 0 where it is pulled, huge where it is released.
        tolerance: Relative residual.
        first_step: Load step to try first.
        results: Written.
        tensions: Tensions at the drive, shape (n, t), N; written.
        pulls: Tensions along the tendons, shape (n, c, 3, t), N; written.
    """
    loads, room = empty_loads(rod), room_for(rod, actuation)
    for case in range(driven.shape[0]):
        scale = fill_loads(rod, batch, case, loads)
        tolerances = (smallest_level(rod, tolerance, scale), GAP_TOLERANCE * tolerance * rod.length[0])
        state = empty_friction_state(rod, actuation)
        for c in range(rod.tendons.shape[0]):
            for column in range(rod.tendon_counts[c]):
                for point in range(3):
                    state.tension.earlier[c, point, column] = histories[rod.tendons[c, column]]
        code, residual, made, fraction = solve_from_rest(
            rod, actuation, loads, driven[case], state, room, tolerances, first_step
        )
        store_state(case, state, code, residual, made, fraction, results, tensions, pulls)


@njit(**OPTIONS)
def solve_motion(
    rod: RodArrays,
    actuation: Actuation,
    driven: FloatArray,
    batch: LoadBatch,
    tolerance: float,
    first_step: float,
    results: BatchResults,
    tensions: FloatArray,
    pulls: FloatArray,
) -> None:
    """Solves the states of a motion one after the other; the first one is reached from rest, by pulling.

    A state that is not found is left out: the next one is reached from the last one found. Arguments as for
    `solve_friction_cases`.
    """
    room = room_for(rod, actuation)
    loads = (empty_loads(rod), empty_loads(rod), empty_loads(rod))
    between = np.empty(driven.shape[1])
    state, reached = empty_friction_state(rod, actuation), empty_friction_state(rod, actuation)
    last = -1
    for case in range(driven.shape[0]):
        scale = fill_loads(rod, batch, case, loads[1])
        tolerances = (smallest_level(rod, tolerance, scale), GAP_TOLERANCE * tolerance * rod.length[0])
        if last < 0:
            state = empty_friction_state(rod, actuation)
            code, residual, made, fraction = solve_from_rest(
                rod, actuation, loads[1], driven[case], state, room, tolerances, first_step
            )
        else:
            fill_loads(rod, batch, last, loads[0])
            code, residual, made = step_of_motion(
                rod, actuation, loads, (driven[last], driven[case], between), state, reached, room, tolerances
            )
            fraction = 1.0
            if code <= UNSTABLE:
                copy_state(reached, state)
        store_state(case, state, code, residual, made, fraction, results, tensions, pulls)
        if code <= UNSTABLE:
            last = case
