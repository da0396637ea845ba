"""What constant curvature would have said of a verified path: how far off its tip is, and which states it refuses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.query.environment import Environment
from tdcr_planner.query.paths import path_rows
from tdcr_planner.query.result import PlanResult
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

NAME = ConstantCurvatureShape.name


@dataclass(frozen=True)
class ArcsAlongPath:
    """Constant curvature against the reference along a path.

    Attributes:
        tip_error: Largest distance between the tips of both, m.
        refused: States of the path that constant curvature holds for not valid.
        states: States of the path.
    """

    tip_error: float
    refused: int
    states: int

    def __str__(self) -> str:
        """Returns a sentence for people."""
        text = f"constant curvature is up to {1e3 * self.tip_error:.3g} mm off at the tip"
        return text + (f" and calls {self.refused} of {self.states} states not valid" if self.refused else "")


def arcs_along_path(environment: Environment, result: PlanResult) -> ArcsAlongPath | None:
    """Returns what constant curvature says of a result's path; None without a path.

    Args:
        environment: The scene in which the path was planned.
        result: The result of a query in it.
    """
    if result.path is None:
        return None
    query = result.scenario.with_planner(validity=NAME)
    rows = path_rows(environment.space, result.path)
    checker = environment.checker(query)
    positions, _, _ = checker.world_poses(rows)
    error = np.linalg.norm(positions[:, -1] - result.path.tip_positions, axis=1)
    return ArcsAlongPath(float(np.nanmax(error)), int(np.count_nonzero(checker.check(rows))), len(rows))
