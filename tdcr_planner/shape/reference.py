"""The Cosserat reference as a shape model: exact within the rod model, slower than the learned one."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray
from tdcr_planner.robot import FEATURES, RobotSpec
from tdcr_planner.shape.base import DiskPoses, ShapeModel
from tdcr_planner.statics.driven import solve_driven
from tdcr_planner.statics.solver import RodSolution, SolverSettings


class ReferenceShape(ShapeModel):
    """Disk poses from `solve_statics`: of tensions, or of displacements where the robot's drive sets them.

    Friction is left out: where it counts, verification asks for it.

    A row counts as solved when an equilibrium was found and it is stable: an unstable one is no shape the robot keeps.
    """

    name = "reference"
    title = "reference"
    colour = "#1F2933"
    marker = "s"
    is_fast = False
    knows = frozenset(FEATURES)

    def __init__(self, robot: RobotSpec, settings: SolverSettings | None = None) -> None:
        """Prepares the reference for a robot with the solver's settings, the default ones if none are given."""
        self.robot = robot
        self.settings = settings or SolverSettings()
        self.error_bound: FloatArray = np.zeros(robot.disk_count)

    @classmethod
    def load(cls, robot: RobotSpec, file: Path | None) -> Self:  # noqa: ARG003
        """Returns the reference for a robot; it has no file."""
        return cls(robot)

    def disk_poses(
        self,
        tensions: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        tip_force: ArrayLike | None = None,
    ) -> DiskPoses:
        """Returns the disk poses of a batch; see `ShapeModel.disk_poses`."""
        solution = self.solve(tensions, gravity=gravity, tip_force=tip_force)
        found = solution.tensions if self.robot.drive.kind == "displacement" else None
        return DiskPoses(solution.positions, solution.rotations, solution.converged & solution.stable, found)

    def solve(
        self,
        tensions: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        tip_force: ArrayLike | None = None,
        initial: RodSolution | None = None,
    ) -> RodSolution:
        """Returns the whole solution, warm-started from `initial` where given; see `solve_driven`."""
        return solve_driven(
            self.robot, tensions, gravity=gravity, tip_force=tip_force, initial=initial, settings=self.settings
        )
