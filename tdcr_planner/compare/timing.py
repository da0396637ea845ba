"""What a verdict costs: microseconds a state by each shape model, on the same states and in one process."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compare.verdicts import MODELS
from tdcr_planner.planning.scenario import Validity
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.shape.reference import ReferenceShape

_ROUNDS = 5


@dataclass(frozen=True)
class CheckTime:
    """Time of one shape model, medians over rounds in which the models take turns.

    Attributes:
        model: The shape model.
        batch: States a call.
        shape_us: For the disk poses in the world frame, us a state.
        check_us: For the whole verdict with the margins of planning, us a state.
    """

    model: Validity
    batch: int
    shape_us: float
    check_us: float


def measure_times(
    session: PlanningSession, rows: FloatArray, models: Sequence[Validity] = MODELS
) -> tuple[CheckTime, ...]:
    """Returns the time a verdict takes with each shape model and the reference, all rows (n, dimension) in one call."""
    timed = tuple(dict.fromkeys((*models, ReferenceShape.name)))
    checkers = {name: session.checker(session.scenario.with_planner(validity=name)) for name in timed}
    spent: dict[tuple[Validity, str], list[float]] = {}
    for _ in range(_ROUNDS):
        for name, checker in checkers.items():
            for kind, call in (("shape", checker.world_poses), ("check", checker.check)):
                spent.setdefault((name, kind), []).append(_seconds(call, rows))
    micro = {key: 1e6 * float(np.median(times)) / len(rows) for key, times in spent.items()}
    return tuple(CheckTime(name, len(rows), micro[name, "shape"], micro[name, "check"]) for name in timed)


def _seconds(call: Callable[[FloatArray], Any], rows: FloatArray) -> float:
    begin = time.perf_counter()
    call(rows)
    return time.perf_counter() - begin
