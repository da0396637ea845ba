"""Shares with confidence intervals, and quantiles: the statistics that comparisons and sweeps report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import binomtest

from tdcr_planner.errors import InputError

CONFIDENCE = 0.95
QUANTILES = {"p10": 0.1, "p25": 0.25, "median": 0.5, "p75": 0.75, "p90": 0.9, "p99": 0.99, "max": 1.0}


@dataclass(frozen=True)
class Rate:
    """A share of independent trials with an interval for the probability behind it.

    Attributes:
        count: Trials in which it happened.
        total: Trials.
        low: Lower end of the interval; 0 without trials.
        high: Upper end of the interval; 1 without trials.
    """

    count: int
    total: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share itself; NaN without trials."""
        return self.count / self.total if self.total else float("nan")

    def as_dict(self) -> dict[str, float | int | None]:
        """Returns the rate as what a result file holds; the value is None without trials."""
        value = self.value if self.total else None
        return {"count": self.count, "total": self.total, "value": value, "low": self.low, "high": self.high}

    def __str__(self) -> str:
        if not self.total:
            return "no trials"
        return f"{100 * self.value:.3g} % [{100 * self.low:.3g}, {100 * self.high:.3g}] ({self.count} of {self.total})"


def binomial_rate(count: int, total: int, confidence: float = CONFIDENCE) -> Rate:
    """Returns a share with the interval of Clopper and Pearson (1934).

    The interval is the exact one: whatever the probability, it covers it at least as often as `confidence` says, also
    for counts of zero, where the intervals of Wald and Wilson fall short. It pays with being somewhat too wide.

    Args:
        count: Trials in which it happened, 0 to total.
        total: Independent trials.
        confidence: Probability of covering, two-sided.

    Raises:
        InputError: The count is not between 0 and total, or the confidence not between 0 and 1.
    """
    count, total = int(count), int(total)
    if not 0 <= count <= total:
        raise InputError("count", f"0 to {total}", count)
    if not 0.0 < confidence < 1.0:
        raise InputError("confidence", "a number between 0 and 1", confidence)
    if not total:
        return Rate(0, 0, 0.0, 1.0)
    interval = binomtest(count, total).proportion_ci(confidence, method="exact")
    return Rate(count, total, float(interval.low), float(interval.high))


def ratio_at_least(numerator: Rate, denominator: Rate, confidence: float = CONFIDENCE) -> float:
    """Returns a lower bound on the ratio of two probabilities.

    The two rates may come from the same trials: with each bound at half the error probability, both hold together at
    least as often as `confidence` says, whatever the dependence (Bonferroni).

    Args:
        numerator: The rate above.
        denominator: The rate below.
        confidence: Probability, one-sided, that the true ratio is at least the bound.
    """
    # A two-sided interval misses on each side with at most (1 - confidence) / 2: two such sides make up the whole.
    above = binomial_rate(numerator.count, numerator.total, confidence)
    below = binomial_rate(denominator.count, denominator.total, confidence)
    return above.low / below.high


def quantiles(values: ArrayLike) -> dict[str, float | int | None]:
    """Returns count, mean and quantiles of the finite values by name; None where there are none."""
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return {"count": 0, "mean": None, **dict.fromkeys(QUANTILES)}
    levels = np.quantile(finite, list(QUANTILES.values()))
    return {
        "count": len(finite),
        "mean": float(finite.mean()),
        **{name: float(level) for name, level in zip(QUANTILES, levels, strict=True)},
    }
