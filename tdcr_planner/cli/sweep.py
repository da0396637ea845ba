"""tdcr sweep: scenarios x planners x models x seeds, resumable, on this machine or on a Dask cluster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from tdcr_planner.sweep.runner import SweepOutcome


def sweep(
    suite: tyro.conf.Positional[Path],
    *,
    out: Path,
    jobs: int | None = None,
    scheduler: str | None = None,
    retry_failed: bool = False,
    progress: bool = True,
) -> int:
    """Plan every combination of a suite's scenarios, planners, models and seeds and report success, time and length.

    Example: tdcr sweep scenes/benchmark.toml --out out/benchmark --jobs 2

    Each query runs in a process of its own and is recorded as it finishes: the same command goes on where an earlier
    run was ended. A query that fails or crashes is recorded and ends nothing. Writes results.csv, timings.csv,
    summary.json, summary.md, plots and OMPL benchmark logs (for ompl_benchmark_statistics and Planner Arena).

    Exit code 0 when all queries ran, 1 when some failed or are left.

    Args:
        suite: Suite file.
        out: Folder of this sweep and no other.
        jobs: Queries at a time on this machine; the number of its processors without it.
        scheduler: Address of a Dask scheduler whose workers run the queries instead, such as tcp://127.0.0.1:8786.
        retry_failed: Run queries again that failed in an earlier run.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    from tdcr_planner.cli.backend import choose_backend
    from tdcr_planner.cli.cost import tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import CountBar
    from tdcr_planner.report.sweep_results import draw_sweep, write_sweep_data
    from tdcr_planner.sweep.runner import run_sweep
    from tdcr_planner.sweep.suite import load_suite
    from tdcr_planner.workers import local_backend, usable_cpus

    backend = choose_backend(jobs, scheduler) or local_backend(usable_cpus())
    content = load_suite(suite)
    processes = 1 if scheduler is not None else jobs or usable_cpus()
    tell_cost("suite, at its time limits", sum(job.time_limit_s for job in content.jobs) / processes)
    with CountBar("sweep", shown=progress) as bar:
        outcome = run_sweep(content, out, backend, retry_failed=retry_failed, progress=bar.update)
    write_sweep_data(outcome, out)
    print(describe(outcome))
    print(f"files:    {out}/summary.md summary.json results.csv timings.csv", flush=True)
    drawn = draw_after("the report", lambda: draw_sweep(outcome, out))
    if drawn:
        print(f"plots:    {out}/{' '.join(name for name in drawn if name.endswith('.png'))}")
    return 0 if outcome.complete and not outcome.failed else 1


def describe(outcome: SweepOutcome) -> str:
    """Returns a sweep's outcome as a few lines for a terminal."""
    from tdcr_planner.sweep.table import group_rows, joined_rows

    total, finished = len(outcome.suite.jobs), len(outcome.records)
    lines = [f"finished: {finished} of {total} jobs, {outcome.resumed} of them in an earlier run"]
    if not outcome.complete:
        lines.append(f"          {outcome.interrupted}; what had finished is kept, the same command goes on from there")
    if outcome.failed:
        job = outcome.failed[0]
        message = outcome.records[job.index]["timing"]["message"]
        lines.append(f"failed:   {len(outcome.failed)} jobs, the first {job.name}: {message}")
    for group in group_rows(joined_rows(outcome), ("planner", "model")):
        rate, median = group["verified"], group["quantiles"]["plan_s"]["median"]
        time = "" if median is None else f", median planning time {median:.2f} s"
        others = "".join(f", {count} {name}" for name, count in group["statuses"].items() if name != "verified")
        lines.append(
            f"verified: {group['planner']}, {group['model']}: {rate['count']} of {rate['total']} "
            f"({100 * rate['low']:.0f} to {100 * rate['high']:.0f} %){others}{time}"
        )
    return "\n".join(lines)
