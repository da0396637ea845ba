"""The planning session: everything a scenario needs, built once, and plan, verify, repair on top of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from tdcr_planner.planning.path import TensionPath
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.verification import VerificationReport


class PlanStatus(StrEnum):
    """How a query ended."""

    VERIFIED = "verified"
    UNVERIFIED = "unverified"
    NO_PATH = "no_path"
    INVALID_START = "invalid_start"
    INVALID_GOAL = "invalid_goal"


@dataclass(frozen=True)
class PlanResult:
    """The answer to a query.

    Attributes:
        status: How it ended.
        message: The same for a person: what was reached or what failed and where.
        scenario: The query.
        seed: The seed used.
        path: The states found, or None.
        verification: The reference's report on the path, or None without a path.
        repairs: How often verification sent the search back.
        timings_s: Seconds: load, plan, verify, total.
        planner: name, iterations or vertices, states_checked, edges_checked, rejected (a count a cause).
        hashes: SHA-256 of scenario, robot mechanics and shape model.
        versions: Versions of the libraries involved.
    """

    status: PlanStatus
    message: str
    scenario: Scenario
    seed: int
    path: TensionPath | None
    verification: VerificationReport | None
    repairs: int = 0
    timings_s: dict[str, float] = field(default_factory=dict)
    planner: dict[str, Any] = field(default_factory=dict)
    hashes: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
