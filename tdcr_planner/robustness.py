"""Robustness: what is left of a path when the robot, its drive and its mount are not quite what the files say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.query.drawn_robot import DrawnRobot, draw_robot
from tdcr_planner.query.paths import path_rows
from tdcr_planner.query.result import PlanResult
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.query.tolerances import Tolerances, tolerances_of
from tdcr_planner.rates import Rate, binomial_rate
from tdcr_planner.robot import refuse_unknown

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Spread:
    """The path's states under many drawn robots.

    Attributes:
        clearance: Least distance of the body from a surface, shape (samples, k), m; negative when it touches, NaN where
            the robot has no stable shape.
        tip_shift: Distance of the tip from where the files have it, shape (samples, k), m; NaN likewise.
    """

    clearance: FloatArray
    tip_shift: FloatArray

    @property
    def least_clearance(self) -> FloatArray:
        """Least clearance along the path, shape (samples,), m; minus infinity where a state has no stable shape."""
        return np.nan_to_num(self.clearance, nan=-np.inf).min(axis=1)

    @property
    def largest_tip_shift(self) -> FloatArray:
        """Largest shift of the tip along the path, shape (samples,), m; infinity where a state has no stable shape."""
        return np.nan_to_num(self.tip_shift, nan=np.inf).max(axis=1)


@dataclass(frozen=True)
class Robustness:
    """How a path fares on robots drawn within tolerances.

    Attributes:
        tolerances: What was varied.
        seed: Of the draws.
        asked: The scenario's clearance_m.
        times: When the path is at each of its states, shape (k,), s.
        nominal: Clearance of the path's states with the robot as the file has it, shape (k,), m.
        spread: The same states on every drawn robot.
        verified: Which of the drawn robots pass the whole verification: stable, clearance kept at and between
            the states, limits, goals reached, shape (samples,).
        causes: How many robots failed for which of `VerificationReport.cause`.
        effects: The spread when one tolerance alone is at work, by its name; those of zero are left out.
    """

    tolerances: Tolerances
    seed: int
    asked: float
    times: FloatArray
    nominal: FloatArray
    spread: Spread
    verified: BoolArray
    causes: dict[str, int]
    effects: dict[str, Spread]

    @property
    def samples(self) -> int:
        """Number of robots drawn."""
        return len(self.verified)

    @property
    def verified_rate(self) -> Rate:
        """Share of the robots for which the path is verified."""
        return binomial_rate(int(self.verified.sum()), self.samples)

    @property
    def collision_free_rate(self) -> Rate:
        """Share of the robots that touch nothing at any state of the path."""
        return binomial_rate(int((self.spread.least_clearance > 0.0).sum()), self.samples)


def assess_robustness(
    result: PlanResult,
    tolerances: Tolerances | None = None,
    *,
    samples: int = 100,
    seed: int = 1,
    progress: Progress | None = None,
) -> Robustness:
    """Sends a result's path, tensions as planned, through robots that differ from the file, by the Cosserat reference.

    Each drawn robot has its own modulus, masses, gains, sizes and base pose, and keeps them along the path: these are
    errors of manufacture and mounting, not noise. What it is commanded stays as planned.

    Args:
        result: A result with a path.
        tolerances: What to vary and how far; those of the scenario, or else the defaults, if None.
        samples: Robots to draw; as many again for each tolerance by itself.
        seed: Of the draws.
        progress: Told robots done, robots in all and a remark.

    Raises:
        InputError: The result has no path, or samples is below 1.
    """
    if result.path is None:
        raise InputError("result", "a result with a path", f"status {result.status.value!r} without one")
    if samples < 1:
        raise InputError("samples", "1 or more", samples)
    refuse_unknown(result.scenario.robot, (), "the robustness analysis")
    tolerances = tolerances_of(result.scenario) if tolerances is None else tolerances.check_fit(result.scenario.robot)
    assessment = _Assessment(result)
    alone = tolerances.varied()
    total = samples * (1 + len(alone))
    outcomes: list[tuple[bool, str]] = []
    spreads: list[Spread] = []
    for number, varied in enumerate([tolerances, *(tolerances.only(name) for name in alone)]):
        states = []
        for sample in range(samples):
            drawn = draw_robot(assessment.session, varied, (seed, number, sample))
            states.append(assessment.states(drawn))
            if number == 0:
                outcomes.append(assessment.verdict(drawn))
            if progress is not None:
                progress(number * samples + sample + 1, total, "all together" if number == 0 else alone[number - 1])
        spreads.append(Spread(*(np.stack(part) for part in zip(*states, strict=True))))
    return Robustness(
        tolerances=tolerances,
        seed=seed,
        asked=result.scenario.required_clearance,
        times=result.path.times,
        nominal=assessment.nominal_clearance,
        spread=spreads[0],
        verified=np.array([verified for verified, _ in outcomes], dtype=np.bool_),
        causes=dict(Counter(cause for verified, cause in outcomes if not verified)),
        effects=dict(zip(alone, spreads[1:], strict=True)),
    )


class _Assessment:
    """A result's path and scene, asked about one drawn robot after the other."""

    def __init__(self, result: PlanResult) -> None:
        assert result.path is not None  # the caller has checked
        query = result.scenario
        self.session = session = PlanningSession(query)
        self._query = query
        self._rows = path_rows(session.space, result.path)
        self._goals = [(state, query.goals[number]) for state, number in result.path.goal_states]
        _, nominal = session.verifier(query).judge_each(self._rows)
        self.nominal_clearance = nominal.clearance
        self._nominal_tips = nominal.positions[:, -1]

    def states(self, drawn: DrawnRobot) -> tuple[FloatArray, FloatArray]:
        """Returns clearance and tip shift of the path's states, shape (k,) each, m; NaN without a stable shape."""
        _, states = drawn.verifier(self.session, self._query).judge_each(self._rows)
        shift = np.linalg.norm(states.positions[:, -1] - self._nominal_tips, axis=1)
        keeps = states.converged & states.stable
        return np.where(keeps, states.clearance, np.nan), np.where(keeps, shift, np.nan)

    def verdict(self, drawn: DrawnRobot) -> tuple[bool, str]:
        """Returns whether the whole path is verified on a drawn robot, and the cause when it is not."""
        report, _ = drawn.verifier(self.session, self._query).verify(self._rows, self._goals)
        return report.verified, report.cause
