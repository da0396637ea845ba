from types import SimpleNamespace

import numpy as np
import pytest

from tdcr_planner.planning.path import TensionPath
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.sweep.job import record_of
from tdcr_planner.sweep.runner import SweepOutcome
from tdcr_planner.sweep.table import (
    RESULT_COLUMNS,
    TIMING_COLUMNS,
    group_rows,
    joined_rows,
    result_rows,
    timing_rows,
)


@pytest.fixture
def plan_result():
    """Returns a function that gives a planning result with a straight path of three states."""

    def make(status=PlanStatus.VERIFIED, insertion=0.2, plan_s=0.7):
        path = TensionPath(
            bending=np.zeros((3, 1, 2)),
            insertion=np.linspace(0.0, insertion, 3),
            roll=np.zeros(3),
            tensions=np.zeros((3, 3)),
            tendon_displacements=np.zeros((3, 3)),
            tip_positions=np.linspace([0.0, 0.0, 0.2], [0.0, 0.0, 0.2 + insertion], 3),
            times=np.array([0.0, 1.0, 2.0]),
        )
        found = status in (PlanStatus.VERIFIED, PlanStatus.UNVERIFIED)
        return SimpleNamespace(
            status=status,
            message="a message",
            path=path if found else None,
            verification=SimpleNamespace(worst={"clearance_m": 0.001, "deviation_m": np.nan, "residual_nm": 1e-12})
            if found
            else None,
            repairs=1,
            timings_s={"load": 9.0, "plan": plan_s, "verify": 0.1, "total": 1.0 + plan_s},
            planner={
                "iterations": 5,
                "vertices": 6,
                "states_checked": 7,
                "edges_checked": 8,
                "rejected": {"cavity": 9},
            },
        )

    return make


def test_a_record_holds_what_the_seed_decides_apart_from_the_times(plan_result):
    record, later = record_of(plan_result()), record_of(plan_result(plan_s=2.5))
    assert record["result"] == later["result"]
    assert record["result"]["tip_travel_m"] == pytest.approx(0.2)
    assert record["result"]["states"] == 3
    assert record["result"]["clearance_m"] == 0.001
    assert record["result"]["deviation_m"] is None
    assert (record["timing"]["plan_s"], later["timing"]["plan_s"]) == (0.7, 2.5)
    assert record["timing"]["rejected"] == {"cavity": 9}
    assert "load_s" not in record["timing"]
    other = record_of(plan_result(insertion=0.2 + 1e-12))
    assert other["result"]["path_sha256"] != record["result"]["path_sha256"]


@pytest.mark.parametrize("status", [PlanStatus.UNVERIFIED, PlanStatus.NO_PATH])
def test_how_far_a_query_came_by_its_time_limit_is_no_result(suite, plan_result, status):
    (row,) = result_rows(SweepOutcome(suite, {0: record_of(plan_result(status))}, 0))
    assert row["outcome"] == "not_verified"
    assert all(row[column] is None for column in RESULT_COLUMNS[RESULT_COLUMNS.index("repairs") :])
    (row,) = timing_rows(SweepOutcome(suite, {0: record_of(plan_result(status))}, 0))
    assert row["status"] == status.value


def test_rows_are_in_the_suites_order_with_all_columns(suite, plan_result):
    records = {index: record_of(plan_result()) for index in (5, 0, 3)}
    outcome = SweepOutcome(suite, records, 0)
    assert [row["job"] for row in joined_rows(outcome)] == [0, 3, 5]
    assert all(tuple(row) == RESULT_COLUMNS for row in result_rows(outcome))
    assert all(tuple(row) == TIMING_COLUMNS for row in timing_rows(outcome))


def test_groups_count_statuses_and_take_quantiles_over_verified_paths(suite, plan_result):
    statuses = [
        PlanStatus.VERIFIED,
        PlanStatus.VERIFIED,
        PlanStatus.NO_PATH,
        PlanStatus.UNVERIFIED,
        PlanStatus.VERIFIED,
    ]
    times = [1.0, 3.0, 99.0, 99.0, 8.0]
    records = {
        index: record_of(plan_result(status, plan_s=time))
        for index, (status, time) in enumerate(zip(statuses, times, strict=True))
    }
    records[5] = {"status": "failed", "result": {}, "timing": {"message": "it crashed"}}
    hard, easy = group_rows(joined_rows(SweepOutcome(suite, records, 0)), ("difficulty", "model"))
    assert (hard["difficulty"], hard["model"], easy["difficulty"]) == ("hard", "constant_curvature", "easy")
    assert hard["statuses"] == {"no_path": 1, "verified": 2}
    assert (hard["verified"]["count"], hard["verified"]["total"], hard["found"]["count"]) == (2, 3, 2)
    assert hard["quantiles"]["plan_s"]["median"] == 2.0
    assert easy["statuses"] == {"failed": 1, "unverified": 1, "verified": 1}
    assert (easy["failed"], easy["found"]["count"]) == (1, 2)
    assert easy["quantiles"]["plan_s"]["max"] == 8.0
