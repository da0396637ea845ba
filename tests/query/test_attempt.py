from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tdcr_planner.planning.planner import SearchOutcome, SearchStatus
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.attempt import REPAIR_MARGIN_M, Attempt
from tdcr_planner.query.result import PlanStatus


def outcome(found: bool = True, message: str = "no path", **statistics: Any) -> SearchOutcome:
    rows = np.zeros((2, 2)) if found else None
    status = SearchStatus.FOUND if found else SearchStatus.NO_PATH
    return SearchOutcome(status, message, rows, statistics={"states_checked": 0, **statistics})


def report(cause: str = "clearance", clearance: float = 0.0, verified: bool = False) -> Any:
    return SimpleNamespace(
        cause=cause, clearance=np.array([0.01, clearance]), verified=verified, message="too near", worst_state=1
    )


@pytest.fixture
def attempt(make_scenario: Callable[..., Scenario]) -> Attempt:
    return Attempt(make_scenario(planner={"validity": "constant_curvature", "clearance_m": 0.001}))


def states() -> Any:
    return SimpleNamespace(rows=np.array([[0.0, 0.0], [1.0, 2.0]]))


def test_too_little_clearance_grows_the_margin_by_what_was_missing(attempt: Attempt) -> None:
    attempt.add_search(outcome(), 1.0)
    attempt.add_verification(report(clearance=0.0004), states(), 1.0)
    attempt.learn()
    np.testing.assert_allclose(attempt.extra_margin, 0.001 - 0.0004 + REPAIR_MARGIN_M, rtol=1e-12)
    assert not attempt.ruled_out


def test_a_state_that_the_reference_refuses_is_ruled_out(attempt: Attempt) -> None:
    attempt.add_search(outcome(), 1.0)
    attempt.add_verification(report(cause="statics"), states(), 1.0)
    attempt.learn()
    assert attempt.extra_margin == 0.0
    np.testing.assert_array_equal(attempt.ruled_out, [[1.0, 2.0]])


def test_counts_of_all_searches_are_added(attempt: Attempt) -> None:
    first, second = {"vertices": 9, "answered": True}, {"vertices": 9, "answered": False}
    attempt.add_search(outcome(states_checked=3, rejected={"cavity": 2}, roadmap=first), 1.0)
    attempt.add_search(outcome(states_checked=4, rejected={"cavity": 1, "edge": 5}, roadmap=second), 2.0)
    assert attempt.plan_s == 3.0
    assert attempt.statistics == {
        "states_checked": 7,
        "rejected": {"cavity": 3, "edge": 5},
        "roadmap": second,
    }


def test_the_verdict_tells_what_the_repairs_came_to(attempt: Attempt) -> None:
    attempt.add_search(outcome(False), 1.0)
    assert attempt.verdict() == (PlanStatus.NO_PATH, "no path")
    attempt.add_search(outcome(message="path of 2 waypoints"), 1.0)
    attempt.add_verification(report(), states(), 1.0)
    unconfirmed = "a path was found, but the reference does not confirm it: too near"
    assert attempt.verdict() == (PlanStatus.UNVERIFIED, unconfirmed)
    attempt.learn()
    attempt.add_search(outcome(), 1.0)
    attempt.add_verification(report(), states(), 1.0)
    assert attempt.verdict()[1] == f"{unconfirmed}; 1 repair was tried, and the path is the last one's"
    attempt.learn()
    attempt.add_search(outcome(False, "nothing there"), 1.0)
    said = "; 2 repairs were tried, and the last one's search came back empty: nothing there"
    assert attempt.verdict() == (PlanStatus.UNVERIFIED, unconfirmed + said)
    attempt.add_verification(report(verified=True), states(), 1.0)
    assert attempt.verdict()[0] is PlanStatus.VERIFIED
