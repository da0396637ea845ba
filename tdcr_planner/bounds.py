"""The bounds of numbers that files and options state: beyond each, a number is a slip or cannot be worked with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from tdcr_planner.errors import InputError

Number = TypeVar("Number", int, float)


@dataclass(frozen=True)
class Bound:
    """A range of a number, ends included, and why it ends there.

    Attributes:
        low: Smallest value.
        high: Largest value.
        reason: Why it is no larger.
    """

    low: float
    high: float
    reason: str

    def check(self, name: str, value: Number) -> Number:
        """Returns an argument's value, or raises InputError."""
        if not self.low <= value <= self.high:
            raise InputError(name, str(self), value)
        return value

    def validate(self, value: Number) -> Number:
        """The same for a field of a file: raises ValueError, as pydantic has it."""
        if not self.low <= value <= self.high:
            raise ValueError(f"expected {self}, got {value:.6g}")
        return value

    def __str__(self) -> str:
        return f"{self.low:.10g} to {self.high:.10g} ({self.reason})"


SEED = Bound(0, 2**63 - 1, "random generators take 63 bits")
SEARCH_SEED = Bound(1, 2**31 - 1, "OMPL's generator takes 31 bits, and 0 means none")
TIME_S = Bound(1e-3, 604_800, "a week")
PORT = Bound(0, 65_535, "ports have 16 bits; 0 for any free one")
PROCESSES = Bound(1, 1_024, "more than a machine has processors")
SAMPLES = Bound(1, 10_000_000, "hours of the reference, and gigabytes of shapes")
EVALUATION_SAMPLES = Bound(10, 10_000_000, SAMPLES.reason)
ROBOTS = Bound(1, 100_000, "days of the reference")
QUERIES = Bound(0, 10_000, "days of planning")
REFINEMENT = Bound(1, 1_000, "a thousandth of a step is below the reference's own tolerance")
VERTICES = Bound(1, 10_000_000, "hours of building, and gigabytes of motions")
JOBS = Bound(1, 100_000, "a day at a second each")
CASES = Bound(1, 20_000_000, "hours of the reference, and tens of gigabytes of shapes")
EPOCHS = Bound(1, 1_000_000, "weeks of training")
POINTS = Bound(1, 1_000_000, "gigabytes of numbers in one step of a training")
CELLS = Bound(8, 2_000_000, "gigabytes of configurations")
GRID = Bound(1, 1_000, "the grid's three sides multiply")
LEARNING_RATE = Bound(0, 10, "steps larger than the weights")
PLACE_M = Bound(-1e7, 1e7, "the Earth's radius; beyond it, places a few nanometres apart are the same number")
ANGLE_DEG = Bound(-1e6, 1e6, "thousands of turns")
LOAD = Bound(-1e9, 1e9, "far beyond what breaks any robot")
STRETCHES = Bound(2, 100, "each is a fit of its own")
