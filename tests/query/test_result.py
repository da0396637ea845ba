from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.session import PlanningSession


def test_a_result_is_printed_in_a_few_lines_with_or_without_a_path(make_scenario: Callable[..., Scenario]) -> None:
    scenario = make_scenario()
    result = PlanningSession(scenario).plan()
    assert result.path is not None
    text = repr(result)
    assert text.startswith("PlanResult(status='verified', ")
    assert str(scenario.path) in text
    assert f"path=<{len(result.path)} states>, verification=VerificationReport(verified=True, " in text
    assert len(text) < 400 + len(str(scenario.path))
    assert "path=None, verification=None" in repr(replace(result, path=None, verification=None))
