"""Objectives: what a path costs, as a weighted sum of its length, nearness to surfaces and tendon tensions.

An objective is added here: its weight to `Objective`, and what it costs at a configuration to `STATE_COSTS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.files import FileModel, NotNegative

if TYPE_CHECKING:
    from tdcr_planner.planning.validity import ValidityChecker

NEAR_M = 0.005  # clearance at which nearness has fallen to a half
_REMEMBERED = 100_000


class Objective(FileModel):
    """Weights of what an optimising planner minimises.

    Attributes:
        length: Weight of the path length in the workspace, 1/m.
        clearance: Weight of being near a surface.
        effort: Weight of the tendon tensions, 1/N.
    """

    length: NotNegative = 1.0
    clearance: NotNegative = 0.0
    effort: NotNegative = 0.0


def tension_sum(checker: ValidityChecker, row: FloatArray) -> float:
    """Returns the sum of the tendon tensions at a configuration, N; infinite without a shape that tells them."""
    if checker.robot.drive.kind == "tension":
        return float(checker.actuate(row[None]).tensions.sum())
    tensions = checker.shapes(row[None]).tensions
    return float("inf") if tensions is None or not np.isfinite(tensions).all() else float(tensions.sum())


def nearness(checker: ValidityChecker, row: FloatArray) -> float:
    """Returns 1 at a surface, a half at `NEAR_M` of clearance, towards 0 far away; infinite without a shape."""
    positions, rotations, solved = checker.world_poses(row[None])
    if not solved[0]:
        return float("inf")
    gap = max(float(checker.scene.clearance(positions, rotations)[0]), 0.0)
    return NEAR_M / (NEAR_M + gap)


STATE_COSTS: dict[str, Callable[[ValidityChecker, FloatArray], float]] = {"effort": tension_sum, "clearance": nearness}
"""What a metre of motion costs at a configuration, by the name of its weight."""


class PathCost:
    """The cost of edges: body motion times (length + clearance x nearness + effort x sum of tensions).

    Body motion is the edge's length in metres (`ValidityChecker.motion_scale`), nearness is 1 at a surface and falls
    to a half at `NEAR_M` of clearance, the sum of tensions is in N. Both are taken at the edge's ends and averaged.

    Attributes:
        weights: The scenario's weights.
        plain: Whether the cost is the length alone.
    """

    def __init__(self, weights: Objective, checker: ValidityChecker) -> None:
        """Prepares the cost; states are asked about when an edge needs them."""
        self.weights = weights
        stated = weights.model_dump()
        self._terms = [(stated[name], cost) for name, cost in STATE_COSTS.items() if stated[name] > 0.0]
        self.plain = not self._terms
        self._checker = checker
        self._scale = checker.motion_scale
        self._states: dict[bytes, float] = {}

    def length(self, row_a: FloatArray, row_b: FloatArray) -> float:
        """Returns the least that an edge can cost: its length times the weight of length."""
        return self.weights.length * float(np.linalg.norm((row_b - row_a) * self._scale))

    def edge(self, row_a: FloatArray, row_b: FloatArray) -> float:
        """Returns the cost of the straight motion between two configurations, shape (dimension,) each."""
        motion = float(np.linalg.norm((row_b - row_a) * self._scale))
        if self.plain or motion == 0.0:
            return self.weights.length * motion
        return motion * (self.weights.length + 0.5 * (self.state(row_a) + self.state(row_b)))

    def state(self, row: FloatArray) -> float:
        """Returns what a metre of motion costs at a configuration, beside its length; infinite without a shape."""
        key = row.tobytes()
        if key not in self._states:
            if len(self._states) >= _REMEMBERED:
                self._states.clear()
            self._states[key] = self._state(row)
        return self._states[key]

    def _state(self, row: FloatArray) -> float:
        return float(sum(weight * cost(self._checker, row) for weight, cost in self._terms))
