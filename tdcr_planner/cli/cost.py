"""The cost of a command that takes hours or gigabytes, told before it starts."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tdcr_planner.errors import InputError

if TYPE_CHECKING:
    from tdcr_planner.learning.settings import TrainSettings
    from tdcr_planner.robot import RobotSpec

# What is told: longer than a coffee, or larger than what programs beside this one leave.
_TOLD_S = 1_800.0
_TOLD_BYTES = 2e9

_LEARNED_S = 1.5e-5  # of one case in one epoch

REFERENCE_S = 3e-4
"""Of one shape by the reference, on one processor."""
SHAPE_BYTES = 400.0
"""Of one disk of one shape: position and rotation, by the reference and by a model, and copies on the way."""


def tell_cost(name: str, seconds: float, memory_bytes: float = 0.0) -> None:
    """Prints how long a command will take and how much memory it needs, where either is much.

    Args:
        name: The option or key that decides it, for messages.
        seconds: Estimate of the time.
        memory_bytes: Estimate of the memory.

    Raises:
        InputError: The machine has less memory.
    """
    available = available_memory()
    if memory_bytes > available:
        raise InputError(
            name,
            f"what fits into this machine's memory, {available / 1e9:.2g} GB of which are free",
            f"what needs about {memory_bytes / 1e9:.2g} GB",
        )
    if seconds > _TOLD_S or memory_bytes > _TOLD_BYTES:
        memory = f" and {memory_bytes / 1e9:.1f} GB of memory" if memory_bytes > 1e8 else ""
        print(f"{name}: this takes about {describe_duration(seconds)}{memory}; Ctrl-C ends it", file=sys.stderr)


def training_cost(robot: RobotSpec, settings: TrainSettings) -> tuple[float, float]:
    """Returns about how many seconds of a processor and bytes of memory a training takes."""
    judged = 4 * settings.bound.cases
    if settings.network == "paper":
        paper = settings.paper
        points = math.prod(paper.grid)
        # Points along the shapes whose length is measured come on top of each step's collocation points.
        step = paper.batch_size + paper.arc_points * paper.arc_actuations
        learned, cases = paper.epochs * -(-points // paper.batch_size) * step, math.prod(paper.reference_grid)
        memory = points * 100.0 + step * 8.0 * sum(paper.hidden) * 40.0
    else:
        cases = settings.dataset.cases + settings.dataset.validation_cases
        learned, memory = settings.optimiser.epochs * cases, 0.0
    memory += (cases + judged) * robot.disk_count * SHAPE_BYTES
    return (cases + judged) * REFERENCE_S + learned * _LEARNED_S, memory


def describe_duration(seconds: float) -> str:
    """Returns a duration for a person: minutes, hours or days."""
    for unit, length in (("days", 86_400.0), ("hours", 3_600.0)):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(seconds / 60.0, 1.0):.0f} minutes"


def available_memory() -> float:
    """Returns the bytes that programs can still take; infinity where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return float("inf")
    found = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return 1024.0 * int(found[0]) if found else float("inf")
