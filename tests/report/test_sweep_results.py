import csv
import json
import sqlite3
import subprocess
import sys

import numpy as np
import pyarrow.parquet
import pytest

from tdcr_planner.query.result import PlanStatus
from tdcr_planner.report.sweep_results import write_sweep
from tdcr_planner.sweep.runner import SweepOutcome
from tdcr_planner.sweep.suite import load_suite
from tdcr_planner.sweep.table import RESULT_COLUMNS, TIMING_COLUMNS, joined_rows


@pytest.fixture
def suite(make_scenario):
    scenario = make_scenario()
    path = scenario.path.with_name("suite.toml")
    path.write_text(
        f"""format = "tdcr-suite/1"
title = "A suite"
scenarios = [{{file = "{scenario.path.name}", difficulty = "easy"}}]
planners = ["RRTConnect", "RRT"]
models = ["constant_curvature"]
seeds = [4, 5, 6]
"""
    )
    return load_suite(path)


def verified(plan_s, **result):
    result = {"repairs": 0, "states": 9, "tip_travel_m": 0.1 + 0.01 * plan_s, "clearance_m": 0.002, **result}
    timing = {"plan_s": plan_s, "total_s": plan_s + 0.5, "verify_s": 0.4, "iterations": 12, "repairs_tried": 0}
    return {"status": "verified", "result": result, "timing": {**timing, "last_clearance_m": 0.002, "worker": "here:1"}}


@pytest.fixture
def outcome(suite):
    records = {
        0: verified(0.5, path_sha256="ab", residual_nm=1e-13 / 3.0),
        1: verified(1.5),
        2: {"status": "no_path", "result": {}, "timing": {"plan_s": 9.0, "total_s": 9.1, "message": 'no, "none"'}},
        3: {"status": "failed", "result": {}, "timing": {"message": "ValueError: no"}},
        4: {"status": "unverified", "result": {}, "timing": {"plan_s": 9.0, "total_s": 9.9, "repairs_tried": 2}},
        5: verified(2.5),
    }
    return SweepOutcome(suite, records, 0)


def read(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_tables_hold_every_job_with_all_digits(outcome, tmp_path):
    write_sweep(outcome, tmp_path / "out")
    results, timings = read(tmp_path / "out" / "results.csv"), read(tmp_path / "out" / "timings.csv")
    assert tuple(results[0]) == RESULT_COLUMNS
    assert tuple(timings[0]) == TIMING_COLUMNS
    assert [row["outcome"] for row in results] == [
        "verified", "verified", "not_verified", "failed", "not_verified", "verified",
    ]  # fmt: skip
    assert float(results[0]["residual_nm"]) == 1e-13 / 3.0
    assert timings[2]["message"] == 'no, "none"'
    table = pyarrow.parquet.read_table(tmp_path / "out" / "results.parquet").to_pylist()
    for row, expected in zip(table, joined_rows(outcome), strict=True):
        assert row == expected


def test_results_do_not_depend_on_times(outcome, tmp_path):
    write_sweep(outcome, tmp_path / "one")
    for record in outcome.records.values():
        record["timing"]["plan_s"] = 77.0
    write_sweep(outcome, tmp_path / "two")
    first, second = ((tmp_path / name / "results.csv").read_bytes() for name in ("one", "two"))
    assert first == second


def test_summary_says_what_is_missing_and_failed(outcome, tmp_path):
    summary = json.loads(write_sweep(outcome, tmp_path / "out").read_text(encoding="utf-8"))
    assert summary["format"] == "tdcr-sweep-summary/1"
    assert summary["complete"]
    assert [item["message"] for item in summary["failed"]] == ["ValueError: no"]
    connect, rrt = summary["groups"]["planner_model"]
    assert (connect["planner"], connect["verified"]["count"], connect["verified"]["total"]) == ("RRTConnect", 2, 3)
    assert connect["quantiles"]["plan_s"]["median"] == 1.0
    assert rrt["statuses"] == {"failed": 1, "unverified": 1, "verified": 1}
    del outcome.records[5]
    part = SweepOutcome(outcome.suite, outcome.records, 0, "interrupted")
    summary = json.loads(write_sweep(part, tmp_path / "out").read_text(encoding="utf-8"))
    assert not summary["complete"]
    assert summary["finished"] == 5
    assert "5 of 6 jobs (incomplete: interrupted)" in (tmp_path / "out" / "summary.md").read_text(encoding="utf-8")


def test_every_row_of_the_summary_adds_up_to_its_jobs(outcome, tmp_path):
    for index, status in enumerate((*PlanStatus, "failed")):
        outcome.records[index] = {"status": status, "result": {}, "timing": {"message": ""}}
    write_sweep(outcome, tmp_path / "out")
    lines = (tmp_path / "out" / "summary.md").read_text(encoding="utf-8").splitlines()
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    rows = [dict(zip(table[0], cells, strict=True)) for cells in table[2:4]]
    endings = ("verified", "unverified", "no path", "invalid", "failed")
    counts = [[int(row[name].split()[0]) for name in endings] for row in rows]
    assert counts == [[1, 1, 1, 0, 0], [0, 0, 0, 2, 1]]
    assert [row["jobs"] for row in rows] == ["3", "3"]


def test_plots_are_written_and_not_empty(outcome, tmp_path):
    from matplotlib.image import imread

    write_sweep(outcome, tmp_path / "out")
    for name in ("success", "times", "spread"):
        image = imread(tmp_path / "out" / f"{name}.png")
        assert np.ptp(image[..., :3]) > 0.5
        assert (tmp_path / "out" / f"{name}.pdf").read_bytes().startswith(b"%PDF")


def test_a_sweep_of_which_nothing_finished_still_has_a_report(suite, tmp_path):
    summary = json.loads(
        write_sweep(SweepOutcome(suite, {}, 0, "interrupted"), tmp_path / "out").read_text(encoding="utf-8")
    )
    assert summary["finished"] == 0
    assert read(tmp_path / "out" / "results.csv") == []


def test_ompls_own_reader_reads_the_benchmark_log(outcome, tmp_path):
    write_sweep(outcome, tmp_path / "out")
    database = tmp_path / "benchmark.db"
    command = [sys.executable, "-m", "ompl.ompl_benchmark_statistics", "-d", str(database)]
    subprocess.run(
        [*command, *(str(file) for file in (tmp_path / "out").glob("ompl_*.log"))], check=True, capture_output=True
    )
    with sqlite3.connect(database) as connection:
        (experiment,) = connection.execute("SELECT name, runcount, timelimit, difficulty FROM experiments")
        planners = dict(connection.execute("SELECT id, name FROM plannerConfigs"))
        runs = connection.execute(
            "SELECT plannerid, time, solved, enums.description, solution_length, seed FROM runs "
            "JOIN enums ON enums.value = runs.status AND enums.name = 'status' ORDER BY runs.id"
        ).fetchall()
    connection.close()
    assert experiment == (outcome.suite.jobs[0].scenario.removesuffix(".toml"), 3, 10.0, "easy")
    assert [(planners[run[0]], *run[1:]) for run in runs] == [
        ("geometric_RRTConnect_constant_curvature", 0.5, 1, "Exact solution", pytest.approx(0.105), 4),
        ("geometric_RRTConnect_constant_curvature", 1.5, 1, "Exact solution", pytest.approx(0.115), 5),
        ("geometric_RRTConnect_constant_curvature", 9.0, 0, "Timeout", None, 6),
        ("geometric_RRT_constant_curvature", None, 0, "Crash", None, 4),
        ("geometric_RRT_constant_curvature", 9.0, 0, "Approximate solution", None, 5),
        ("geometric_RRT_constant_curvature", 2.5, 1, "Exact solution", pytest.approx(0.125), 6),
    ]
