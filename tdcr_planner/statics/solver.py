"""The public solver: shapes of a robot under tensions and dead loads, with a status a case."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import solve_cases, solve_drive_cases
from tdcr_planner.statics.drive_settings import actuation_of, dead_band, drive_arrays, histories_of
from tdcr_planner.statics.loads import check_loads, writable
from tdcr_planner.statics.motion_history import solve_friction_cases
from tdcr_planner.statics.rod import rod_arrays
from tdcr_planner.statics.solution import RodSolution, SolverSettings, SolveStatus, empty_results, rod_solution

__all__ = ["RodSolution", "SolveStatus", "SolverSettings", "solve_statics"]

_DEFAULT_SETTINGS = SolverSettings()


def solve_statics(
    robot: RobotSpec,
    tensions: ArrayLike | None = None,
    *,
    displacements: ArrayLike | None = None,
    friction: str | Sequence[str] | None = None,
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike | None = None,
    tip_moment: ArrayLike | None = None,
    distributed_force: ArrayLike | None = None,
    distributed_moment: ArrayLike | None = None,
    disk_forces: ArrayLike | None = None,
    disk_moments: ArrayLike | None = None,
    initial: RodSolution | None = None,
    settings: SolverSettings = _DEFAULT_SETTINGS,
) -> RodSolution:
    """Returns the equilibrium shapes of a robot by the Cosserat-rod model with tendons.

    Every case is solved by itself: its result does not depend on the others in the batch. Loads are dead: fixed in
    direction, in the base frame. Without `initial` the branch that follows from the unloaded shape is returned.

    Args:
        robot: The robot.
        tensions: Shape (n, t), N, one column a tendon in the robot file's order.
        displacements: In place of tensions, what the drive has pulled in of each tendon, shape (n, t), m. The tensions
            are found with the shape; a tendon whose length is not used up is slack and has none.
        friction: None for tendons without friction; "pull" where every tendon with friction slides towards the drive,
            "release" where it slides away from it; one for all, or one a tendon. `solve_sequence` follows a motion
            instead, and finds what slides and sticks.
        gravity: Acceleration, shape (3,) or (n, 3), m/s^2; acts on backbone, disks and payload.
        tip_force: Shape (3,) or (n, 3), N, at the centre of the last disk.
        tip_moment: Shape (3,) or (n, 3), N m, at the last disk.
        distributed_force: Shape (3,) or (n, 3), N per metre of backbone, on top of its weight.
        distributed_moment: Shape (3,) or (n, 3), N m per metre of backbone.
        disk_forces: Shape (n, d, 3), N, at each disk centre; that on the base is borne by the clamp.
        disk_moments: Shape (n, d, 3), N m, at each disk; that on the base is borne by the clamp.
        initial: A neighbouring solution of as many cases (or of one, used for all) to start from. Where a start
            fails or ends at an unstable shape, the case is solved from the unloaded shape.
        settings: Tolerance, steps, threads.

    Returns:
        The shapes, each with its status; a case that was not solved is NaN and says why.

    Raises:
        InputError: Wrong shapes, values that are not finite, negative tensions.
    """
    pulled, tension = _check_actuation(robot, tensions, displacements, initial)
    count = len(tension)
    loads = check_loads(
        robot, count, gravity=gravity, tip_force=tip_force, tip_moment=tip_moment,
        distributed_force=distributed_force, distributed_moment=distributed_moment, disk_forces=disk_forces,
        disk_moments=disk_moments,
    )  # fmt: skip
    rod = rod_arrays(robot, settings.steps_per_gap)
    guesses = _initial_moments(initial, count)
    results = empty_results(robot, count)
    given = None if displacements is None else robot.check_displacements(displacements)
    if friction is not None:
        if initial is not None:
            raise InputError("initial", "no initial solution where friction is given", "one")
        driven = tension if pulled is None else pulled
        found, pulls = np.empty_like(tension), np.empty((count, *rod.offsets.shape[:3]))
        solve_friction_cases(
            rod, actuation_of(robot, rod, pulled is not None), driven, loads.batch, histories_of(robot, friction),
            settings.tolerance, settings.first_load_step, results, found, pulls,
        )  # fmt: skip
        return rod_solution(robot, results, found, loads, settings, displacements=given, pulls=pulls)
    batch, warm, drive = loads.batch, initial is not None, drive_arrays(robot, rod)

    def solve_rows(start: int, stop: int) -> None:
        options = warm, settings.tolerance, settings.first_load_step, start, stop, results
        if pulled is None:
            solve_cases(rod, tension, batch, guesses, *options)
        else:
            solve_drive_cases(rod, drive, pulled, batch, guesses, tension, *options)

    workers = min(settings.threads, count)
    if workers <= 1:
        solve_rows(0, count)
    else:
        bounds = np.linspace(0, count, workers + 1).astype(int)
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(solve_rows, bounds[:-1].tolist(), bounds[1:].tolist()))
    return rod_solution(robot, results, tension, loads, settings, displacements=given)


def _check_actuation(
    robot: RobotSpec, tensions: ArrayLike | None, displacements: ArrayLike | None, initial: RodSolution | None
) -> tuple[FloatArray | None, FloatArray]:
    """Returns the displacements behind the drive's play, or None, and the tensions, given or to start from."""
    if (tensions is None) == (displacements is None):
        came = "neither" if tensions is None else "both"
        raise InputError("tensions", "either tensions or displacements", came)
    if displacements is None:
        assert tensions is not None
        return None, writable(robot.check_tensions(tensions))
    pulled = dead_band(robot, robot.check_displacements(displacements))
    start = np.zeros((1, robot.tendon_count)) if initial is None else initial.tensions
    if len(start) not in (1, len(pulled)):
        raise InputError("initial", f"a solution of 1 or {len(pulled)} cases", f"one of {len(start)}")
    return pulled, np.array(np.broadcast_to(start, pulled.shape))


def _initial_moments(initial: RodSolution | None, count: int) -> FloatArray:
    if initial is None:
        return np.zeros((count, 3))
    if len(initial.base_moment) not in (1, count):
        raise InputError("initial", f"a solution of 1 or {count} cases", f"one of {len(initial.base_moment)}")
    return np.array(np.broadcast_to(initial.base_moment, (count, 3)))
