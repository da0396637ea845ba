"""OMPL's benchmark log: the results of a sweep in the form that ompl_benchmark_statistics and Planner Arena read."""

from __future__ import annotations

import json
import platform
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tdcr_planner.sweep.suite import Suite

# ompl::base::PlannerStatus::StatusType, in its order: the reader keeps one such list for all logs in a database.
_STATUSES = (
    "Unknown status",
    "Invalid start",
    "Invalid goal",
    "Unrecognized goal type",
    "Timeout",
    "Approximate solution",
    "Exact solution",
    "Crash",
    "Abort",
    "Infeasible",
)
_STATUS_CODES = {
    "verified": _STATUSES.index("Exact solution"),
    "unverified": _STATUSES.index("Approximate solution"),
    "no_path": _STATUSES.index("Timeout"),
    "invalid_start": _STATUSES.index("Invalid start"),
    "invalid_goal": _STATUSES.index("Invalid goal"),
    "failed": _STATUSES.index("Crash"),
}
_PROPERTIES = (
    ("time", "REAL"),
    ("solved", "BOOLEAN"),
    ("status", "ENUM"),
    ("approximate solution", "BOOLEAN"),
    ("correct solution", "BOOLEAN"),
    ("solution length", "REAL"),
    ("solution clearance", "REAL"),
    ("solution deviation", "REAL"),
    ("graph states", "INTEGER"),
    ("iterations", "INTEGER"),
    ("states checked", "INTEGER"),
    ("edges checked", "INTEGER"),
    ("verification time", "REAL"),
    ("repairs", "INTEGER"),
    ("seed", "INTEGER"),
)


def write_ompl_logs(suite: Suite, rows: Sequence[dict[str, Any]], folder: Path) -> list[Path]:
    """Writes a log a scenario: an experiment whose planners are the pairs of planner and shape model.

    Solved means verified by the reference; the length is the tip's way in m. A path that was found but not verified
    counts as approximate, a job that failed as a crash.

    Args:
        suite: The suite.
        rows: From `table.joined_rows`.
        folder: An existing folder.

    Returns:
        The files.
    """
    files = []
    for entry in suite.file.scenarios:
        own = [row for row in rows if row["scenario"] == entry.file]
        if own:
            file = folder / f"ompl_{_slug(entry.file)}.log"
            file.write_text(_format_log(suite, entry.file, entry.difficulty, own), encoding="utf-8")
            files.append(file)
    return files


def _slug(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9.-]+", "_", name.removesuffix(".toml")).strip("_.") or "scenario"


def _format_log(suite: Suite, scenario: str, difficulty: str, rows: list[dict[str, Any]]) -> str:
    limit = next(job.time_limit_s for job in suite.jobs if job.scenario == scenario)
    planners: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        planners.setdefault(f"geometric_{row['planner']}_{row['model']}", []).append(row)
    setup = {"scenario": scenario, "difficulty": difficulty, "suite": suite.title, "suite_sha256": suite.sha256}
    lines = [
        f"OMPL version {version('ompl')}",
        f"Experiment {_slug(scenario)}",
        "1 experiment properties",
        f"difficulty TEXT = {difficulty}",
        f"Running on {platform.node() or 'unknown'}",
        f"Starting at {datetime.now(UTC):%Y-%m-%d %H:%M:%S}",
        "<<<|",
        json.dumps(setup, indent=1),
        "|>>>",
        f"{suite.file.seeds[0]} is the random seed",
        f"{limit:g} seconds per run",
        "0 MB per run",
        f"{len(suite.file.seeds)} runs per planner",
        f"{sum(row['total_s'] or 0.0 for row in rows):.6f} seconds spent to collect the data",
        "1 enum type",
        "|".join(("status", *_STATUSES)),
        f"{len(planners)} planners",
    ]
    for name, runs in planners.items():
        lines += [name, "0 common properties", f"{len(_PROPERTIES)} properties for each run"]
        lines += [f"{label} {kind}" for label, kind in _PROPERTIES]
        lines += [f"{len(runs)} runs", *(_format_run(row) for row in runs), "."]
    return "\n".join(lines) + "\n"


def _format_run(row: dict[str, Any]) -> str:
    values = (
        row["plan_s"],
        row["status"] == "verified",
        _STATUS_CODES[row["status"]],
        row["status"] == "unverified",
        row["status"] == "verified",
        row["tip_travel_m"],
        row["last_clearance_m"],
        row["last_deviation_m"],
        row["vertices"],
        row["iterations"],
        row["states_checked"],
        row["edges_checked"],
        row["verify_s"],
        row["repairs_tried"],
        row["seed"],
    )
    return "".join(f"{_format_value(value)}; " for value in values)


def _format_value(value: Any) -> str:
    if value is None:
        return ""
    return str(int(value)) if isinstance(value, bool) else str(value)
