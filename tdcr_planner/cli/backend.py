"""The options --jobs and --scheduler: where a command's jobs run."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tdcr_planner.workers import Backend


def choose_backend(jobs: int | None, scheduler: str | None, *, losses: int = 0) -> Backend | None:
    """Returns the backend that the options ask for; None when neither is given.

    Args:
        jobs: Worker processes on this machine.
        scheduler: Address of a Dask scheduler.
        losses: How often a job whose process on this machine died is given to another one.

    Raises:
        InputError: Both are given, a number of processes that no machine has, or dask.distributed is not installed.
    """
    from tdcr_planner.bounds import PROCESSES
    from tdcr_planner.cluster import dask_backend
    from tdcr_planner.errors import InputError
    from tdcr_planner.workers import local_backend

    if jobs is not None and scheduler is not None:
        raise InputError("--jobs", "only one of --jobs and --scheduler", "both")
    if jobs is not None:
        PROCESSES.check("--jobs", jobs)
    if scheduler is not None:
        return dask_backend(scheduler)
    return None if jobs is None else local_backend(jobs, losses=losses)
