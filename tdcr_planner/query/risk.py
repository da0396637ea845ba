"""Stated risk: plan again with margin where drawn robots come too near, until fresh robots show the asked probability.

Robots that shape a path never judge it: each judgement draws robots of its own. A judgement ends after few robots
where few fail, and goes on with more where some do. The share is compared with what is asked at most
`MOST_JUDGEMENTS` times within a query; so that the chance to be wrong is that of one 95 % interval all together, each
interval has its part of the 5 % (Bonferroni).
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.planner import Progress
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.answer import answer_query
from tdcr_planner.query.drawn_robot import draw_robot
from tdcr_planner.query.environment import Environment
from tdcr_planner.query.paths import path_rows
from tdcr_planner.query.result import PlanResult, PlanStatus
from tdcr_planner.query.tolerances import Tolerances, tolerances_of
from tdcr_planner.rates import CONFIDENCE, Rate, binomial_rate

MOST_ROUNDS = 8
MOST_JUDGEMENTS = 3
SHAPING_ROBOTS = 30
FAILURES_ALLOWED = (2, 8)
"""Of the robots that judge, in the short and in the long judgement: the more may fail, the more robots are needed."""
_MOST_STALLS = 2  # rounds whose robots fail for other reasons than clearance, where margin is of no help
_DIAGNOSED = 10  # failing robots of which each tolerance is taken away to see which helps
_LEAST_GROWTH_M = 1e-4
_LOOK_M = 0.01  # clearance beyond what is required that is told apart
# Streams of the random generator: robots that shape, and those of each judgement.
_SHAPING, _JUDGING = 0, 1

logger = logging.getLogger(__name__)


def robots_needed(asked: float, failures: int, confidence: float) -> int:
    """Returns the least number of robots whose interval reaches a probability with a number of failures."""
    low, high = failures + 1, failures + 2
    while binomial_rate(high - failures, high, confidence).low < asked:
        low, high = high, 2 * high
    while low < high:
        middle = (low + high) // 2
        if binomial_rate(middle - failures, middle, confidence).low < asked:
            low = middle + 1
        else:
            high = middle
    return high


@dataclass
class _Shaped:
    """A path on the robots that shape it.

    Attributes:
        failing: Seeds of the robots on which it is not verified.
        causes: The causes of those.
        room: Least distance of each disk and the gap before it from a surface, shape (robots, d), m.
    """

    failing: list[tuple[int, ...]] = field(default_factory=list)
    causes: Counter[str] = field(default_factory=Counter)
    room: list[FloatArray] = field(default_factory=list)


@dataclass
class _Candidate:
    """A verified path with what is known of it."""

    result: PlanResult
    shaped: _Shaped
    margins: FloatArray
    rate: Rate | None = None


class _RiskSearch:
    """The rounds of one query."""

    def __init__(self, environment: Environment, query: Scenario, progress: Progress | None) -> None:
        assert query.planner.success_probability is not None  # the caller has looked
        self._environment, self._query, self._progress = environment, query, progress
        self._asked = query.planner.success_probability
        self.tolerances = tolerances_of(query)
        self._confidence = 1.0 - (1.0 - CONFIDENCE) / MOST_JUDGEMENTS
        self._judges = robots_needed(self._asked, FAILURES_ALLOWED[0], self._confidence)
        self._deadline = time.monotonic() + query.planner.time_limit_s
        self._robot_s = 0.0
        self._judged = 0
        self.rounds = 0
        self.plan_s, self.verify_s = 0.0, 0.0

    def run(self) -> tuple[PlanResult, dict[str, Any] | None]:
        """Returns the best path found and what is known of its risk; None for the latter without a verified path."""
        margins, best = np.zeros(self._query.robot.disk_count), None
        kept, refused, stalls = margins, 0, 0
        while self.rounds < MOST_ROUNDS and self._judged < MOST_JUDGEMENTS:
            result = self._plan(margins)
            if result.status is not PlanStatus.VERIFIED:
                if best is None:
                    return result, None
                # More margin than the scene has room for: half of what was added.
                refused += 1
                margins = 0.5 * (margins + kept)
                if refused > 2 or not self._has_time():
                    break
                continue
            candidate = _Candidate(result, self._shape(result), margins)
            kept = margins
            if best is None or len(candidate.shaped.failing) <= len(best.shaped.failing):
                best = candidate
            if self._promises(candidate.shaped):
                candidate.rate = self._judge(candidate)
                if candidate.rate.low >= self._asked:
                    return result, self._content(candidate, "")
            if not self._has_time():
                break
            growth = self._growth(candidate.shaped)
            stalls += not growth.any()
            if stalls > _MOST_STALLS:
                break
            margins = margins + growth
        assert best is not None  # the first round has returned or set it
        if best.rate is None and self._judged < MOST_JUDGEMENTS:
            best.rate = self._judge(best)
            if best.rate.low >= self._asked:
                return best.result, self._content(best, "")
        return best.result, self._content(best, self._limiting(best))

    def _left(self) -> float:
        return self._deadline - time.monotonic()

    def _has_time(self) -> bool:
        """Whether another round and its judgement fit into the time."""
        return self._left() > self._robot_s * (self._judges + SHAPING_ROBOTS)

    def _plan(self, margins: FloatArray) -> PlanResult:
        reserve = self._robot_s * (self._judges + SHAPING_ROBOTS) if self.rounds else 0.5 * self._left()
        limit = max(self._left() - reserve, 0.05 * self._query.planner.time_limit_s, 0.01)
        settings = self._query.planner
        part = self._query.with_planner(
            time_limit_s=limit, seed=1 + (settings.seed - 1 + 97 * self.rounds) % (2**31 - 1)
        )
        self.rounds += 1
        found = answer_query(self._environment, part, margins=margins, progress=self._progress)
        self.plan_s += found.timings_s["plan"]
        self.verify_s += found.timings_s["verify"]
        return found

    def _holds(self, result: PlanResult, tolerances: Tolerances, seed: tuple[int, ...]) -> tuple[str, Any]:
        """Returns why a path fails on a drawn robot, "" if it does not, and its solved states."""
        assert result.path is not None  # it is verified
        drawn = draw_robot(self._environment, tolerances, (self._query.planner.seed, *seed), self._query)
        goals = [(state, self._query.goals[number]) for state, number in result.path.goal_states]
        rows = path_rows(self._environment.space, result.path)
        begin = time.monotonic()
        report, states = drawn.verifier(self._environment, self._query, measure=False).verify(rows, goals)
        spent = time.monotonic() - begin
        self.verify_s += spent
        self._robot_s = spent if self._robot_s == 0.0 else 0.9 * self._robot_s + 0.1 * spent
        return report.cause, states

    def _shape(self, result: PlanResult) -> _Shaped:
        shaped, scene = _Shaped(), self._environment.scene
        disks, most = self._query.robot.disk_count, self._query.required_clearance + _LOOK_M
        for number in range(SHAPING_ROBOTS):
            if self._left() <= 0.0:
                break
            seed = (_SHAPING, number)
            cause, states = self._holds(result, self.tolerances, seed)
            if cause:
                shaped.failing.append(seed)
                shaped.causes[cause] += 1
            solved = states.converged
            if solved.any():
                rooms = scene.part_rooms(states.positions[solved], states.rotations[solved], most).min(axis=0)
                # Parts come tip first, a disk and the gap before it; the shaft counts with the base.
                pairs = rooms[: 2 * (disks - 1)].reshape(-1, 2).min(axis=1)
                shaped.room.append(np.concatenate([[most], pairs[::-1]]))
        logger.info("round %d: %d of %d robots fail", self.rounds, len(shaped.failing), SHAPING_ROBOTS)
        return shaped

    def _promises(self, shaped: _Shaped) -> bool:
        """Whether the robots that shaped a path leave it likely that fresh ones confirm it."""
        return len(shaped.failing) <= (1.0 - self._asked) * SHAPING_ROBOTS

    def _growth(self, shaped: _Shaped) -> FloatArray:
        """Returns what to add to each disk's margin, shape (d,), m: what the low percentile of clearance lacks."""
        if not shaped.room:
            return np.zeros(self._query.robot.disk_count)
        level = max(0.5 * (1.0 - self._asked), 0.0)
        low = np.quantile(np.stack(shaped.room), level, axis=0, method="lower")
        lacking = np.maximum(self._query.required_clearance - low, 0.0)
        if not lacking.any() and shaped.causes["clearance"]:
            lacking[low == low.min()] = _LEAST_GROWTH_M
        return np.asarray(np.where(lacking > 0.0, lacking + _LEAST_GROWTH_M, 0.0))

    def _judge(self, candidate: _Candidate) -> Rate:
        """Returns for how many fresh robots a path is verified; it ends once the asked share is out of reach.

        Those that fail join the robots of which is told what they fail for.
        """
        stream = self._judged
        verified = drawn = 0
        rate = binomial_rate(0, 0, self._confidence)
        for allowed in FAILURES_ALLOWED[: MOST_JUDGEMENTS - self._judged]:
            self._judged += 1
            robots = robots_needed(self._asked, allowed, self._confidence)
            while drawn < robots and drawn - verified <= allowed and self._left() > 0.0:
                seed = (_JUDGING, stream, drawn)
                cause, _ = self._holds(candidate.result, self.tolerances, seed)
                drawn += 1
                verified += not cause
                if cause:
                    candidate.shaped.failing.append(seed)
                    candidate.shaped.causes[cause] += 1
            rate = binomial_rate(verified, drawn, self._confidence)
            if rate.low >= self._asked or not self._has_time():
                break
        return rate

    def _limiting(self, candidate: _Candidate) -> str:
        """Returns the tolerance without which most of the failing robots would pass; "" where none helps."""
        failing = candidate.shaped.failing[:_DIAGNOSED]
        rescued: Counter[str] = Counter()
        for seed in failing:
            for name in self.tolerances.varied():
                if self._left() <= 0.0:
                    break
                cause, _ = self._holds(candidate.result, self.tolerances.without(name), seed)
                rescued[name] += not cause
        best = rescued.most_common(1)
        return best[0][0] if best and best[0][1] > 0 else ""

    def _content(self, candidate: _Candidate, limiting: str) -> dict[str, Any]:
        rate = candidate.rate or binomial_rate(0, 0, self._confidence)
        return {
            "asked": self._asked,
            "reached": rate.low >= self._asked,
            "verified": rate.as_dict(),
            "confidence": self._confidence,
            "limiting_tolerance": limiting or None,
            "not_verified_because_of": dict(candidate.shaped.causes),
            "tolerances": dict(self.tolerances.items()),
            "margins_m": candidate.margins.tolist(),
            "rounds": self.rounds,
            "judgements": self._judged,
        }


def answer_with_risk(
    environment: Environment, query: Scenario, *, load_s: float = 0.0, progress: Progress | None = None
) -> PlanResult:
    """Plans until a path holds with the scenario's success probability on robots within its tolerances.

    Args:
        environment: The scene, its models and a roadmap.
        query: A scenario in the same scene, with a success probability.
        load_s: Seconds that loading took, for the result's timings.
        progress: Called with the completed fraction of a round's time and a message now and then.

    Returns:
        The path with the best share and its `risk`; the status is about the robot as its file has it.

    Raises:
        InputError: There is no such planner, or the robot lacks what the tolerances vary.
    """
    started = time.monotonic()
    search = _RiskSearch(environment, query, progress)
    result, risk = search.run()
    spent = time.monotonic() - started
    message = result.message if risk is None else f"{result.message}; {describe_risk(risk)}"
    timings = {"load": load_s, "plan": search.plan_s, "verify": search.verify_s, "total": load_s + spent}
    return replace(result, scenario=query, seed=query.planner.seed, message=message, risk=risk, timings_s=timings)


def describe_risk(risk: dict[str, Any]) -> str:
    """Returns a result's risk as a sentence."""
    found, asked = risk["verified"], 100.0 * risk["asked"]
    share = f"verified for {found['count']} of {found['total']} fresh robots, at least {100.0 * found['low']:.1f} %"
    if risk["reached"]:
        return f"{share} (asked {asked:g} %)"
    text = f"the asked {asked:g} % is not shown: {share}"
    if risk["not_verified_because_of"]:
        text += f", mostly lost to {max(risk['not_verified_because_of'].items(), key=lambda item: item[1])[0]}"
    name = risk["limiting_tolerance"]
    return text if name is None else f"{text}; the tolerance {name} stands in the way most"
