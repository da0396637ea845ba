"""What the solver returns: shapes with a status a case; and how exactly to solve."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import BatchResults
from tdcr_planner.statics.branch import CONVERGED, UNSTABLE
from tdcr_planner.statics.loads import RodLoads


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
        pulls: With friction the tension at the stage points of each integration step, shape (n, c, 3, t), N, columns as
            in `rod.RodArrays`; `tendons.tendon_tensions` puts them in order. None without friction.
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
    pulls: FloatArray | None = None


def empty_results(robot: RobotSpec, count: int) -> BatchResults:
    """Returns room for the results of a number of cases."""
    disks = robot.disk_count
    return BatchResults(
        positions=np.empty((count, disks, 3)),
        rotations=np.empty((count, disks, 3, 3)),
        base_moments=np.empty((count, 3)),
        residuals=np.empty(count),
        codes=np.empty(count, dtype=np.int64),
        iterations=np.empty(count, dtype=np.int64),
        fractions=np.empty(count),
    )


def rod_solution(
    robot: RobotSpec,
    results: BatchResults,
    tensions: FloatArray,
    loads: RodLoads,
    settings: SolverSettings,
    *,
    displacements: FloatArray | None = None,
    pulls: FloatArray | None = None,
) -> RodSolution:
    """Returns what compiled code found, with its codes read."""
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
        tensions=tensions,
        loads=loads,
        settings=settings,
        displacements=displacements,
        pulls=pulls,
    )
