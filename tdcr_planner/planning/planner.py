"""What every planner offers: a search from a scenario's start through its goals, with answers as values.

A planner is a class in one file: it says how files call it, which parameters it takes, and whether a path that the
reference refuses is searched again. `planning.planners` finds it by its name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError, UnknownNameError
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.goal import GoalSource
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import ValidityChecker

Progress = Callable[[float, str], None]
"""Called with the completed fraction of the time limit and a message."""


class SearchStatus(StrEnum):
    """How a search ended."""

    FOUND = "found"
    NO_PATH = "no_path"
    INVALID_START = "invalid_start"
    INVALID_GOAL = "invalid_goal"


@dataclass(frozen=True)
class SearchOutcome:
    """The answer of a search.

    Attributes:
        status: How it ended.
        message: The same for a person.
        rows: Waypoints of the path, shape (k, dimension), or None.
        goals: Index in rows at which each goal is reached, in the order of travel.
        order: The goals' numbers (from 0) in the order of travel.
        statistics: name, iterations, goal_states, states_checked, edges_checked, rejected (a count a cause),
            answered_by ("plain_motions", "retraction", "planner" or "roadmap", whichever found the last leg's path, or
            ""), and retraction where states were pulled back (see `Passage.statistics`).
    """

    status: SearchStatus
    message: str
    rows: FloatArray | None = None
    goals: tuple[int, ...] = ()
    order: tuple[int, ...] = ()
    statistics: dict[str, Any] = field(default_factory=dict)

    @property
    def found(self) -> bool:
        """Whether there is a path."""
        return self.status is SearchStatus.FOUND


class Connector(Protocol):
    """What may know a path already and is asked before the planner; `planning.roadmap_way` has one."""

    def connect(self, edges: EdgeChecker, start: FloatArray, goal: GoalSource, deadline: float) -> FloatArray | None:
        """Returns waypoints (k, dimension) from a start to a goal state whose edges have all been checked, or None."""
        ...


@dataclass(frozen=True)
class SearchTask:
    """What a planner is given.

    Attributes:
        scenario: The query, with its start, goals and planner settings.
        space: Its configuration space.
        checker: Validity of states, with the scene inflated by `planning_margins`.
        time_limit_s: Time for the whole search.
        seed: Seed, above 0. The same seed gives the same path unless the time runs out.
        progress: Called with the completed fraction of the time limit and a message; may raise to end the search.
        edges: Validity of edges; None where the planner is to make its own, with the scenario's step.
        connector: What may know a path already; None for nothing.
    """

    scenario: Scenario
    space: ConfigurationSpace
    checker: ValidityChecker
    time_limit_s: float
    seed: int
    progress: Progress | None = None
    edges: EdgeChecker | None = None
    connector: Connector | None = None


class Planner(ABC):
    """A search.

    Attributes:
        name: What scenario and suite files call it.
        repairs: Whether it is asked again, with larger margins and states ruled out, when the reference refuses its
            path.
    """

    name: str
    repairs: bool = True

    @abstractmethod
    def search(self, task: SearchTask) -> SearchOutcome:
        """Searches a path from the scenario's start through its goals.

        An invalid start, a goal out of reach and no path are statuses of the outcome, not exceptions.
        """

    def parameters(self) -> Mapping[str, type]:
        """Returns the planner's parameters in a scenario, each bool, int or float; none by default."""
        return {}

    def check_parameters(self, parameters: Mapping[str, Any]) -> None:
        """Raises InputError unless the planner has those parameters and they are of the right type."""
        if not parameters:
            return
        known = self.parameters()
        for key, value in parameters.items():
            if key not in known:
                raise UnknownNameError(f"planner.parameters of {self.name}", key, known)
            convert_parameter(key, value, known[key])


def convert_parameter(key: str, value: Any, kind: type) -> Any:
    """Returns a parameter's value as its type.

    Raises:
        InputError: It is none of that type.
    """
    if kind is bool and isinstance(value, bool):
        return value
    if kind is int and isinstance(value, int) and not isinstance(value, bool) and value >= 0:
        return value
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value):
        return float(value)
    wanted = {bool: "true or false", int: "a whole number of 0 or more", float: "a finite number"}[kind]
    raise InputError(f"planner.parameters.{key}", wanted, repr(value))
