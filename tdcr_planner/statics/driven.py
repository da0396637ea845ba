"""Shapes from what a robot's drive sets, tensions or displacements, and the tendon displacements that go with them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.solution import RodSolution
from tdcr_planner.statics.solver import solve_statics
from tdcr_planner.statics.tendons import tendon_displacements


def solve_driven(robot: RobotSpec, driven: ArrayLike, **options: Any) -> RodSolution:
    """Returns the equilibrium shapes of a robot for what its drive sets.

    Args:
        robot: The robot.
        driven: Tensions, N, or displacements, m, as its drive sets, shape (n, t).
        **options: Loads, friction, start and settings as for `solve_statics`.
    """
    if robot.drive.kind == "displacement":
        return solve_statics(robot, displacements=driven, **options)
    return solve_statics(robot, driven, **options)


def driven_displacements(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns how far the drive has pulled each tendon in, shape (n, t), m; where it sets them, what it has set."""
    if solution.displacements is not None:
        return np.where(solution.converged[:, None], solution.displacements, np.nan)
    return tendon_displacements(robot, solution, solution.tensions if solution.pulls is None else None)
