"""The public solver: shapes of a robot under tensions and dead loads, with a status a case."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import BatchResults, solve_cases, solve_drive_cases
from tdcr_planner.statics.branch import CONVERGED, UNSTABLE
from tdcr_planner.statics.drive_settings import dead_band, drive_arrays
from tdcr_planner.statics.loads import RodLoads, check_loads, writable
from tdcr_planner.statics.rod import rod_arrays


class SolveStatus(StrEnum):
    """How the solution of one case ended.

    CONVERGED: a stable equilibrium.
    UNSTABLE: an equilibrium on the branch that follows from the unloaded shape, but not a stable one: the loads are
        beyond a buckling load and the robot would leave it.
    LIMIT_POINT: the branch that follows from the unloaded shape ends before the full loads are reached (it snaps
        through); no shape is returned.
    NOT_CONVERGED: the iteration gave up; no shape is returned.
    """

    CONVERGED = "converged"
    UNSTABLE = "unstable"
    LIMIT_POINT = "limit_point"
    NOT_CONVERGED = "not_converged"


_STATUS = np.array(list(SolveStatus), dtype=object)


@dataclass(frozen=True)
class SolverSettings:
    """How exactly and with what effort to solve.

    Attributes:
        tolerance: Largest |M(l) - M_tip| relative to the moment that the loads can exert (length times largest cut
            force, plus tip moment).
        steps_per_gap: Integration steps between neighbouring disks; None keeps each at or below 1/20 of the robot.
        first_load_step: Fraction of the loads tried first from the unloaded shape; smaller follows the branch in
            smaller steps from the start.
        threads: Threads among which a batch is divided. The results do not depend on it.
    """

    tolerance: float = 1e-9
    steps_per_gap: int | None = None
    first_load_step: float = 1.0
    threads: int = 1

    def __post_init__(self) -> None:
        if not 1e-13 <= self.tolerance <= 1e-3:
            raise InputError("tolerance", "a number from 1e-13 to 1e-3", self.tolerance)
        if not 1e-3 <= self.first_load_step <= 1.0:
            raise InputError("first_load_step", "a number from 1e-3 to 1", self.first_load_step)
        if self.threads < 1:
            raise InputError("threads", "a whole number of 1 or more", self.threads)


@dataclass(frozen=True)
class RodSolution:
    """The shapes of a batch of n cases.

    Attributes:
        positions: Disk centres, shape (n, d, 3), m, base frame; NaN where no equilibrium was found.
        rotations: base_from_disk, shape (n, d, 3, 3); NaN where no equilibrium was found.
        arc_lengths: Arc length of each disk in the unloaded rod, shape (d,), m.
        converged: Whether an equilibrium was found, shape (n,).
        residual: |M(l) - M_tip|, shape (n,), N m.
        status: SolveStatus of each case, shape (n,), dtype object.
        iterations: Integrations from base to tip that the case took, shape (n,).
        base_moment: Moment across the cut at the base, shape (n, 3), N m, base frame; what a warm start needs.
        stable: Whether the equilibrium is stable, shape (n,); false where none was found.
        load_fraction: Fraction of the loads up to which the branch from the unloaded shape was followed, shape (n,).
        tensions: The tensions solved for, or found from displacements, shape (n, t), N.
        loads: The loads solved for.
        settings: The settings used.
        displacements: The displacements solved for, shape (n, t), m; None where tensions were given.
    """

    positions: FloatArray
    rotations: FloatArray
    arc_lengths: FloatArray
    converged: BoolArray
    residual: FloatArray
    status: NDArray[Any]
    iterations: IntArray
    base_moment: FloatArray
    stable: BoolArray
    load_fraction: FloatArray
    tensions: FloatArray
    loads: RodLoads
    settings: SolverSettings
    displacements: FloatArray | None = None


_DEFAULT_SETTINGS = SolverSettings()


def solve_statics(
    robot: RobotSpec,
    tensions: ArrayLike | None = None,
    *,
    displacements: ArrayLike | None = None,
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
    """Returns the equilibrium shapes of a robot by the Cosserat-rod model with frictionless tendons.

    Every case is solved by itself: its result does not depend on the others in the batch. Loads are dead: fixed in
    direction, in the base frame. Without `initial` the branch that follows from the unloaded shape is returned.

    Args:
        robot: The robot.
        tensions: Shape (n, t), N, one column a tendon in the robot file's order.
        displacements: In place of tensions, what the drive has pulled in of each tendon, shape (n, t), m. The tensions
            are found with the shape; a tendon whose length is not used up is slack and has none.
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
    disks = robot.disk_count
    guesses = _initial_moments(initial, count)
    results = BatchResults(
        positions=np.empty((count, disks, 3)),
        rotations=np.empty((count, disks, 3, 3)),
        base_moments=np.empty((count, 3)),
        residuals=np.empty(count),
        codes=np.empty(count, dtype=np.int64),
        iterations=np.empty(count, dtype=np.int64),
        fractions=np.empty(count),
    )
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
    return RodSolution(
        positions=results.positions,
        rotations=results.rotations,
        arc_lengths=robot.arc_lengths,
        converged=results.codes <= UNSTABLE,
        residual=results.residuals,
        status=_STATUS[results.codes],
        iterations=results.iterations,
        base_moment=results.base_moments,
        stable=results.codes == CONVERGED,
        load_fraction=results.fractions,
        tensions=tension,
        loads=loads,
        settings=settings,
        displacements=None if displacements is None else robot.check_displacements(displacements),
    )


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
