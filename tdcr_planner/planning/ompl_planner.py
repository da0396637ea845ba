"""The search: from a scenario's start through its goals, with answers as values."""

from __future__ import annotations

import contextlib
import itertools
import time
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.goal import GoalSource
from tdcr_planner.planning.objectives import PathCost
from tdcr_planner.planning.offered import COMMON_PARAMETERS, FIRST_TREE, OMPL_TRAITS, planner_setters, require_ompl
from tdcr_planner.planning.passage import Passage
from tdcr_planner.planning.planner import Connector, Planner, Progress, SearchOutcome, SearchStatus, SearchTask
from tdcr_planner.planning.refusals import impossible_tip, missed_entries
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.smoothing import path_cost, shorten
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.tour import best_order
from tdcr_planner.planning.validity import ValidityChecker, rejections

with contextlib.suppress(ModuleNotFoundError):
    # What does not search, as verification, works where OMPL cannot be installed; `require_ompl` says so to a search.
    from tdcr_planner.planning.ompl_run import PlannerRun

# Part of a leg's time that planners which improve their path until the end leave to shortening, and its most.
_SHORTENING_SHARE = 0.1
_SHORTENING_RESERVE_S = 0.3
_FIRST_ROUNDS = 4  # rounds of goal sampling after which a goal that no shape has reached counts as out of reach


class OmplPlanner(Planner):
    """One of OMPL's planners, with plain motions, retraction and a roadmap before it."""

    def __init__(self, name: str) -> None:
        """Prepares the planner of a name in `OMPL_TRAITS`."""
        self.name = name

    def parameters(self) -> dict[str, type]:
        """Returns the planner's own parameters (OMPL's setters in snake case) and those that all take, with types."""
        own = {key: kind for key, (_, kind) in planner_setters(self.name).items()}
        return own | COMMON_PARAMETERS

    def search(self, task: SearchTask) -> SearchOutcome:
        """Searches a path; see `Planner.search`.

        Planners that improve their path until the time is over repeat it where the parameter `iterations` ends them.

        Raises:
            MissingLibraryError: OMPL is not installed and needed.
        """
        return _Query(
            scenario=task.scenario,
            space=task.space,
            checker=task.checker,
            edges=task.edges or EdgeChecker(task.checker, task.scenario.planner.step_m),
            deadline=time.monotonic() + task.time_limit_s,
            seed=task.seed,
            progress=task.progress,
            connector=task.connector,
        ).run()


OMPL_PLANNERS = SimpleNamespace(**{name: OmplPlanner(name) for name in OMPL_TRAITS})


@dataclass
class _Query:
    scenario: Scenario
    space: ConfigurationSpace
    checker: ValidityChecker
    edges: EdgeChecker
    deadline: float
    seed: int
    progress: Progress | None
    connector: Connector | None = None
    answered_by: str = ""
    iterations_of_leg: dict[int, int] = field(default_factory=dict)
    sources: list[GoalSource] = field(default_factory=list)
    passages: list[Passage] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._states_before = self.checker.states_checked
        self._edges_before = self.edges.edges_checked
        self._rejected_before = dict(self.checker.rejected)

    def run(self) -> SearchOutcome:
        start = self.space.row_of(self.scenario.file.start)
        problem = self.checker.explain(start)
        if problem:
            return self._outcome(SearchStatus.INVALID_START, f"the start is not valid: {problem}")
        for number, goal in enumerate(self.scenario.goals):
            source = goal.kind.source(self.checker, goal, self.seed + 1000 * (number + 1))
            self.sources.append(source)
            problem = impossible_tip(self.checker, goal) or self._first_states(source)
            if problem:
                return self._outcome(SearchStatus.INVALID_GOAL, f"{self._name(number)}: {problem}")
            if not source.rows:
                message = f"{self._name(number)}: no configuration that reaches it was found to be free of collision"
                reasons = "; ".join(filter(None, [source.obstruction(), missed_entries(self.checker)]))
                return self._outcome(SearchStatus.NO_PATH, f"{message} ({reasons})" if reasons else message)
        return self._travel(start, self._order(start))

    def _travel(self, start: FloatArray, order: tuple[int, ...]) -> SearchOutcome:
        rows, reached = start[None], []
        cost = PathCost(self.scenario.planner.objective, self.checker)
        for leg, number in enumerate(order):
            source = self.sources[number]
            found = self._way(rows[-1], source, leg, cost)
            if found is None:
                message = f"no path to {self._name(number)} within the time given{self._commonest_rejection()}"
                stopped = self.passages[-1].stopped_by() if self.passages else ""
                message += f"; {stopped}" if stopped else ""
                return self._outcome(SearchStatus.NO_PATH, message)
            found = shorten(self.edges, found, seed=self.seed + leg, deadline=self.deadline, cost=cost.edge)
            rows = np.concatenate([rows, found[1:]])
            reached.append(len(rows) - 1)
        return self._outcome(SearchStatus.FOUND, f"path of {len(rows)} waypoints", rows, tuple(reached), order)

    def _way(self, start: FloatArray, source: GoalSource, leg: int, cost: PathCost) -> FloatArray | None:
        """Returns a valid way of one leg: one that is known, a plain motion, one by retraction, or the planner's."""
        if self.connector is not None:
            known = self.connector.connect(self.edges, start, source, self.deadline)
            if known is not None:
                self.answered_by = "roadmap"
                return known
        now = time.monotonic()
        if now >= self.deadline:
            return None
        share = (self.deadline - now) / (len(self.sources) - leg)
        self._leg_deadline = now + share - min(_SHORTENING_SHARE * share, _SHORTENING_RESERVE_S)
        passage = Passage(self.edges, start, source, self.seed + leg, self._leg_deadline)
        self.passages.append(passage)
        return self._by_structure_or_planner(passage, leg, cost)

    def _by_structure_or_planner(self, passage: Passage, leg: int, cost: PathCost) -> FloatArray | None:
        """Tries plain motions, then a first tree where there is room for it, then retraction, then the planner."""
        settings = self.scenario.planner
        traits, parameters = OMPL_TRAITS[settings.name], settings.parameters
        known = passage.by_plain_motions() if parameters.get("plain_motions", True) else None
        if known is not None:
            self.answered_by = "plain_motions"
            if not traits.improves or (cost.plain and len(known) == 2):
                return known
        retracts = passage.offered and bool(parameters.get("retraction", True))
        if known is None and retracts:
            # Where there is room a small tree is the cheaper answer; it rarely is where every goal state is narrow.
            if traits.begins_anew:
                most = FIRST_TREE // 2 if passage.narrow else FIRST_TREE
                found = self._by_planner(passage.starts, passage.source, leg, cost, most)
                if found is not None:
                    return found
            known = passage.by_retraction()
            if known is not None:
                self.answered_by = "retraction"
                if not traits.improves:
                    return known
        by_structure = self.answered_by
        goal = passage.goal if retracts and known is None else passage.source
        found = self._by_planner(passage.starts, goal, leg, cost)
        if found is not None:
            found = passage.whole(found)
        if known is None or found is None:
            return known if found is None else found
        known = shorten(self.edges, known, seed=self.seed + leg, deadline=self.deadline, cost=cost.edge)
        if path_cost(known, cost.edge) >= path_cost(found, cost.edge):
            return found
        self.answered_by = by_structure
        return known

    def _by_planner(
        self, starts: FloatArray, goal: GoalSource, leg: int, cost: PathCost, most: int = 0
    ) -> FloatArray | None:
        """Returns the planner's way between one of some starts and a goal state, in at most so many iterations."""
        require_ompl()
        run = PlannerRun(
            checker=self.checker,
            edges=self.edges,
            name=self.scenario.planner.name,
            parameters=dict(self.scenario.planner.parameters),
            deadline=self._leg_deadline,
            cost=cost,
            progress=self.progress,
            iterations=self.iterations_of_leg.get(leg, 0),
            most=most,
        )
        found = run.run(starts, goal, self.seed + leg)
        self.iterations_of_leg[leg] = run.iterations
        if found is None:
            return None
        found = _with_exact_ends(found, starts, goal)
        if not self.edges.path_valid(found):
            return None
        self.answered_by = "planner"
        return found

    def _first_states(self, source: GoalSource) -> str:
        """Looks for goal states until there is one, the goal is known to be out of reach, or the time is over."""
        for attempt in itertools.count(1):
            if source.rows:
                return ""
            source.search()
            problem = source.unreachable()
            if problem and (attempt >= _FIRST_ROUNDS or source.exhausted()):
                return problem
            if time.monotonic() >= self.deadline or (source.exhausted() and not source.rows):
                return problem
        return ""

    def _order(self, start: FloatArray) -> tuple[int, ...]:
        """Returns the order of travel: as given, or the one of least body motion between the goals' states."""
        count = len(self.sources)
        given = tuple(range(count))
        if self.scenario.file.goal_order == "given" or count == 1:
            return given
        places = [start[None], *(np.array(source.rows) for source in self.sources)]
        scale = self.checker.motion_scale
        between = np.array([[np.linalg.norm((a[:, None] - b) * scale, axis=2).min() for b in places] for a in places])
        return best_order(between)

    def _name(self, number: int) -> str:
        return "the goal" if len(self.scenario.goals) == 1 else f"goal {number + 1}"

    def _rejected(self) -> dict[str, int]:
        counts = {cause: n - self._rejected_before[cause] for cause, n in self.checker.rejected.items()}
        return rejections(counts)

    def _commonest_rejection(self) -> str:
        """Returns what rejected most states, as the end of a sentence; empty when nothing did."""
        rejected = self._rejected()
        if not rejected:
            return ""
        cause = max(rejected, key=lambda name: rejected[name])
        return f"; states were rejected most often for {cause} ({rejected[cause]:,})"

    def _outcome(
        self,
        status: SearchStatus,
        message: str,
        rows: FloatArray | None = None,
        goals: tuple[int, ...] = (),
        order: tuple[int, ...] = (),
    ) -> SearchOutcome:
        statistics = {
            "name": self.scenario.planner.name,
            "iterations": sum(self.iterations_of_leg.values()),
            "goal_states": sum(len(source.rows) for source in self.sources),
            "states_checked": self.checker.states_checked - self._states_before,
            "edges_checked": self.edges.edges_checked - self._edges_before,
            "rejected": self._rejected(),
            "answered_by": self.answered_by if rows is not None else "",
        }
        pulled_back = self.passages[-1].statistics() if self.passages else {}
        if pulled_back:
            statistics["retraction"] = pulled_back
        return SearchOutcome(status, message, rows, goals, order, statistics)


def _with_exact_ends(rows: FloatArray, starts: FloatArray, goal: GoalSource) -> FloatArray:
    """Returns a path whose ends are given states: the planner's coordinates are rounded by their scaling."""
    rows = rows.copy()
    rows[0] = min(starts, key=lambda row: float(np.abs(row - rows[0]).max()))
    nearest = min(goal.rows, key=lambda row: float(np.abs(row - rows[-1]).max()))
    if np.allclose(nearest, rows[-1], rtol=1e-9, atol=1e-12):
        rows[-1] = nearest
    return rows if len(rows) > 1 else np.concatenate([rows, rows])
