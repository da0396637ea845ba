"""The tables of a sweep: a row a job in the suite's order, and rates and quantiles by group."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from tdcr_planner.rates import binomial_rate, quantiles
from tdcr_planner.sweep.job import FAILED
from tdcr_planner.sweep.runner import SweepOutcome
from tdcr_planner.sweep.suite import SweepJob

KEYS = ("job", "scenario", "difficulty", "planner", "model", "seed")
# What the seed decides. A query that ends at its time limit is "not_verified" here, whatever it had reached by then.
RESULT_COLUMNS = (
    *KEYS,
    "outcome",
    "repairs",
    "states",
    "tip_travel_m",
    "duration_s",
    "clearance_m",
    "deviation_m",
    "residual_nm",
    "path_sha256",
)
# What differs from run to run and from machine to machine.
TIMING_COLUMNS = (
    *KEYS,
    "status",
    "plan_s",
    "verify_s",
    "total_s",
    "iterations",
    "vertices",
    "states_checked",
    "edges_checked",
    "rejected",
    "repairs_tried",
    "last_clearance_m",
    "last_deviation_m",
    "message",
    "worker",
)
FOUND = ("verified", "unverified")
TIMED_OUT = ("unverified", "no_path")
NOT_VERIFIED = "not_verified"
GROUPINGS = (("scenario", "planner", "model"), ("difficulty", "planner", "model"), ("planner", "model"))

Row = dict[str, Any]


def result_rows(outcome: SweepOutcome) -> list[Row]:
    """Returns a row a finished job with RESULT_COLUMNS: the same whichever workers ran it."""
    rows = []
    for job, record in _finished(outcome):
        outcome_name = NOT_VERIFIED if record["status"] in TIMED_OUT else record["status"]
        row = {**_keys(job), "outcome": outcome_name, **record["result"]}
        rows.append({column: row.get(column) for column in RESULT_COLUMNS})
    return rows


def timing_rows(outcome: SweepOutcome) -> list[Row]:
    """Returns a row a finished job with TIMING_COLUMNS."""
    rows = []
    for job, record in _finished(outcome):
        row = {**_keys(job), "status": record["status"], **record["timing"]}
        row["rejected"] = json.dumps(row.get("rejected", {}), sort_keys=True)
        rows.append({column: row.get(column) for column in TIMING_COLUMNS})
    return rows


def joined_rows(outcome: SweepOutcome) -> list[Row]:
    """Returns a row a finished job with all columns."""
    pairs = zip(result_rows(outcome), timing_rows(outcome), strict=True)
    return [{**result, **timing} for result, timing in pairs]


def group_rows(rows: Sequence[Row], by: Sequence[str]) -> list[Row]:
    """Returns a summary a group of joined rows, groups in order of appearance.

    Each has the group's keys, jobs, a count a status, the rates found and verified (of all jobs of the group), and
    quantiles over the verified ones: plan_s, total_s, tip_travel_m, duration_s, clearance_m, deviation_m.

    Args:
        rows: From `joined_rows`.
        by: Columns whose values make up a group.
    """
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[column] for column in by), []).append(row)
    return [_summarise(dict(zip(by, values, strict=True)), members) for values, members in groups.items()]


def _summarise(keys: Row, members: list[Row]) -> Row:
    statuses = [row["status"] for row in members]
    verified = [row for row in members if row["status"] == "verified"]
    return {
        **keys,
        "jobs": len(members),
        "statuses": {status: statuses.count(status) for status in sorted(set(statuses))},
        "failed": statuses.count(FAILED),
        "found": binomial_rate(sum(status in FOUND for status in statuses), len(members)).as_dict(),
        "verified": binomial_rate(len(verified), len(members)).as_dict(),
        "repairs": sum(row["repairs_tried"] or 0 for row in members),
        "quantiles": {
            column: quantiles([row[column] for row in verified if row[column] is not None])
            for column in ("plan_s", "total_s", "tip_travel_m", "duration_s", "clearance_m", "deviation_m")
        },
    }


def _keys(job: SweepJob) -> Row:
    return {
        "job": job.index,
        "scenario": job.scenario,
        "difficulty": job.difficulty,
        "planner": job.planner,
        "model": job.model,
        "seed": job.seed,
    }


def _finished(outcome: SweepOutcome) -> list[tuple[SweepJob, dict[str, Any]]]:
    return [(job, outcome.records[job.index]) for job in outcome.suite.jobs if job.index in outcome.records]
