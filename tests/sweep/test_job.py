from dataclasses import replace
from pathlib import Path

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.sweep.job import run_planning_job
from tdcr_planner.sweep.suite import load_suite


@pytest.fixture
def jobs(suite):
    """Two jobs of one scenario and one of another, which plan without gravity in free space."""
    return suite.jobs[0], suite.jobs[1], suite.jobs[3]


def test_a_job_does_not_depend_on_those_before_it(jobs):
    first, second, elsewhere = jobs
    alone = run_planning_job(first)
    assert alone["status"] == "verified"
    assert alone["result"]["states"] > 2
    assert alone["timing"]["plan_s"] > 0.0
    run_planning_job(second)
    assert run_planning_job(first)["result"] == alone["result"]
    run_planning_job(elsewhere)
    assert run_planning_job(first)["result"] == alone["result"]


def test_another_planner_than_the_scenarios_gets_none_of_its_parameters(make_scenario, suite):
    scenario = make_scenario(planner={"validity": "constant_curvature", "parameters": {"range": 0.4}})
    job = replace(suite.jobs[0], sha256=scenario.sha256)
    assert run_planning_job(job)["status"] == "verified"
    # BITstar has no parameter "range".
    assert run_planning_job(replace(job, planner="BITstar", time_limit_s=2.0))["status"] == "verified"


def test_refuses_a_scenario_that_has_changed(jobs):
    path = Path(jobs[0].path)
    path.write_text(path.read_text(encoding="utf-8") + "# a change\n")
    with pytest.raises(FormatError, match="has changed"):
        run_planning_job(jobs[0])


def test_a_planner_of_ones_own_is_judged_like_the_others(write_suite, fake_jobs):
    suite = load_suite(write_suite(planners='["tdcr_fake_jobs:straight_line"]'))
    record = run_planning_job(suite.jobs[0])
    assert record["status"] == "verified"
    assert record["result"]["states"] > 2
    assert record["timing"]["message"] == "a straight line"


@pytest.mark.parametrize("name", ["tdcr_fake_jobs:nothing", "no_such_module:plan", ":plan"])
def test_a_planner_that_cannot_be_imported_is_refused_by_name(write_suite, fake_jobs, name):
    with pytest.raises(FormatError, match="planners"):
        load_suite(write_suite(planners=f'["{name}"]'))
