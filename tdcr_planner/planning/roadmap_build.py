"""Building a roadmap: where to look for configurations, and which of them to join."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.errors import InputError
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.roadmap import Conditions, Roadmap
from tdcr_planner.planning.validity import sample_within_tensions

Progress = Callable[[float, str], None]

_DRAWN = 512  # configurations drawn for a batch, by each way
_SELDOM = 4  # as many times more are drawn where vertices are few
_SHARE = 24  # most vertices that a batch takes from each of them
_REACH = 0.1  # usual length of a bridge and longest of a step of growth, in robot lengths of body motion
_HALVINGS = 4  # how often the longest step is halved at most
_RANGES = 16  # ranges of insertion that get equal shares
_FEW = 8  # nearest vertices whose distance says how lonely a vertex is
_STALE = 1.25  # growth in number after which loneliness is told anew
_MOST_LINKS = 8  # motions that a vertex is given at once; it gets more from vertices that come later
_PATIENCE = 20  # batches without anything valid after which a build ends


class RoadmapBuilder:
    """Adds batches of vertices and proven edges until time or number are reached; can be ended at any moment.

    A batch draws configurations in several ways. Some are spread over the whole space, for what is wide; many more
    over a range of insertion that has few vertices, for depths at which hardly any is valid. Some are middles of pairs
    that are both invalid, for what is narrow (the bridge test of Hsu, Jiang, Reif and Sun). Some are grown: small
    random steps from known vertices, once from every range of insertion alike and once from the loneliest vertices, of
    which the farthest from all that is known are kept, so that the known part reaches on into passages that nothing
    drawn at large would hit. A configuration that is valid becomes a vertex and is joined to its nearest, as many as
    PRM* (Karaman and Frazzoli) tries, until `_MOST_LINKS` of them have been reached.

    Attributes:
        vertices: Number of vertices so far.
        edge_count: Number of proven edges so far.
    """

    def __init__(
        self, edges: EdgeChecker, *, conditions: Conditions, seed: int, first: FloatArray | None = None
    ) -> None:
        """Prepares a build.

        Args:
            edges: Validity of edges, with the margins that the roadmap is to hold under.
            conditions: What these margins stand for.
            seed: Seed of the sampling; the same seed and number of vertices give the same roadmap.
            first: Configurations to begin with, shape (k, dimension); those that are not valid are left out.
        """
        self._edges = edges
        self._checker = edges.checker
        self._conditions = conditions
        self._seed = seed
        self._generator = np.random.default_rng(seed)
        self._scale = self._checker.motion_scale
        self._reach = _REACH * self._checker.robot.length
        self._dimension = self._checker.space.dimension
        self._rows: FloatArray = np.empty((0, self._dimension))
        self._volumes: FloatArray = np.empty(0)
        self._joined: list[tuple[int, int]] = []
        self._spent_s = 0.0
        if first is not None and len(first):
            self._add(first[self._checker.valid(first)])

    @property
    def vertices(self) -> int:
        """Number of vertices so far."""
        return len(self._rows)

    @property
    def edge_count(self) -> int:
        """Number of proven edges so far."""
        return len(self._joined)

    def run(
        self, *, time_limit_s: float = math.inf, vertices: int | None = None, progress: Progress | None = None
    ) -> None:
        """Adds batches until the time is over, there are enough vertices, or nothing valid is found for long.

        What raises in the progress callback, and Ctrl-C, end it; what has been built by then is kept, and another run
        goes on from there.

        Args:
            time_limit_s: Time for this run.
            vertices: Number of vertices to end at; None for the time alone.
            progress: Told the share that is done and a remark after each batch.

        Raises:
            InputError: Neither a time nor a number was given.
        """
        if vertices is None and not math.isfinite(time_limit_s):
            raise InputError("time_limit_s", "a time, or a number of vertices", "neither")
        begin = time.monotonic()
        deadline = begin + time_limit_s
        idle = 0
        try:
            while time.monotonic() < deadline and idle < _PATIENCE and self.vertices < (vertices or math.inf):
                found = self._candidates()[: None if vertices is None else vertices - self.vertices]
                self._add(found, deadline)
                idle = 0 if len(found) else idle + 1
                if progress is not None:
                    spent = (time.monotonic() - begin) / time_limit_s
                    grown = 0.0 if vertices is None else self.vertices / vertices
                    progress(min(max(spent, grown), 1.0), f"{self.vertices} vertices, {self.edge_count} edges")
        finally:
            self._spent_s += time.monotonic() - begin

    def roadmap(self) -> Roadmap:
        """Returns what has been built so far."""
        edges = np.array(self._joined, dtype=np.int64).reshape(-1, 2)
        return Roadmap(self._rows.copy(), edges, self._scale, self._conditions, self._seed, self._spent_s)

    def _candidates(self) -> FloatArray:
        """Returns valid configurations worth a vertex, in random order, shape (n, dimension)."""
        drawn = sample_within_tensions(self._checker, _DRAWN, self._generator)
        found = [
            self._evenly(drawn[self._checker.valid(drawn)], _SHARE),
            self._evenly(self._bridges(), _SHARE),
            self._seldom()[:_SHARE],
        ]
        if self.vertices:
            found.append(self._evenly(self._grown(self._even_chances(self._rows)), _SHARE))
            found.append(self._farthest(self._grown(self._lonely_chances()), _SHARE))
        return np.asarray(self._generator.permutation(np.concatenate(found)))

    def _farthest(self, rows: FloatArray, count: int) -> FloatArray:
        """Returns the rows that lie farthest from what is known, `count` at most."""
        if len(rows) <= count:
            return rows
        distance, _ = self._tree.query(rows * self._scale)
        return np.asarray(rows[np.argsort(-distance, kind="stable")[:count]])

    def _evenly(self, rows: FloatArray, count: int) -> FloatArray:
        """Returns `count` rows at most, spread evenly over the insertions that occur."""
        if len(rows) <= count:
            return rows
        return np.asarray(rows[self._generator.choice(len(rows), count, replace=False, p=self._even_chances(rows))])

    def _even_chances(self, rows: FloatArray) -> FloatArray:
        """Returns a chance a row, shape (n,), by which every range of insertion that occurs is equally likely."""
        ranges = self._ranges(rows)
        chances = 1.0 / np.bincount(ranges)[ranges]
        return np.asarray(chances / chances.sum())

    def _ranges(self, rows: FloatArray) -> IntArray:
        """Returns the number of the range of insertion of each row, shape (n,); zeros for a base that stands."""
        space = self._checker.space
        if not space.has_insertion:
            return np.zeros(len(rows), dtype=np.int64)
        low, high = space.lower[space.bending_count], space.upper[space.bending_count]
        share = (space.insertion(rows) - low) / (high - low)
        return np.minimum((share * _RANGES).astype(np.int64), _RANGES - 1)

    def _seldom(self) -> FloatArray:
        """Returns valid configurations from a range of insertion that has few vertices."""
        space = self._checker.space
        if not space.has_insertion:
            return np.empty((0, self._dimension))
        chances = 1.0 / (1.0 + np.bincount(self._ranges(self._rows), minlength=_RANGES))
        chosen = self._generator.choice(_RANGES, p=chances / chances.sum())
        drawn = sample_within_tensions(self._checker, _SELDOM * _DRAWN, self._generator)
        low, high = space.lower[space.bending_count], space.upper[space.bending_count]
        share = (chosen + self._generator.uniform(size=len(drawn))) / _RANGES
        drawn[:, space.bending_count] = low + share * (high - low)
        return np.asarray(drawn[self._checker.valid(drawn)])

    def _bridges(self) -> FloatArray:
        """Returns valid middles of pairs of invalid configurations."""
        ends = sample_within_tensions(self._checker, _DRAWN, self._generator)
        ends = ends[~self._checker.valid(ends)]
        others = self._within(ends + self._generator.normal(size=ends.shape) * self._reach / self._scale)
        blocked = ~self._checker.valid(others)
        middles = 0.5 * (ends[blocked] + others[blocked])
        return np.asarray(middles[self._checker.valid(middles)])

    def _grown(self, chances: FloatArray) -> FloatArray:
        """Returns valid configurations around vertices that are chosen by chances, shape (vertices,)."""
        roots = self._generator.choice(self.vertices, size=_DRAWN, p=chances)
        size = self._reach * 2.0 ** self._generator.uniform(-_HALVINGS, 0.0, (_DRAWN, 1))
        steps = size * self._generator.normal(size=(_DRAWN, self._dimension))
        ends = self._within(self._rows[roots] + steps / self._scale)
        return np.asarray(ends[self._checker.valid(ends)])

    def _lonely_chances(self) -> FloatArray:
        """Returns a chance a vertex that grows with the volume up to its nearest few."""
        if not len(self._volumes) or self.vertices > _STALE * len(self._volumes):
            count = min(_FEW + 1, self.vertices)
            distance = self._tree.query(self._rows * self._scale, k=[count])[0][:, 0]
            self._volumes = np.maximum(distance, 1e-9) ** self._dimension
        volumes = np.full(self.vertices, np.median(self._volumes))
        volumes[: len(self._volumes)] = self._volumes
        return np.asarray(volumes / volumes.sum())

    def _within(self, rows: FloatArray) -> FloatArray:
        return np.clip(rows, self._checker.space.lower, self._checker.space.upper)

    def _add(self, rows: FloatArray, deadline: float = math.inf) -> None:
        """Adds valid configurations as vertices and joins them to their nearest."""
        from scipy.spatial import cKDTree

        if not len(rows):
            return
        before = self.vertices
        self._rows = np.concatenate([self._rows, rows])
        self._tree = cKDTree(self._rows * self._scale)
        links = self._links()
        _, near = self._tree.query(rows * self._scale, k=min(links + 1, self.vertices))
        for offset, neighbours in enumerate(np.atleast_2d(near).tolist()):
            vertex, reached = before + offset, 0
            for other in neighbours:
                if other >= vertex or reached >= _MOST_LINKS:
                    continue
                if time.monotonic() >= deadline:
                    return
                if self._edges.check_edge(self._rows[other], self._rows[vertex]):
                    self._joined.append((other, vertex))
                    reached += 1

    def _links(self) -> int:
        """Returns how many nearest vertices PRM* tries at this size."""
        return max(1, math.ceil(math.e * (1.0 + 1.0 / self._dimension) * math.log(max(self.vertices, 2))))
