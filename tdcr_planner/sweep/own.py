"""Planners that are not this package's: found by import, run once, and judged by the reference like any other."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable

from tdcr_planner.errors import InputError
from tdcr_planner.planning.ompl_planner import SearchOutcome, SearchStatus
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.session import PlanningSession, PlanResult, PlanStatus

# Called as `tdcr_planner.planning.ompl_planner.search` is: (scenario, space, checker, time_limit_s=..., seed=...).
Search = Callable[..., SearchOutcome]


def is_own(planner: str) -> bool:
    """Returns whether a planner's name in a suite is "module:function" and not one of OMPL's."""
    return ":" in planner


def check_form(planner: str) -> None:
    """Raises InputError unless a name has the form "module:function"; imports nothing."""
    module, _, name = planner.partition(":")
    if not all(part.isidentifier() for part in [*module.split("."), name]):
        raise InputError("planner", "module:function, such as my_planners:search", repr(planner))


def load_search(planner: str) -> Search:
    """Returns the function that "module:function" names.

    Raises:
        InputError: The module cannot be imported or has no such function.
    """
    module, _, name = planner.partition(":")
    try:
        found = getattr(importlib.import_module(module), name, None)
    except (Exception, SystemExit) as error:  # a module is a program: it may raise anything
        raise InputError(
            "planner",
            "module:function of a module that can be imported",
            f"{planner!r} ({type(error).__name__}: {error})",
        ) from error
    if not callable(found):
        raise InputError("planner", f"a function of module {module}", repr(name))
    return found


def plan_with(search: Search, session: PlanningSession, query: Scenario) -> PlanResult:
    """Searches once with a function of one's own and verifies what it found; there is no repair.

    Args:
        search: Called with the scenario, its space and a validity checker with the margins of its shape model.
        session: The scene's session.
        query: The scenario; its planner settings hold.
    """
    settings = query.planner
    checker = session.checker(query)
    begin = time.monotonic()
    outcome = search(query, session.space, checker, time_limit_s=settings.time_limit_s, seed=settings.seed)
    searched = time.monotonic()
    path = report = None
    if outcome.rows is not None:
        rows, goals = session.path_states(query, checker, outcome)
        report, states = session.verifier(query).verify(rows, goals)
        path = session.tension_path(query, states, outcome.order)
        status = PlanStatus.VERIFIED if report.verified else PlanStatus.UNVERIFIED
    else:
        status = {
            SearchStatus.INVALID_START: PlanStatus.INVALID_START,
            SearchStatus.INVALID_GOAL: PlanStatus.INVALID_GOAL,
        }.get(outcome.status, PlanStatus.NO_PATH)
    ended = time.monotonic()
    return PlanResult(
        status=status,
        message=outcome.message if report is None or report.verified else report.message,
        scenario=query,
        seed=settings.seed,
        path=path,
        verification=report,
        timings_s={"load": 0.0, "plan": searched - begin, "verify": ended - searched, "total": ended - begin},
        planner=dict(outcome.statistics),
    )
