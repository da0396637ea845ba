"""Stands in for planning jobs: what a worker process imports when a test gives it one of these."""

import os
import signal
import time
from pathlib import Path


def record(status="verified", **timing):
    return {"status": status, "result": {"repairs": 0, "tip_travel_m": 0.1}, "timing": {"plan_s": 0.5, **timing}}


def succeed(job):
    return record(total_s=0.5 + 0.01 * job.index)


def misbehave(job):
    """Raises for seed 2, dies of a segmentation fault for seed 3, succeeds otherwise."""
    if job.seed == 2:
        raise ValueError("no such luck")
    if job.seed == 3:
        os.kill(os.getpid(), signal.SIGSEGV)
    return succeed(job)


def log_run(job):
    """Leaves a line in a file beside the scenario, takes a while, and succeeds."""
    with (Path(job.path).parent / "runs.txt").open("a") as stream:
        stream.write(f"{job.index}\n")
    time.sleep(0.15)
    return succeed(job)


def wait_for_ctrl_c(job):
    """Succeeds for the first two jobs; the third sends Ctrl-C to the parent and never ends."""
    if job.index == 2:
        os.kill(os.getppid(), signal.SIGINT)
        time.sleep(600.0)
    return succeed(job)


def straight_line(scenario, space, checker, *, time_limit_s, seed):
    """A planner of one's own: the straight line to a goal that is a configuration, if it is free."""
    import numpy as np

    from tdcr_planner.planning.edges import EdgeChecker
    from tdcr_planner.planning.planner import SearchOutcome, SearchStatus

    start, (goal,) = scenario.file.start, scenario.goals
    rows = np.stack([space.row(start.bending_n), space.row(goal.bending_n)])
    if not EdgeChecker(checker, scenario.planner.step_m).path_valid(rows):
        return SearchOutcome(SearchStatus.NO_PATH, "the straight line is not free")
    return SearchOutcome(SearchStatus.FOUND, "a straight line", rows, goals=(1,), order=(0,))
