"""Tolerances: how likely each point is seen along a path when the robot is not quite what its file says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.inspection.answer import Inspection
from tdcr_planner.inspection.scene import make_visibility
from tdcr_planner.query.drawn_robot import draw_robot
from tdcr_planner.query.paths import path_rows
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.query.solved_states import StateSolver
from tdcr_planner.query.tolerances import Tolerances
from tdcr_planner.rates import Rate, binomial_rate

Progress = Callable[[int, int, str], None]

CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class CoverageSpread:
    """What drawn robots see along the same path.

    Attributes:
        tolerances: What was varied.
        seed: Of the draws.
        seen: Which points each drawn robot sees, shape (samples, p).
        areas: Area that each point stands for, shape (p,), m^2.
    """

    tolerances: Tolerances
    seed: int
    seen: BoolArray
    areas: FloatArray

    @property
    def samples(self) -> int:
        """Number of robots drawn."""
        return len(self.seen)

    @property
    def rates(self) -> list[Rate]:
        """How likely each point is seen, with its interval, one a point."""
        return [binomial_rate(int(count), self.samples) for count in self.seen.sum(axis=0)]

    @property
    def shares(self) -> FloatArray:
        """Share of the surfaces that each drawn robot sees, shape (samples,)."""
        return np.asarray(self.seen @ self.areas / self.areas.sum())

    @property
    def sure(self) -> float:
        """Share of the surfaces that 95 % of all such robots see at least, with 95 % confidence.

        The largest order statistic of the drawn shares that is a lower tolerance limit (Wilks 1941); 0 where too few
        robots were drawn for one: 59 are enough.
        """
        ranks = np.arange(1, self.samples + 1)
        # Chance that as many of the robots as a rank says lie below the true 5 % quantile.
        rank = int((binom.sf(ranks - 1, self.samples, 1.0 - CONFIDENCE) >= CONFIDENCE).sum())
        return float(np.sort(self.shares)[rank - 1]) if rank else 0.0


def spread_coverage(
    found: Inspection,
    tolerances: Tolerances | None = None,
    *,
    samples: int = 100,
    seed: int = 1,
    progress: Progress | None = None,
) -> CoverageSpread:
    """Sends an inspection's path through drawn robots, by the Cosserat reference, and looks from each of their states.

    Args:
        found: An inspection with a path.
        tolerances: What to vary and how far; the defaults if None.
        samples: Robots to draw.
        seed: Of the draws.
        progress: Told robots done, robots in all and a remark.

    Raises:
        InputError: There is no path, or samples is below 1.
    """
    if found.plan.path is None:
        raise InputError("found", "an inspection with a path", f"status {found.plan.status.value!r} without one")
    if samples < 1:
        raise InputError("samples", "1 or more", samples)
    tolerances = tolerances or Tolerances()
    session = PlanningSession(found.plan.scenario)
    visibility = make_visibility(session)
    rows = path_rows(session.space, found.plan.path)
    seen = np.zeros((samples, len(visibility.targets)), dtype=np.bool_)
    for sample in range(samples):
        drawn = draw_robot(session, tolerances, (seed, sample))
        states = StateSolver(drawn, session.scene).solve(rows)
        good = states.converged & states.stable
        if good.any():
            seen[sample] = visibility.seen(states.positions[good], states.rotations[good]).any(axis=0)
        if progress is not None:
            progress(sample + 1, samples, f"sees {100 * visibility.targets.share(seen[sample]):.1f} %")
    return CoverageSpread(tolerances, seed, seen, visibility.targets.areas)
