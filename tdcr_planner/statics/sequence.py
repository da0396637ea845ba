"""Motions: states in order in time, each with the history of friction and play that the ones before it leave."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.drive_settings import actuation_of, play
from tdcr_planner.statics.loads import check_loads, writable
from tdcr_planner.statics.motion_history import solve_motion
from tdcr_planner.statics.rod import rod_arrays
from tdcr_planner.statics.solution import RodSolution, SolverSettings, empty_results, rod_solution

_DEFAULT_SETTINGS = SolverSettings()


def solve_sequence(
    robot: RobotSpec,
    actuation: ArrayLike,
    *,
    kind: Literal["tension", "displacement"] | None = None,
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike | None = None,
    tip_moment: ArrayLike | None = None,
    distributed_force: ArrayLike | None = None,
    distributed_moment: ArrayLike | None = None,
    disk_forces: ArrayLike | None = None,
    disk_moments: ArrayLike | None = None,
    settings: SolverSettings = _DEFAULT_SETTINGS,
) -> RodSolution:
    """Returns the equilibrium shapes along a motion, with Coulomb friction between tendons and backbone.

    Actuation and loads change linearly from state to state, slowly. A tendon keeps the tension that it had at a place
    while that stays within what friction holds there, and slides where it does not. The motion is cut into as many
    parts as it takes for more of them not to move a disk by more than half a micrometre. The first state is reached
    from rest: every tendon is pulled there from no tension.

    Args:
        robot: The robot; its tendons say how they rub, its drive how much play it has.
        actuation: Tensions, N, or displacements, m, of k states in order in time, shape (k, t).
        kind: Which of the two; None for what the robot's drive sets.
        gravity: Shape (3,) or (k, 3), m/s^2; this and the other loads as for `solve_statics`.
        tip_force: Shape (3,) or (k, 3), N.
        tip_moment: Shape (3,) or (k, 3), N m.
        distributed_force: Shape (3,) or (k, 3), N/m.
        distributed_moment: Shape (3,) or (k, 3), N m/m.
        disk_forces: Shape (k, d, 3), N.
        disk_moments: Shape (k, d, 3), N m.
        settings: Tolerance and steps.

    Returns:
        The k shapes, each with its status; `tendons.tendon_tensions` gives the tensions along the tendons. A state that
        was not found is NaN, and the next one is reached from the last one that was.

    Raises:
        InputError: Wrong shapes, values that are not finite, negative tensions.
    """
    chosen = robot.drive.kind if kind is None else kind
    if chosen not in ("tension", "displacement"):
        raise InputError("kind", "'tension', 'displacement' or None", repr(kind))
    displaced = chosen == "displacement"
    given = robot.check_displacements(actuation) if displaced else robot.check_tensions(actuation)
    count = len(given)
    loads = check_loads(
        robot, count, gravity=gravity, tip_force=tip_force, tip_moment=tip_moment,
        distributed_force=distributed_force, distributed_moment=distributed_moment, disk_forces=disk_forces,
        disk_moments=disk_moments,
    )  # fmt: skip
    rod = rod_arrays(robot, settings.steps_per_gap)
    results = empty_results(robot, count)
    driven = play(robot, given) if displaced else writable(given)
    tensions, pulls = np.empty((count, robot.tendon_count)), np.empty((count, *rod.offsets.shape[:3]))
    solve_motion(
        rod, actuation_of(robot, rod, displaced), driven, loads.batch, settings.tolerance, settings.first_load_step,
        results, tensions, pulls,
    )  # fmt: skip
    return rod_solution(
        robot, results, tensions, loads, settings, displacements=given if displaced else None, pulls=pulls
    )
