"""Inspecting: search, verification by the reference, repair, and what the verified path sees."""

from __future__ import annotations

import logging
import time
from dataclasses import replace

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.inspection.answer import PLANNER_NAME, Inspection, describe_coverage
from tdcr_planner.inspection.causes import Unseen, causes
from tdcr_planner.inspection.coverage import Coverage, Sight, look_along
from tdcr_planner.inspection.scene import make_visibility
from tdcr_planner.inspection.search import InspectionSearch, Progress
from tdcr_planner.inspection.survey import Survey
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.roadmap_build import RoadmapBuilder
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.validity import ValidityChecker
from tdcr_planner.query.attempt import RULED_OUT_M
from tdcr_planner.query.paths import tension_path
from tdcr_planner.query.result import PlanResult, PlanStatus, library_versions
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.query.solved_states import SolvedStates
from tdcr_planner.query.verification_report import VerificationReport

_SEARCH_SHARE = 0.8  # of the time left; verification and repair have the rest
_REPAIR_MARGIN_M = 1e-4
_MORE = 1.5  # times what the reference sees less is asked for more in a repair
_LEAST_REPAIR_S = 0.5

logger = logging.getLogger(__name__)


def make_search(session: PlanningSession, scenario: Scenario | None = None) -> InspectionSearch:
    """Returns a search for a path that sees what a scenario asks for; see `make_visibility` for what it raises."""
    query = _Query(session, scenario or session.scenario, 0.0)
    return query.search(query.checker())


def survey_surfaces(
    session: PlanningSession, *, time_limit_s: float, load_s: float = 0.0, progress: Progress | None = None
) -> Inspection:
    """Returns which points can be seen by paths from the start, and why not the others, without a path for all of them.

    Args:
        session: The scene of a scenario that says what to inspect.
        time_limit_s: Time for looking.
        load_s: Seconds that loading took.
        progress: Told the share of the time that has passed and a remark.

    Raises:
        InputError: The scenario says nothing of what to inspect, or there is no camera.
        FormatError: A surface is unknown or empty, or its spacing makes too many points.
    """
    return _Query(session, session.scenario, load_s).survey(time.monotonic() + time_limit_s, progress)


def inspect(
    session: PlanningSession,
    scenario: Scenario | None = None,
    *,
    load_s: float = 0.0,
    progress: Progress | None = None,
) -> Inspection:
    """Finds a path from the start that sees what a scenario's `[inspect]` asks for, verified by the reference.

    What is stated as seen is seen from the reference's shapes at the path's states. Where the reference refuses a path,
    the search is repeated with more margin, or with that state's neighbourhood ruled out; where it sees too little, the
    search goes on for more.

    Args:
        session: The scene.
        scenario: A scenario in the same scene; None for the session's own.
        load_s: Seconds that loading took, for the result's timings.
        progress: Told a fraction of the time limit and a remark now and then.

    Raises:
        InputError: The scenario says nothing of what to inspect, or there is no camera.
        FormatError: A surface is unknown or empty, or its spacing makes too many points.
    """
    return _Query(session, scenario or session.scenario, load_s).answer(progress)


class _Query:
    """One inspection as it goes on."""

    def __init__(self, session: PlanningSession, query: Scenario, load_s: float) -> None:
        self._session, self._query, self._load_s = session, query, load_s
        self._visibility = make_visibility(session, query)
        self._table = query.file.inspect
        start = query.file.start
        self._start = session.space.row_of(start)
        self._extra_margin = 0.0
        self._ruled_out: list[FloatArray] = []
        self._more = 0.0
        self._repairs = 0
        self._plan_s = self._verify_s = 0.0
        self._begun = time.monotonic()
        self._deadline = self._begun + query.planner.time_limit_s

    def answer(self, progress: Progress | None) -> Inspection:
        """Searches, verifies and repairs until there is an answer or the time is over."""
        checker = self.checker()
        problem = checker.explain(self._start)
        if problem:
            return self._without_path(PlanStatus.INVALID_START, f"the start is not valid: {problem}")
        search = self.search(checker)
        best: tuple[VerificationReport, SolvedStates, Sight] | None = None
        failed: tuple[VerificationReport, SolvedStates, Sight] | None = None
        while True:
            begin = time.monotonic()
            search.run(begin + _SEARCH_SHARE * (self._deadline - begin), progress)
            self._plan_s += time.monotonic() - begin
            if search.best is None:
                break
            report, states, sight = self._verify(search)
            if report.verified and (best is None or self._area(sight) > self._area(best[2])):
                best = report, states, sight
            elif not report.verified:
                failed = report, states, sight
            enough = report.verified and self._area(sight) >= self._asked(search)
            if enough or self._deadline - time.monotonic() < _LEAST_REPAIR_S:
                break
            self._repairs += 1
            if report.verified:
                missing = self._asked(search) - self._area(sight)
                self._more += _MORE * missing
                search = self._continue(search)
            else:
                self._learn(report, states)
                search = self.search(self.checker(), search)
        return self._result(search, best or failed)

    def survey(self, deadline: float, progress: Progress | None) -> Inspection:
        """Looks until a time by time.monotonic() and answers without a path."""
        checker = self.checker()
        problem = checker.explain(self._start)
        if problem:
            return self._without_path(PlanStatus.INVALID_START, f"the start is not valid: {problem}")
        search = self.search(checker)
        search.look(deadline, progress)
        answer = self._result(search, None)
        share = 100.0 * answer.coverage.visible
        message = f"{share:.1f} % of the surfaces can be seen by paths from the start; no path was asked for"
        return replace(answer, plan=replace(answer.plan, message=message))

    def checker(self) -> ValidityChecker:
        """Returns the validity checker with what repairs have taught."""
        checker = self._session.checker(self._query, extra_margin=self._extra_margin)
        for row in self._ruled_out:
            checker.rule_out(row, RULED_OUT_M)
        return checker

    def search(self, checker: ValidityChecker, earlier: InspectionSearch | None = None) -> InspectionSearch:
        """Returns a search that has not begun, with the views of an earlier one."""
        settings, table = self._query.planner, self._table
        assert table is not None  # `make_visibility` has looked
        edges = EdgeChecker(checker, settings.step_m)
        seed = settings.seed + self._repairs
        survey = Survey(checker, self._visibility, seed)
        if earlier is not None and len(earlier.survey.rows):
            survey.add(earlier.survey.rows)
        total = float(self._visibility.targets.areas.sum())
        return InspectionSearch(
            edges=edges,
            visibility=self._visibility,
            builder=RoadmapBuilder(
                edges, conditions=self._session.conditions(self._query), seed=seed, first=self._start[None]
            ),
            survey=survey,
            start=self._start,
            back=table.back,
            wanted=None if table.coverage is None else table.coverage * total + self._more,
            of_visible=table.of_visible,
            seed=seed,
        )

    def _continue(self, search: InspectionSearch) -> InspectionSearch:
        """Returns a search that goes on with all that is known, for more coverage."""
        total = float(self._visibility.targets.areas.sum())
        reached = float(search.weights[search.reached].sum())
        asked = self._asked(search) + self._more
        return replace(search, wanted=min(asked, reached, total))

    def _area(self, sight: Sight) -> float:
        return float(self._visibility.targets.areas[sight.seen].sum())

    def _asked(self, search: InspectionSearch) -> float:
        """Returns the area that is to be seen, as far as it can be, m^2."""
        table = self._table
        assert table is not None
        reached = float(search.weights[search.reached].sum())
        total = float(search.weights.sum())
        return table.of_visible * reached if table.coverage is None else min(table.coverage * total, reached)

    def _verify(self, search: InspectionSearch) -> tuple[VerificationReport, SolvedStates, Sight]:
        assert search.best is not None
        begin = time.monotonic()
        rows = search.edges.densify(search.best)
        report, states = self._session.verifier(self._query).verify(rows, deadline=self._deadline)
        sight = look_along(self._visibility, states.positions, states.rotations)
        self._verify_s += time.monotonic() - begin
        return report, states, sight

    def _learn(self, report: VerificationReport, states: SolvedStates) -> None:
        """Takes from a failed verification what the next search must do otherwise; see `attempt.Attempt.learn`."""
        logger.info("repair %d: %s", self._repairs, report.message)
        if report.cause == "clearance":
            shortfall = self._query.planner.clearance_m - float(np.nanmin(report.clearance))
            self._extra_margin += max(shortfall, 0.0) + _REPAIR_MARGIN_M
        else:
            self._ruled_out.append(states.rows[report.worst_state])

    def _without_path(self, status: PlanStatus, message: str) -> Inspection:
        points = len(self._visibility.targets)
        nothing = look_along(self._visibility, np.empty((0, 1, 3)), np.empty((0, 1, 3, 3)))
        none = np.zeros(points, dtype=np.bool_)
        return Inspection(
            self._plan_result(status, message, None, {}),
            self._coverage(nothing, none, [None] * points, []),
        )

    def _coverage(
        self,
        sight: Sight,
        can_be_seen: BoolArray,
        reasons: list[Unseen | None],
        trace: list[tuple[float, float, float, float]],
    ) -> Coverage:
        table = self._table
        assert table is not None
        return Coverage(
            targets=self._visibility.targets,
            camera=self._visibility.camera,
            sight=sight,
            can_be_seen=can_be_seen,
            causes=tuple(reasons),
            wanted=table.coverage,
            of_visible=table.of_visible,
            trace=tuple(trace),
        )

    def _result(
        self, search: InspectionSearch, found: tuple[VerificationReport, SolvedStates, Sight] | None
    ) -> Inspection:
        points = len(search.weights)
        total = float(search.weights.sum())
        reached = search.reached if len(search.reached) else np.zeros(points, dtype=np.bool_)
        if found is not None:
            reached = reached | found[2].seen
        reasons = causes(self._visibility, search.survey, reached)
        trace = [(item.seconds, item.covered / total, item.length, item.reached / total) for item in search.trace]
        statistics = {
            "vertices": search.builder.vertices,
            "states_checked": search.edges.checker.states_checked,
            "edges_checked": search.edges.edges_checked,
            "rejected": {cause.value: count for cause, count in search.edges.checker.rejected.items() if count},
            "states_looked_from": search.survey.states,
            "views": len(search.survey.rows),
        }
        if found is None:
            result = self._without_path(PlanStatus.NO_PATH, "no valid state that the start reaches sees any point")
            coverage = self._coverage(result.coverage.sight, reached, reasons, trace)
            return Inspection(replace(result.plan, planner={"name": PLANNER_NAME, **statistics}), coverage)
        report, states, sight = found
        coverage = self._coverage(sight, reached, reasons, trace)
        status = PlanStatus.VERIFIED if report.verified else PlanStatus.UNVERIFIED
        message = (
            describe_coverage(coverage)
            if report.verified
            else f"the reference does not confirm the path: {report.message}"
        )
        return Inspection(self._plan_result(status, message, (report, states), statistics), coverage)

    def _plan_result(
        self,
        status: PlanStatus,
        message: str,
        found: tuple[VerificationReport, SolvedStates] | None,
        statistics: dict[str, object],
    ) -> PlanResult:
        session, query = self._session, self._query
        return PlanResult(
            status=status,
            message=message,
            scenario=query,
            seed=query.planner.seed,
            path=None if found is None else tension_path(query, session.space, found[1], ()),
            verification=None if found is None else found[0],
            repairs=self._repairs,
            timings_s={
                "load": self._load_s,
                "plan": self._plan_s,
                "verify": self._verify_s,
                "total": self._load_s + time.monotonic() - self._begun,
            },
            planner={"name": PLANNER_NAME, **statistics},
            hashes=session.hashes(query),
            versions=library_versions(),
        )
