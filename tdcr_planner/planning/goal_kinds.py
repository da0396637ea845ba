"""The kinds of goals: which keys of a scenario make one, where its states come from, and when a state misses it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tdcr_planner.arrays import FloatArray

if TYPE_CHECKING:
    from tdcr_planner.planning.goal import GoalSource
    from tdcr_planner.planning.scenario import Goal
    from tdcr_planner.planning.validity import ValidityChecker


class GoalKind(ABC):
    """A kind of goal.

    Attributes:
        key: The key of a scenario's goal that makes it one of this kind, as messages call it.
        keys: All keys of which one makes it one of this kind.
        title: What messages call it.
        other_keys: The keys that belong to it besides.
    """

    key: ClassVar[str]
    keys: ClassVar[frozenset[str]]
    title: ClassVar[str]
    other_keys: ClassVar[frozenset[str]]

    @abstractmethod
    def source(self, checker: ValidityChecker, goal: Goal, seed: int) -> GoalSource:
        """Returns where a search gets states that reach the goal."""

    @abstractmethod
    def miss(self, goal: Goal, position: FloatArray, rotation: FloatArray) -> str:
        """Returns by how much a state misses the goal, as a sentence; empty where it does not.

        Args:
            goal: The goal.
            position: The tip's, shape (3,), m, world frame.
            rotation: world_from_tip, shape (3, 3).
        """


class ConfigurationKind(GoalKind):
    """A goal that is one configuration: it is reached by being on the path, whatever its shape."""

    key = "bending_n"
    keys = frozenset({"bending_n", "bending_m", "tendon_n", "tendon_m"})
    title = "a configuration (bending_n)"
    other_keys = frozenset({"insertion_m", "roll_deg"})

    def source(self, checker: ValidityChecker, goal: Goal, seed: int) -> GoalSource:  # noqa: ARG002
        """Returns the configuration itself."""
        from tdcr_planner.planning.goal import ConfigurationGoal

        return ConfigurationGoal(checker, checker.space.row_of(goal))

    def miss(self, goal: Goal, position: FloatArray, rotation: FloatArray) -> str:  # noqa: ARG002
        """Returns nothing."""
        return ""


class TipKind(GoalKind):
    """A goal for the tip: a position within a tolerance, with or without a viewing direction."""

    key = "tip_position_m"
    keys = frozenset({"tip_position_m"})
    title = "a tip position (tip_position_m)"
    other_keys = frozenset({"tip_tolerance_m", "view_direction", "view_tolerance_deg"})

    def source(self, checker: ValidityChecker, goal: Goal, seed: int) -> GoalSource:
        """Returns a search for configurations whose tip reaches the goal."""
        from tdcr_planner.planning.goal import TipGoal

        return TipGoal(checker, goal, seed)

    def miss(self, goal: Goal, position: FloatArray, rotation: FloatArray) -> str:
        """Returns how far the tip is off, or by which angle it looks aside."""
        distance = float(np.linalg.norm(position - np.asarray(goal.tip_position_m)))
        if distance > goal.tip_tolerance_m:
            return f"the tip is {1e3 * distance:.3f} mm off, allowed {1e3 * goal.tip_tolerance_m:.3f} mm"
        if goal.view_direction is None:
            return ""
        view = np.asarray(goal.view_direction) / np.linalg.norm(goal.view_direction)
        axis = rotation[:, 2]
        angle = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, view)), axis @ view)))
        if angle > goal.view_tolerance_deg:
            return f"the tip looks {angle:.2f} degrees aside, allowed {goal.view_tolerance_deg:.2f}"
        return ""


GOAL_KINDS: tuple[GoalKind, ...] = (ConfigurationKind(), TipKind())
