"""The files of a sweep: tables, summary, plots and benchmark logs, from whatever jobs have finished."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tdcr_planner.files import sha256_of_file, write_folder_whole
from tdcr_planner.query.result import PlanStatus, library_versions
from tdcr_planner.report.drawing import draw_pictures
from tdcr_planner.report.ompl_log import write_ompl_logs
from tdcr_planner.report.sweep_plots import sweep_drawings
from tdcr_planner.report.tables import Row, format_markdown, write_csv, write_parquet
from tdcr_planner.report.text import markdown_text
from tdcr_planner.sweep.job import FAILED
from tdcr_planner.sweep.runner import SweepOutcome
from tdcr_planner.sweep.table import (
    GROUPINGS,
    RESULT_COLUMNS,
    TIMING_COLUMNS,
    group_rows,
    joined_rows,
    result_rows,
    timing_rows,
)

SUMMARY_FORMAT = "tdcr-sweep-summary/1"
# Columns of summary.md for the jobs that are not verified, and the statuses that each counts.
ENDINGS = {
    "unverified": (PlanStatus.UNVERIFIED,),
    "no path": (PlanStatus.NO_PATH,),
    "invalid": (PlanStatus.INVALID_START, PlanStatus.INVALID_GOAL),
    "failed": (FAILED,),
}


def write_sweep(outcome: SweepOutcome, folder: str | Path) -> Path:
    """Writes the report of a sweep beside its journal, all of its files or none, then draws its plots.

    Args:
        outcome: What has finished.
        folder: The sweep's output folder. Files of an earlier report are replaced.

    Returns:
        The path of summary.json.

    Raises:
        FormatError: The folder cannot be written. A plot that cannot be drawn is a warning.
    """
    file = write_sweep_data(outcome, folder)
    draw_sweep(outcome, folder)
    return file


def write_sweep_data(outcome: SweepOutcome, folder: str | Path) -> Path:
    """Writes the numbers of a sweep, all files or none; returns the path of summary.json.

    results.csv (what the seeds decide, the same whichever workers ran it), timings.csv, results.parquet with the
    columns of both where pyarrow is installed, summary.json, summary.md, and a benchmark log a scenario, named
    ompl_<scenario>.log.

    Raises:
        FormatError: The folder cannot be written.
    """
    rows = joined_rows(outcome)
    columns = (*RESULT_COLUMNS, *(name for name in TIMING_COLUMNS if name not in RESULT_COLUMNS))
    with write_folder_whole(folder, last="summary.json") as staging:
        write_csv(result_rows(outcome), RESULT_COLUMNS, staging / "results.csv")
        write_csv(timing_rows(outcome), TIMING_COLUMNS, staging / "timings.csv")
        write_parquet(rows, columns, staging / "results.parquet")
        write_ompl_logs(outcome.suite, rows, staging)
        (staging / "summary.md").write_text(format_summary(outcome, rows), encoding="utf-8")
        content = summary_content(outcome, rows)
        content["results_sha256"] = sha256_of_file(staging / "results.csv")
        text = json.dumps(content, indent=1, allow_nan=False)
        (staging / "summary.json").write_text(text + "\n", encoding="utf-8")
    return Path(folder) / "summary.json"


def draw_sweep(outcome: SweepOutcome, folder: str | Path) -> list[str]:
    """Draws the plots of a sweep as PNG and PDF and returns the names of those that were drawn.

    A plot that cannot be drawn is a warning that names it.
    """
    return draw_pictures(folder, sweep_drawings(outcome.suite, joined_rows(outcome)))


def summary_content(outcome: SweepOutcome, rows: Sequence[Row]) -> dict[str, Any]:
    """Returns the content of summary.json but for the hash of results.csv."""
    suite = outcome.suite
    return {
        "format": SUMMARY_FORMAT,
        "suite": suite.title,
        "suite_file": str(suite.path),
        "suite_sha256": suite.sha256,
        "versions": library_versions(),
        "jobs": len(suite.jobs),
        "finished": len(outcome.records),
        "complete": outcome.complete,
        "interrupted": outcome.interrupted,
        "failed": [
            {"job": job.index, "name": job.name, "message": outcome.records[job.index]["timing"]["message"]}
            for job in outcome.failed
        ],
        "result_columns": list(RESULT_COLUMNS),
        "timing_columns": list(TIMING_COLUMNS),
        "groups": {"_".join(by): group_rows(rows, by) for by in GROUPINGS},
    }


def format_summary(outcome: SweepOutcome, rows: Sequence[Row]) -> str:
    """Returns the summary as Markdown: a table by planner and model, by difficulty, and by scenario."""
    suite = outcome.suite
    state = "" if outcome.complete else f" (incomplete: {outcome.interrupted or 'jobs are left'})"
    parts = [f"# {markdown_text(suite.title)}\n\n{len(outcome.records)} of {len(suite.jobs)} jobs{state}\n"]
    for by in reversed(GROUPINGS):
        header = [*by, "jobs", "verified", "95 % interval", *ENDINGS, "plan s", "p90", "tip travel mm"]
        body = [
            [*(markdown_text(str(group[name])) for name in by), *_summary_cells(group)]
            for group in _ordered(suite, group_rows(rows, by))
        ]
        parts.append(format_markdown(header, body))
    parts.append(
        "Verified and the columns from unverified to failed add up to the jobs; invalid counts those that ended "
        "invalid_start or invalid_goal.\n"
    )
    parts.append(
        "Times and lengths are medians over the verified paths, p90 the 90th percentile of the planning time.\n"
    )
    return "\n".join(parts)


def _ordered(suite: Any, groups: list[Row]) -> list[Row]:
    """Puts groups by difficulty into the order of the levels."""
    if groups and "difficulty" in groups[0]:
        return sorted(groups, key=lambda group: suite.difficulties.index(group["difficulty"]))
    return groups


def _summary_cells(group: Row) -> list[str]:
    verified, spread = group["verified"], group["quantiles"]
    return [
        str(group["jobs"]),
        f"{verified['count']} ({100 * verified['value']:.0f} %)",
        f"{100 * verified['low']:.0f} to {100 * verified['high']:.0f} %",
        *(str(sum(group["statuses"].get(status, 0) for status in ending)) for ending in ENDINGS.values()),
        _cell(spread["plan_s"]["median"]),
        _cell(spread["plan_s"]["p90"]),
        _cell(spread["tip_travel_m"]["median"], 1e3, 0),
    ]


def _cell(value: float | None, factor: float = 1.0, digits: int = 2) -> str:
    return "" if value is None else f"{factor * value:.{digits}f}"
