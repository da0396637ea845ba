"""The planners by the name that files use: OMPL's, those that installed packages register, and functions by import."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from tdcr_planner.errors import InputError, UnknownNameError
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.offered import OMPL_TRAITS, REFUSED
from tdcr_planner.planning.planner import Connector, Planner, Progress, SearchOutcome, SearchTask
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import ValidityChecker
from tdcr_planner.registry import Registry

GROUP = "tdcr_planner.planners"

Search = Callable[..., SearchOutcome]
"""Called as (scenario, space, checker, time_limit_s=..., seed=...)."""


def _check_planner(name: str, found: Any) -> Planner:
    planner = found() if isinstance(found, type) else found
    if not isinstance(planner, Planner):
        raise InputError(f"planner {name!r}", "a subclass of tdcr_planner.planning.planner.Planner", repr(found))
    if planner.name != name:
        raise InputError(f"planner {name!r}", "a planner whose `name` is the entry point's", repr(planner.name))
    return planner


PLANNERS: Registry[Planner] = Registry(
    "planner",
    built_in={name: f"tdcr_planner.planning.ompl_planner:OMPL_PLANNERS.{name}" for name in OMPL_TRAITS},
    check=_check_planner,
    group=GROUP,
)


@dataclass(frozen=True)
class FunctionPlanner(Planner):
    """A planner that is a function, named "module:function"; a path that the reference refuses is its answer.

    Attributes:
        name: "module:function".
        function: Called with the scenario, its space and a validity checker with the margins of its shape model.
    """

    name: str
    function: Search
    repairs = False

    def search(self, task: SearchTask) -> SearchOutcome:
        """Returns what the function answers."""
        return self.function(task.scenario, task.space, task.checker, time_limit_s=task.time_limit_s, seed=task.seed)


def find_planner(name: str) -> Planner:
    """Returns the planner of a name; "module:function" is imported, which runs the module.

    Raises:
        InputError: There is no such planner; the message names those that are, and why an OMPL planner is refused.
    """
    check_planner_name(name)
    return _import_function(name) if ":" in name else PLANNERS.find(name)


def check_planner_name(name: str) -> None:
    """Raises InputError unless a name is a planner's or has the form "module:function"; imports nothing."""
    if ":" in name:
        module, _, function = name.partition(":")
        if not all(part.isidentifier() for part in [*module.split("."), function]):
            raise InputError("planner", "module:function, such as my_planners:search", repr(name))
    elif name not in OMPL_TRAITS and name not in PLANNERS.names():
        reason = f" (OMPL has {name}, but {REFUSED[name]})" if name in REFUSED else ""
        raise UnknownNameError("planner.name", name, PLANNERS.names(), reason)


def _import_function(name: str) -> Planner:
    module, _, function = name.partition(":")
    try:
        found = getattr(import_module(module), function, None)
    except (Exception, SystemExit) as error:  # a module is a program: it may raise anything
        raise InputError(
            "planner",
            "module:function of a module that can be imported",
            f"{name!r} ({type(error).__name__}: {error})",
        ) from error
    if not callable(found):
        raise InputError("planner", f"a function of module {module}", repr(function))
    return FunctionPlanner(name, found)


def search(
    scenario: Scenario,
    space: ConfigurationSpace,
    checker: ValidityChecker,
    *,
    time_limit_s: float | None = None,
    seed: int | None = None,
    progress: Progress | None = None,
    edges: EdgeChecker | None = None,
    connector: Connector | None = None,
) -> SearchOutcome:
    """Searches a path from the scenario's start through its goals with the planner that it names.

    Args:
        scenario: The query; its planner settings hold unless an argument here replaces them.
        space: Its configuration space.
        checker: Validity of states, with the scene inflated by `planning_margins`.
        time_limit_s: Time for the whole search; None for the scenario's.
        seed: Seed, above 0; None for the scenario's. The same seed gives the same path unless the time runs out or
            the planner is one that improves its path until then (give those the parameter `iterations`).
        progress: Called with the completed fraction of the time limit and a message.
        edges: Validity of edges; None makes one with the scenario's step.
        connector: Asked for each leg before the planner, which runs where it knows no path; None for the planner alone.

    Returns:
        The outcome; an invalid start, a goal out of reach and no path are statuses, not exceptions.

    Raises:
        InputError: There is no such planner, or it lacks one of the parameters.
    """
    settings = scenario.planner
    planner = find_planner(settings.name)
    planner.check_parameters(settings.parameters)
    return planner.search(
        SearchTask(
            scenario=scenario,
            space=space,
            checker=checker,
            time_limit_s=settings.time_limit_s if time_limit_s is None else time_limit_s,
            seed=settings.seed if seed is None else seed,
            progress=progress,
            edges=edges,
            connector=connector,
        )
    )
