"""One job of a sweep: a query planned and verified, as a record of plain values."""

from __future__ import annotations

import hashlib
import os
import platform
import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from tdcr_planner.errors import FormatError
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.sweep.suite import SweepJob

if TYPE_CHECKING:
    from tdcr_planner.query.result import PlanResult
    from tdcr_planner.query.session import PlanningSession

FAILED = "failed"
# OMPL's random generator belongs to the process: a worker that has several threads takes one job at a time.
_ONE_AT_A_TIME = threading.Lock()
_sessions: dict[tuple[str, str], PlanningSession] = {}


def run_planning_job(job: SweepJob) -> dict[str, Any]:
    """Plans and verifies one query and returns its record; see `record_of`.

    The scene, its fields and the models are kept for the next job of the same scenario. Nothing else is: validity
    caches, planner and random numbers start anew with each query.

    Raises:
        FormatError: The scenario file is not the one that the sweep was made for.
    """
    with _ONE_AT_A_TIME:
        session = _session(job)
        own = session.scenario.planner
        changes: dict[str, Any] = {
            "name": job.planner,
            "validity": job.model,
            "seed": job.seed,
            "time_limit_s": job.time_limit_s,
        }
        if job.planner != own.name:
            # The scenario's parameters are those of its own planner.
            changes["parameters"] = {}
        query = session.scenario.with_planner(**changes)
        return record_of(session.plan(query))


def _session(job: SweepJob) -> PlanningSession:
    from tdcr_planner.query.session import PlanningSession

    key = (job.path, job.sha256)
    if key not in _sessions:
        scenario = load_scenario(job.path)
        if scenario.sha256 != job.sha256:
            raise FormatError(job.path, "has changed since the sweep began, or is another file on this machine")
        _sessions.clear()
        _sessions[key] = PlanningSession(scenario.with_planner(validity=job.model))
    return _sessions[key]


def record_of(result: PlanResult) -> dict[str, Any]:
    """Returns what a sweep keeps of a result.

    Returns:
        status; result: what the seed decides, for a verified path that the time sufficed for; timing: what the clock
        decides too. When a query is ended by its time limit, the clock decides how far it had come by then.
    """
    from tdcr_planner.query.result import PlanStatus

    path, report = result.path, result.verification
    worst = {} if report is None else report.worst
    travelled = {}
    if result.status is PlanStatus.VERIFIED and path is not None:
        travelled = {
            "repairs": result.repairs,
            "states": len(path),
            "tip_travel_m": path.tip_travel,
            "duration_s": float(path.times[-1]),
            "clearance_m": _finite(worst.get("clearance_m")),
            "deviation_m": _finite(worst.get("deviation_m")),
            "residual_nm": _finite(worst.get("residual_nm")),
            "path_sha256": _digest(path.bending, path.insertion, path.roll),
        }
    counts = ("iterations", "vertices", "states_checked", "edges_checked")
    return {
        "status": result.status.value,
        "result": travelled,
        "timing": {
            **{f"{name}_s": float(value) for name, value in result.timings_s.items() if name != "load"},
            **{name: result.planner.get(name) for name in counts},
            "rejected": dict(result.planner.get("rejected", {})),
            "repairs_tried": result.repairs,
            "last_clearance_m": _finite(worst.get("clearance_m")),
            "last_deviation_m": _finite(worst.get("deviation_m")),
            "message": result.message,
            "worker": f"{platform.node()}:{os.getpid()}",
        },
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def _digest(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()
