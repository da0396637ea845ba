"""The answer to a query: how it ended, the path, what the reference says of it, and what decided it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from tdcr_planner.planning.path import TensionPath
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.verification_report import VerificationReport

LIBRARIES = ("tdcr-planner", "numpy", "scipy", "numba", "torch", "ompl", "python-fcl", "trimesh")


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
        planner: name, iterations or vertices, states_checked, edges_checked, rejected (a count a cause); with a
            roadmap in use roadmap: vertices, edges, answered (whether the path came from it) and reason (why not).
        hashes: SHA-256 of scenario, robot mechanics, geometry as read and shape model.
        versions: Versions of the libraries involved.
        risk: With a success probability in the scenario, what is known of it: asked, reached, verified (count, total,
            value, low, high of fresh robots), limiting_tolerance and more; else None.
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
    risk: dict[str, Any] | None = None

    @property
    def holds(self) -> bool:
        """Whether the path is verified and holds with the success probability, if one is asked for."""
        if self.status is not PlanStatus.VERIFIED:
            return False
        return self.scenario.planner.success_probability is None or (self.risk is not None and self.risk["reached"])

    def __repr__(self) -> str:
        """Returns how the query ended and what the reference says; scenario and path are too long to read."""
        path = "None" if self.path is None else f"<{len(self.path)} states>"
        return (
            f"PlanResult(status={self.status.value!r}, message={self.message!r}, scenario={str(self.scenario.path)!r}, "
            f"seed={self.seed}, path={path}, verification={self.verification!r}, repairs={self.repairs})"
        )


@cache
def _library_versions() -> tuple[tuple[str, str], ...]:
    versions = []
    for name in LIBRARIES:
        try:
            versions.append((name, version(name)))
        except PackageNotFoundError:
            versions.append((name, "not installed"))
    return tuple(versions)


def library_versions() -> dict[str, str]:
    """Returns the versions of the libraries that decide a result."""
    return dict(_library_versions())
