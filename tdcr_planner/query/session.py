"""The planning session: an environment, and the queries that are put to it."""

from __future__ import annotations

import time

from tdcr_planner.errors import InputError
from tdcr_planner.planning.planner import Progress
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.answer import answer_query
from tdcr_planner.query.environment import Environment
from tdcr_planner.query.paths import path_rows
from tdcr_planner.query.result import PlanResult
from tdcr_planner.query.verification_report import VerificationReport


class PlanningSession(Environment):
    """An environment that answers queries: scenarios in its scene, one after the other."""

    def plan(
        self, scenario: Scenario | None = None, *, load_s: float = 0.0, progress: Progress | None = None
    ) -> PlanResult:
        """Searches a path, verifies it with the reference and repairs it within the time limit.

        A roadmap in use is asked first; the planner searches where it knows no path. Where verification finds too
        little clearance, the search is repeated with a margin grown by what was missing; where the reference has no
        stable shape or breaks a limit, with that state's neighbourhood ruled out.

        Args:
            scenario: A scenario in the same scene, for example with another start, goal or planner; None for the
                session's own.
            load_s: Seconds that loading took, for the result's timings.
            progress: Called with the completed fraction of the time limit and a message now and then.

        Raises:
            InputError: The scenario is of another scene, or its planner is not offered.
        """
        query = self.check_same_scene(scenario or self.scenario)
        if query.planner.success_probability is None:
            return answer_query(self, query, load_s=load_s, progress=progress)
        # Statistics of scipy's, which take a third of a second to import: only such queries pay for it.
        from tdcr_planner.query.risk import answer_with_risk

        return answer_with_risk(self, query, load_s=load_s, progress=progress)


def plan(scenario: Scenario, *, seed: int | None = None, progress: Progress | None = None) -> PlanResult:
    """Plans and verifies one scenario.

    Args:
        scenario: From `load_scenario`.
        seed: Seed of the search; None for the scenario's.
        progress: Called with the completed fraction of the time limit and a message now and then.

    Returns:
        The result; no path, a failed verification or an invalid start are a status in it.
    """
    started = time.monotonic()
    query = scenario if seed is None else scenario.with_planner(seed=seed)
    session = PlanningSession(query)
    return session.plan(load_s=time.monotonic() - started, progress=progress)


def verify(result: PlanResult, *, refine: int = 1) -> VerificationReport:
    """Solves every state of a result's path again with the reference and judges it in the result's scene.

    Args:
        result: A result with a path.
        refine: Verify at steps this many times finer than the scenario's step_m.

    Raises:
        InputError: The result has no path.
    """
    if result.path is None:
        raise InputError("result", "a result with a path", f"status {result.status.value!r} without one")
    session = PlanningSession(result.scenario)
    goals = [(state, result.scenario.goals[number]) for state, number in result.path.goal_states]
    report, _ = session.verifier(refine=refine).verify(path_rows(session.space, result.path), goals)
    return report
