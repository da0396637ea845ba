"""The attempts of a query: what each search and verification has come to, and what a repair does otherwise."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.planner import SearchOutcome, SearchStatus
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.solved_states import SolvedStates
from tdcr_planner.query.verification_report import VerificationReport

# What a repair adds to the shortfall that verification has measured, and the reach of a state that it rules out.
REPAIR_MARGIN_M = 2e-4
RULED_OUT_M = 5e-3


@dataclass
class Attempt:
    """What a query has come to so far, repairs included.

    Attributes:
        query: The scenario.
        outcome: The last search's.
        report: The last verification's, or None while no path was found.
        states: The states that it solved.
        order: The goals' numbers in the order in which that path reaches them.
        repairs: How often verification sent the search back.
        extra_margin: What the next search adds to the disks' margins, one for all or shape (d,), m.
        ruled_out: Configurations near which the next search may not pass, shape (dimension,) each.
        plan_s: Time of the searches.
        verify_s: Time of the verifications.
        statistics: The searches' counts, added up.
    """

    query: Scenario
    outcome: SearchOutcome | None = None
    report: VerificationReport | None = None
    states: SolvedStates | None = None
    order: tuple[int, ...] = ()
    repairs: int = 0
    extra_margin: float | FloatArray = 0.0
    ruled_out: list[FloatArray] = field(default_factory=list)
    plan_s: float = 0.0
    verify_s: float = 0.0
    statistics: dict[str, Any] = field(default_factory=dict)

    def add_search(self, outcome: SearchOutcome, seconds: float) -> None:
        """Takes a search's outcome and adds its counts to those of the searches before."""
        self.outcome = outcome
        self.plan_s += seconds
        self.statistics = _add_counts(self.statistics, outcome.statistics)

    def add_verification(self, report: VerificationReport, states: SolvedStates, seconds: float) -> None:
        """Takes the reference's judgement on the path of the last search."""
        assert self.outcome is not None  # a search has found the path
        self.report, self.states, self.order = report, states, self.outcome.order
        self.verify_s += seconds

    def learn(self) -> None:
        """Takes from a failed verification what the next search must do otherwise.

        Where the reference has too little clearance, the margin grows by what was missing; where it has no stable
        shape or breaks a limit, that state's neighbourhood is ruled out.
        """
        assert self.report is not None  # called after a verification
        assert self.states is not None
        self.repairs += 1
        if self.report.cause == "clearance":
            shortfall = self.query.required_clearance - float(np.nanmin(self.report.clearance))
            self.extra_margin = self.extra_margin + (max(shortfall, 0.0) + REPAIR_MARGIN_M)
        else:
            self.ruled_out.append(self.states.rows[self.report.worst_state])

    def verdict(self) -> tuple[PlanStatus, str]:
        """Returns the status of the query and a sentence on it."""
        assert self.outcome is not None  # a search has run
        if self.report is None:
            statuses = {
                SearchStatus.NO_PATH: PlanStatus.NO_PATH,
                SearchStatus.INVALID_START: PlanStatus.INVALID_START,
                SearchStatus.INVALID_GOAL: PlanStatus.INVALID_GOAL,
            }
            return statuses[self.outcome.status], self.outcome.message
        if self.report.verified:
            return PlanStatus.VERIFIED, self.outcome.message
        message = f"a path was found, but the reference does not confirm it: {self.report.message}"
        return PlanStatus.UNVERIFIED, message + self._repairs_made()

    def _repairs_made(self) -> str:
        """Returns what came of the repairs, as the end of a sentence; empty without any."""
        if not self.repairs:
            return ""
        assert self.outcome is not None  # a search has run
        count = "1 repair was tried" if self.repairs == 1 else f"{self.repairs} repairs were tried"
        if self.outcome.found:
            return f"; {count}, and the path is the last one's"
        return f"; {count}, and the last one's search came back empty: {self.outcome.message}"


def _add_counts(total: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Returns two sets of statistics as one: counts added, tables of counts merged, anything else from the later."""
    merged = dict(total)
    for key, value in more.items():
        if key == "rejected":
            merged[key] = _add_counts(merged.get(key, {}), value)
        elif isinstance(value, int | float) and key in merged:
            merged[key] += value
        else:
            merged[key] = value
    return merged
