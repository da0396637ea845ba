"""Objectives: what a path costs, as a weighted sum of its length, nearness to surfaces and tendon tensions."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.scenario import Objective
from tdcr_planner.planning.validity import ValidityChecker

NEAR_M = 0.005  # clearance at which nearness has fallen to a half
_REMEMBERED = 100_000


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
        self.plain = weights.clearance == 0.0 and weights.effort == 0.0
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
        cost = 0.0
        if self.weights.effort > 0.0:
            cost += self.weights.effort * float(self._checker.actuate(row[None]).tensions.sum())
        if self.weights.clearance > 0.0:
            positions, rotations, solved = self._checker.world_poses(row[None])
            if not solved[0]:
                return float("inf")
            gap = max(float(self._checker.scene.clearance(positions, rotations)[0]), 0.0)
            cost += self.weights.clearance * NEAR_M / (NEAR_M + gap)
        return cost
