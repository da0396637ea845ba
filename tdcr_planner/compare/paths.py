"""Paths planned with each shape model: how many of them the reference verifies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tdcr_planner.planning.scenario import Validity
from tdcr_planner.query.result import PlanResult, PlanStatus
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.rates import Rate, binomial_rate


@dataclass(frozen=True)
class PlannedPath:
    """How one query went.

    Attributes:
        model: The shape model that the search asked.
        seed: Seed of the search.
        status: How the query ended, repairs included.
        repairs: How often verification sent the search back.
        clearance_m: Least clearance of the last path under the reference; None without one.
        deviation_m: Largest deviation of the model along it; None without one.
        plan_s: Time of the searches.
    """

    model: Validity
    seed: int
    status: str
    repairs: int
    clearance_m: float | None
    deviation_m: float | None
    plan_s: float

    @property
    def found(self) -> bool:
        """Whether the first search found a path."""
        return self.repairs > 0 or self.status in (PlanStatus.VERIFIED, PlanStatus.UNVERIFIED)

    @property
    def verified_at_once(self) -> bool:
        """Whether the reference verified the first path, so that no repair was asked for."""
        return self.repairs == 0 and self.status == PlanStatus.VERIFIED


@dataclass(frozen=True)
class PathRates:
    """The queries with one shape model.

    Attributes:
        model: The shape model.
        found: Queries whose first search found a path.
        verified_at_once: First paths that the reference verified, of those found: the model alone.
        verified: Queries that ended with a verified path, repairs included: the planner as a whole.
    """

    model: Validity
    found: Rate
    verified_at_once: Rate
    verified: Rate


def plan_path(session: PlanningSession, model: Validity, seed: int) -> PlannedPath:
    """Plans the session's scenario with a shape model and a seed."""
    result: PlanResult = session.plan(session.scenario.with_planner(validity=model, seed=seed))
    worst = {} if result.verification is None else result.verification.worst
    return PlannedPath(
        model=model,
        seed=seed,
        status=result.status.value,
        repairs=result.repairs,
        clearance_m=worst.get("clearance_m"),
        deviation_m=worst.get("deviation_m"),
        plan_s=result.timings_s["plan"],
    )


def path_rates(paths: Sequence[PlannedPath], models: Sequence[Validity]) -> tuple[PathRates, ...]:
    """Returns the rates of each model over its queries."""
    rates = []
    for model in models:
        own = [path for path in paths if path.model == model]
        found = sum(path.found for path in own)
        at_once = sum(path.verified_at_once for path in own)
        verified = sum(path.status == PlanStatus.VERIFIED for path in own)
        rates.append(
            PathRates(
                model,
                found=binomial_rate(found, len(own)),
                verified_at_once=binomial_rate(at_once, found),
                verified=binomial_rate(verified, len(own)),
            )
        )
    return tuple(rates)
