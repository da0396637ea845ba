"""Running a sweep: what is left to do goes to workers, what comes back goes to the journal."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tdcr_planner.sweep.job import FAILED, run_planning_job
from tdcr_planner.sweep.journal import open_journal
from tdcr_planner.sweep.suite import Suite, SweepJob
from tdcr_planner.workers import Backend, Outcome, WorkersError

# A query ends itself soon after its time limit. One that has not by then, loading included, hangs.
HANG_FACTOR = 5.0
HANG_ADDED_S = 600.0

JobFunction = Callable[[SweepJob], dict[str, Any]]
Progress = Callable[[int, int, str], None]
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SweepOutcome:
    """What a sweep has come to.

    Attributes:
        suite: The suite.
        records: The record of each finished job by its index.
        resumed: How many of them an earlier run had finished.
        interrupted: Why jobs are left; empty when all are finished.
    """

    suite: Suite
    records: dict[int, dict[str, Any]]
    resumed: int
    interrupted: str = ""

    @property
    def complete(self) -> bool:
        """Whether every job is finished."""
        return len(self.records) == len(self.suite.jobs)

    @property
    def failed(self) -> list[SweepJob]:
        """The jobs that ended in an error or crash."""
        return [job for job in self.suite.jobs if self.records.get(job.index, {}).get("status") == FAILED]


def run_sweep(
    suite: Suite,
    folder: str | Path,
    backend: Backend,
    *,
    retry_failed: bool = False,
    progress: Progress | None = None,
    function: JobFunction = run_planning_job,
) -> SweepOutcome:
    """Runs the jobs of a suite that the folder has no record of.

    A job that raises, crashes its process or hangs is recorded as failed, with the reason. Ctrl-C and a lost cluster
    end the run; what had finished by then is in the folder, and the next run goes on from there.

    Args:
        suite: What to run.
        folder: Output folder; holds nothing but this sweep.
        backend: Where the jobs run: `workers.local_backend` or `cluster.dask_backend`.
        retry_failed: Run those again that have failed in an earlier run.
        progress: Told jobs done, jobs in all, and the last one's name and status.
        function: What a job is; importable by name.

    Returns:
        The outcome, complete or interrupted.

    Raises:
        FormatError: The folder cannot be written, holds another sweep, or is in use.
    """
    tell = progress or (lambda *_: None)
    with open_journal(folder, suite) as journal:
        known = {
            index for index, record in journal.records.items() if not (retry_failed and record["status"] == FAILED)
        }
        left = [job for job in suite.jobs if job.index not in known]
        tell(len(known), len(suite.jobs), "")
        interrupted = ""
        longest = max((job.time_limit_s for job in left), default=0.0)
        outcomes = backend(
            function,
            left,
            groups=[job.path for job in left],
            time_limit_s=HANG_FACTOR * longest + HANG_ADDED_S,
        )
        try:
            with contextlib.closing(outcomes):
                for done, outcome in enumerate(outcomes, start=len(known) + 1):
                    job = left[outcome.index]
                    record = _record(outcome)
                    if record["status"] == FAILED:
                        logger.warning("job %d (%s) failed: %s", job.index, job.name, outcome.error)
                    journal.add(job.index, record)
                    tell(done, len(suite.jobs), f"{job.scenario} {record['status']}")
        except KeyboardInterrupt:
            interrupted = "interrupted"
        except WorkersError as error:
            interrupted = str(error)
        return SweepOutcome(suite, dict(journal.records), len(known), interrupted)


def _record(outcome: Outcome) -> dict[str, Any]:
    if outcome.error:
        return {"status": FAILED, "result": {}, "timing": {"message": outcome.error}}
    return dict(outcome.value)
