"""The search: a path from the start that sees what is wanted, improved until the time is over."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.inspection.graph import ViewGraph
from tdcr_planner.inspection.survey import Survey
from tdcr_planner.inspection.tighten import CoveragePath
from tdcr_planner.inspection.tour import TourSearch
from tdcr_planner.inspection.visibility import Visibility
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.roadmap_build import RoadmapBuilder

Progress = Callable[[float, str], None]

_FIRST_ROUND_S = 0.6
_SLOW_ROUND_S = 12.0  # the same for the reference, of which a batch of states takes a second
_GROWTH = 1.7  # of a round's time over that of the one before
# Of a round's time: roadmap, survey, joining views, tour; tightening has the rest.
_ROADMAP, _SURVEY, _JOIN, _TOUR = 0.2, 0.2, 0.15, 0.15
# Of the whole time: rounds; of the rest: each of the last tours, and shortening each.
_ROUNDS, _LAST_TOURS, _LAST_TOUR, _LAST_TIGHTEN = 0.5, 2, 0.06, 0.18
_EXPLORE = _ROADMAP + _SURVEY + _JOIN
_DEPTH = 4  # views of each point that the tour may choose from
_MOST_VERTICES = 6_000
_FIRST_JOIN_S = 3.0  # for joining what is seen from no reached state, at least
_IDLE_ROUNDS = 3  # rounds of little gain after which the search ends
_LITTLE = 0.004
_LEAST_ROUND = 0.04  # of the whole time: shorter rounds do not end the search
_NOTABLE = 0.01  # share of the surfaces
_SPARE = 1.004  # times what must be seen, up to which a path is kept while it is being shortened
_EPS = 1e-12

logger = logging.getLogger(__name__)


@dataclass
class Milestone:
    """What the search had at some moment: seconds, weight seen, length in m of body motion, weight that can be seen."""

    seconds: float
    covered: float
    length: float
    reached: float


@dataclass
class InspectionSearch:
    """A search for a path that sees enough; `run` may be called again and goes on.

    Attributes:
        edges: Validity of motions.
        visibility: What is seen.
        builder: The roadmap, grown as the search goes on.
        survey: Which points can be seen, and from where.
        start: The start's configuration, shape (dimension,).
        back: Whether the path returns to the start.
        wanted: Weight that is to be seen, if it can be; None for a share of what can be seen.
        of_visible: That share.
        seed: Of the random choices.
        best: The best path's waypoints, shape (k, dimension), or None.
        covered: Weight that it sees.
        length: Its length, m of body motion.
        reached: Points that can be seen from a state that the start reaches, shape (p,).
        trace: Its history.
    """

    edges: EdgeChecker
    visibility: Visibility
    builder: RoadmapBuilder
    survey: Survey
    start: FloatArray
    back: bool
    wanted: float | None
    of_visible: float
    seed: int
    best: FloatArray | None = None
    covered: float = 0.0
    length: float = np.inf
    reached: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    trace: list[Milestone] = field(default_factory=list)
    _joined: list[tuple[FloatArray, BoolArray]] = field(default_factory=list)
    _graph: ViewGraph | None = None
    _rounds: int = 0
    _spent: float = 0.0

    @property
    def weights(self) -> FloatArray:
        """Weight of each point, shape (p,): the area that it stands for, m^2."""
        return self.visibility.targets.areas

    @property
    def _first_round_s(self) -> float:
        return _SLOW_ROUND_S if self.edges.checker.model.name == "reference" else _FIRST_ROUND_S

    @property
    def target(self) -> float:
        """Weight that a path must see: what is wanted as far as it can be seen, and never less than the best path's."""
        reachable = float(self.weights[self.reached].sum()) if len(self.reached) else 0.0
        wanted = self.of_visible * reachable if self.wanted is None else self.wanted
        return max(min(wanted, reachable), self.covered)

    def run(self, deadline: float, progress: Progress | None = None) -> None:
        """Improves the path until a time by time.monotonic(), or until rounds bring little.

        Rounds that explore and plan have the first part of the time; the rest shortens what they found.
        """
        begin = time.monotonic()
        last = begin + _ROUNDS * (deadline - begin)
        idle, size = 0, self._first_round_s
        while time.monotonic() < last and idle < _IDLE_ROUNDS:
            known = (self.covered, self.length)
            now = time.monotonic()
            stop = min(now + size, last)
            self._round(stop, begin)
            self._rounds += 1
            size *= _GROWTH
            gained = self.covered > known[0] + _EPS or self.length < known[1] * (1.0 - _LITTLE)
            short = stop - now < _LEAST_ROUND * (deadline - begin)
            idle = 0 if gained or short or self._unjoined() or self.best is None else idle + 1
            if progress is not None:
                share = (time.monotonic() - begin) / max(deadline - begin, 1e-9)
                progress(min(share, 1.0), self._remark())
        if self.best is not None and self._graph is not None:
            until = deadline if idle < _IDLE_ROUNDS else min(deadline, time.monotonic() + size)
            self._finish(self._graph, until, begin)
            if progress is not None:
                progress(1.0, self._remark())
        self._spent += time.monotonic() - begin

    def _finish(self, graph: ViewGraph, deadline: float, begin: float) -> None:
        """Plans other tours over the last graph, shortens each for a while and the best for the rest of the time."""
        left = deadline - time.monotonic()
        for number in range(_LAST_TOURS):
            generator = np.random.default_rng([self.seed, self._rounds, number])
            rows = self._tour(graph, time.monotonic() + _LAST_TOUR * left)
            path = CoveragePath(self.edges, self.visibility, self.weights, self.target, rows)
            path.tighten(time.monotonic() + _LAST_TIGHTEN * left, generator)
            self._take(path, begin)
            self._rounds += 1
        assert self.best is not None  # the caller has looked
        path = CoveragePath(self.edges, self.visibility, self.weights, self.target, self.best)
        path.tighten(deadline, np.random.default_rng([self.seed, self._rounds]), found=partial(self._take, path, begin))

    def _unjoined(self) -> bool:
        """Returns whether valid states see notably more than those that the start is known to reach."""
        if not len(self.reached):
            return True
        missing = float(self.weights[(self.survey.counts > 0) & ~self.reached].sum())
        return missing > _NOTABLE * float(self.weights.sum())

    def look(self, deadline: float, progress: Progress | None = None) -> None:
        """Finds what can be seen until a time by time.monotonic(), without a path; `reached` says what."""
        begin, size = time.monotonic(), self._first_round_s
        while time.monotonic() < deadline:
            self._explore(min(time.monotonic() + size, deadline))
            self._rounds += 1
            size *= _GROWTH
            if progress is not None:
                share = (time.monotonic() - begin) / max(deadline - begin, 1e-9)
                progress(min(share, 1.0), self._remark())

    def _remark(self) -> str:
        total = float(self.weights.sum())
        can = float(self.weights[self.reached].sum()) if len(self.reached) else 0.0
        if self.best is None:
            return f"{100 * can / total:.1f} % can be seen"
        return f"sees {100 * self.covered / total:.1f} of {100 * can / total:.1f} %, {self.length:.3f} m"

    def _round(self, stop: float, begin: float) -> None:
        """Explores, then looks for a tour and shortens it."""
        graph = self._graph = self._explore(stop)
        if not self.reached.any():
            return
        rows = self._tour(graph, time.monotonic() + _TOUR * max(stop - time.monotonic(), 0.0) / (1.0 - _EXPLORE))
        self._shorten(rows, stop, begin)

    def _explore(self, stop: float) -> ViewGraph:
        """Grows roadmap and survey and joins views; returns the graph of what the start reaches."""
        now = time.monotonic()
        size = stop - now
        if self.builder.vertices < _MOST_VERTICES:
            self.builder.run(time_limit_s=_ROADMAP * size)
        self.survey.run(time.monotonic() + _SURVEY * size)
        graph = ViewGraph(self.edges, self.builder.roadmap(), self.start, self._seen_from(self.start))
        for row, seen in self._joined:
            graph.add(row, seen, stop)
        depth = 1 if self._rounds == 0 else _DEPTH
        graph.cover(self.survey, self.weights, depth, time.monotonic() + _JOIN * size, max(stop, now + _FIRST_JOIN_S))
        self._joined = list(zip(graph.rows[graph.views], graph.seen, strict=True))
        self.reached = graph.reached | self.reached if len(self.reached) else graph.reached
        return graph

    def _shorten(self, rows: FloatArray, stop: float, begin: float) -> None:
        """Shortens a tour, and now and then the best path once more, and keeps what is better."""
        generator = np.random.default_rng([self.seed, self._rounds])
        candidates = [rows] if self.best is None or self._rounds % 2 else [self.best, rows]
        for number, candidate in enumerate(candidates):
            path = CoveragePath(self.edges, self.visibility, self.weights, self.target, candidate)
            if self.best is None:
                self._take(path, begin)
            left = stop - time.monotonic()
            until = time.monotonic() + max(left / (len(candidates) - number), 0.02)
            path.tighten(until, generator, found=partial(self._consider, path, begin))
            self._take(path, begin)

    def _seen_from(self, row: FloatArray) -> BoolArray:
        positions, rotations, _ = self.edges.checker.world_poses(row[None])
        return np.asarray(self.visibility.seen(positions, rotations)[0])

    def _tour(self, graph: ViewGraph, until: float) -> FloatArray:
        """Returns the waypoints of a short way over the graph that sees enough."""
        # The start is the graph's first vertex and, as a view, its first view.
        nodes = graph.views
        lengths, before = graph.ways(nodes)
        search = TourSearch(
            lengths[:, nodes],
            np.array(graph.seen),
            self.weights,
            self.target,
            back=self.back,
            seed=self.seed + 7919 * self._rounds,
        )
        search.run(until)
        stops = [0, *search.order, *([0] if self.back else [])]
        way = [nodes[0]]
        for here, there in pairwise(stops):
            trace = [nodes[there]]
            while trace[-1] != nodes[here]:
                trace.append(int(before[here, trace[-1]]))
            way += trace[::-1][1:]
        return graph.rows[way]

    def _consider(self, path: CoveragePath, begin: float) -> None:
        """Keeps a path that sees little more than it must: what it sees beyond may still be given up for length."""
        if path.covered <= _SPARE * self.target:
            self._take(path, begin)

    def _take(self, path: CoveragePath, begin: float) -> None:
        """Keeps a path if it sees more than the best, or no less on a shorter way."""
        covered, length = path.covered, path.length
        if covered > self.covered + _EPS or (covered >= self.covered - _EPS and length < self.length):
            self.best, self.covered, self.length = path.rows.copy(), max(covered, self.covered), length
            reached = self.reached | path.seen
            self.reached = reached
            seconds = self._spent + time.monotonic() - begin
            self.trace.append(Milestone(seconds, covered, length, float(self.weights[reached].sum())))
