"""The view graph: a roadmap's vertices that the start reaches, views joined to them, and the ways between them."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.inspection.survey import Survey
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.roadmap import Roadmap

_TRIED = 10  # nearest vertices to which a view is tried to be joined
_LINKS = 4  # of these that are kept


class ViewGraph:
    """Configurations that can be reached from the start by proven motions, and what is seen from some of them.

    Attributes:
        rows: Configurations, shape (n, dimension); the start is the first.
        views: Vertices that are views, the start first, in the order in which they were added.
        seen: What each of `views` sees, a row of points each.
        reached: Points that some view sees, shape (p,).
    """

    def __init__(self, edges: EdgeChecker, roadmap: Roadmap, start: FloatArray, seen: BoolArray) -> None:
        """Takes the part of a roadmap that the start, its first vertex, is in.

        Args:
            edges: Validity of the motions that join views.
            roadmap: The roadmap.
            start: The start's configuration, shape (dimension,).
            seen: What the start sees, shape (p,).
        """
        self._edges = edges
        self._scale = roadmap.motion_scale
        first = int(np.flatnonzero((roadmap.rows == start).all(axis=1))[0])
        inside = np.flatnonzero(roadmap.components == roadmap.components[first])
        inside = np.concatenate([[first], inside[inside != first]])
        place = np.full(len(roadmap.rows), -1)
        place[inside] = np.arange(len(inside))
        pairs = place[roadmap.edges]
        self.rows: FloatArray = roadmap.rows[inside]
        self._pairs: list[tuple[int, int]] = [(int(a), int(b)) for a, b in pairs[(pairs >= 0).all(axis=1)]]
        self.views: list[int] = [0]
        self.seen: list[BoolArray] = [seen]
        self.reached: BoolArray = seen.copy()
        self._tree = cKDTree(self.rows * self._scale)
        self._refused: set[bytes] = set()
        self._known: set[bytes] = {start.tobytes()}

    def add(self, row: FloatArray, seen: BoolArray, deadline: float) -> bool:
        """Joins a view to the graph; returns whether the start reaches it.

        Args:
            row: Its configuration, shape (dimension,).
            seen: What it sees, shape (p,).
            deadline: When to end, by time.monotonic().
        """
        key = row.tobytes()
        if key in self._known:
            return True
        if key in self._refused:
            return False
        vertex, links = len(self.rows), 0
        count = min(_TRIED, self._tree.n)
        _, near = self._tree.query(row * self._scale, k=count)
        candidates = [*np.atleast_1d(near).tolist(), *self._nearest_views(row)]
        for other in candidates:
            if links >= _LINKS or time.monotonic() >= deadline:
                break
            if self._edges.check_edge(self.rows[other], row):
                self._pairs.append((int(other), vertex))
                links += 1
        if not links:
            self._refused.add(key)
            return False
        self._known.add(key)
        self.rows = np.concatenate([self.rows, row[None]])
        self.views.append(vertex)
        self.seen.append(seen)
        self.reached |= seen
        return True

    def _nearest_views(self, row: FloatArray) -> list[int]:
        """Returns the views nearest to a configuration, two at most."""
        apart = np.linalg.norm((self.rows[self.views] - row) * self._scale, axis=1)
        return [self.views[index] for index in np.argsort(apart, kind="stable")[:2].tolist()]

    def cover(self, survey: Survey, weights: FloatArray, depth: int, deadline: float, first_deadline: float) -> None:
        """Adds views of a survey until every point that they see is seen from `depth` reached views, where it can be.

        Args:
            survey: Where the views come from.
            weights: Of the points, shape (p,).
            depth: From how many views each point is to be seen.
            deadline: When to end, by time.monotonic().
            first_deadline: The same while points are open that no reached view sees.
        """
        counts = np.sum(self.seen, axis=0, dtype=np.int64)
        open_ = np.array([row.tobytes() not in self._refused | self._known for row in survey.rows], dtype=np.bool_)
        for level in range(1, depth + 1):
            while time.monotonic() < (first_deadline if level == 1 else deadline):
                gains = (survey.seen @ np.where(counts < level, weights, 0.0)) * open_
                best = int(gains.argmax()) if len(gains) else 0
                if not len(gains) or gains[best] <= 0.0:
                    break
                open_[best] = False
                if self.add(survey.rows[best], survey.seen[best], first_deadline):
                    counts += survey.seen[best]

    def graph(self) -> Any:
        """Returns the motions' lengths, m, as a sparse matrix (n, n), both ways."""
        first, second = np.array(self._pairs, dtype=np.int64).reshape(-1, 2).T
        lengths = np.linalg.norm((self.rows[first] - self.rows[second]) * self._scale, axis=1)
        both = np.concatenate([first, second]), np.concatenate([second, first])
        size = len(self.rows)
        return csr_array((np.tile(np.maximum(lengths, 1e-12), 2), both), shape=(size, size))

    def ways(self, vertices: list[int]) -> tuple[FloatArray, IntArray]:
        """Returns the shortest ways from some vertices: their lengths, shape (m, n), m, and predecessors, (m, n)."""
        lengths, before = dijkstra(self.graph(), directed=False, indices=vertices, return_predecessors=True)
        return np.asarray(lengths), np.asarray(before, dtype=np.int64)
