"""How a query is answered: search, verification by the reference, and repair, until the time is over."""

from __future__ import annotations

import logging
import time
from dataclasses import replace

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.planner import Planner, Progress, SearchOutcome, SearchTask
from tdcr_planner.planning.planners import find_planner
from tdcr_planner.planning.roadmap_way import RoadmapConnector
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.validity import ValidityChecker
from tdcr_planner.query.attempt import RULED_OUT_M, Attempt
from tdcr_planner.query.environment import Environment
from tdcr_planner.query.paths import path_states, tension_path
from tdcr_planner.query.result import PlanResult, library_versions

# Fraction of the time limit that the search leaves to verification, and its most.
VERIFY_FRACTION = 0.2
VERIFY_RESERVE_S = 1.0

logger = logging.getLogger(__name__)


def answer_query(
    environment: Environment,
    query: Scenario,
    *,
    margins: FloatArray | None = None,
    load_s: float = 0.0,
    progress: Progress | None = None,
) -> PlanResult:
    """Searches a path, verifies it with the reference and repairs it within the time limit.

    Args:
        environment: The scene, its models and a roadmap.
        query: A scenario in the same scene.
        margins: What each disk keeps besides in the search, shape (d,), m; None for nothing.
        load_s: Seconds that loading took, for the result's timings.
        progress: Called with the completed fraction of the time limit and a message now and then.

    Raises:
        InputError: There is no such planner, or it lacks one of the parameters.
    """
    planner = find_planner(query.planner.name)
    planner.check_parameters(query.planner.parameters)
    environment.warm_up(query)
    started = time.monotonic()
    deadline = started + query.planner.time_limit_s
    attempt = Attempt(query)
    if margins is not None:
        attempt.extra_margin = margins
    while True:
        begin = time.monotonic()
        checker = _checker(environment, attempt)
        outcome = _search(environment, planner, attempt, checker, deadline - begin, progress)
        attempt.add_search(outcome, time.monotonic() - begin)
        if not outcome.found:
            break
        begin = time.monotonic()
        rows, goals = path_states(query, checker, outcome)
        report, states = environment.verifier(query).verify(rows, goals, deadline=deadline)
        attempt.add_verification(report, states, time.monotonic() - begin)
        if report.verified or not planner.repairs or time.monotonic() >= deadline:
            break
        logger.info("repair %d: %s", attempt.repairs + 1, report.message)
        attempt.learn()
    return _result(environment, attempt, load_s, time.monotonic() - started)


def _checker(environment: Environment, attempt: Attempt) -> ValidityChecker:
    checker = environment.checker(attempt.query, extra_margin=attempt.extra_margin)
    for row in attempt.ruled_out:
        checker.rule_out(row, RULED_OUT_M)
    return checker


def _search(
    environment: Environment,
    planner: Planner,
    attempt: Attempt,
    checker: ValidityChecker,
    left_s: float,
    progress: Progress | None,
) -> SearchOutcome:
    """Searches within the time left, of which verification keeps its part."""
    query, roadmap, unfit = attempt.query, environment.roadmap, ""
    if roadmap is not None:
        unfit = roadmap.conditions.unfit_for(environment.conditions(query))
    connector = None if roadmap is None or unfit else RoadmapConnector(roadmap)
    task = SearchTask(
        scenario=query,
        space=environment.space,
        checker=checker,
        time_limit_s=max(left_s - min(VERIFY_FRACTION * left_s, VERIFY_RESERVE_S), 0.01),
        seed=query.planner.seed + attempt.repairs,
        progress=progress,
        connector=connector,
    )
    outcome = planner.search(task)
    if roadmap is None:
        return outcome
    known = roadmap.size | ({"answered": False, "unfit": unfit} if connector is None else connector.answers)
    return replace(outcome, statistics=outcome.statistics | {"roadmap": known})


def _result(environment: Environment, attempt: Attempt, load_s: float, spent_s: float) -> PlanResult:
    status, message = attempt.verdict()
    query, states = attempt.query, attempt.states
    return PlanResult(
        status=status,
        message=message,
        scenario=query,
        seed=query.planner.seed,
        path=None if states is None else tension_path(query, environment.space, states, attempt.order),
        verification=attempt.report,
        repairs=attempt.repairs,
        timings_s={"load": load_s, "plan": attempt.plan_s, "verify": attempt.verify_s, "total": load_s + spent_s},
        planner=attempt.statistics,
        hashes=environment.hashes(query),
        versions=library_versions(),
    )
