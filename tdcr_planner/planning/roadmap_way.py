"""Ways through a roadmap: from a start to goal states, every edge checked as the query asks."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.goal import GoalSource
from tdcr_planner.planning.roadmap import Roadmap

_START_LINKS = 3  # motions from a start into each connected part near by
_NEAREST = 32  # vertices tried for a start, and for each goal state
_GOAL_LINKS_TRIED = 120
_WAYS_TRIED = 20  # ways whose edges are checked before the roadmap gives up


class RoadmapConnector:
    """Ways of one query through a roadmap; the planner's `Connector`.

    Attributes:
        roadmap: The roadmap.
        asked: How many ways were asked for.
        answered: How many of them the roadmap had.
    """

    def __init__(self, roadmap: Roadmap) -> None:
        """Prepares the ways of one query."""
        self.roadmap = roadmap
        self.asked = 0
        self.answered = 0

    @property
    def answers(self) -> dict[str, Any]:
        """answered: whether every way that was asked for came from the roadmap; for result.json."""
        return {"answered": self.asked > 0 and self.answered == self.asked}

    def connect(self, edges: EdgeChecker, start: FloatArray, goal: GoalSource, deadline: float) -> FloatArray | None:
        """Returns the waypoints (k, dimension) of a short way from a start to a goal state, or None.

        Start and goal states are linked to vertices near them. Every edge of the way, those of the roadmap included, is
        checked with the query's own checker; one that does not pass (for a repair asks for more than the roadmap was
        made for) is left out and the next shortest way taken.
        """
        self.asked += 1
        way = _Way(self.roadmap, edges, deadline).find(start, goal.rows)
        self.answered += way is not None
        return way


class _Way:
    """One search through a roadmap's graph, extended by a start (numbered behind the vertices) and goal states."""

    def __init__(self, roadmap: Roadmap, edges: EdgeChecker, deadline: float) -> None:
        self._roadmap = roadmap
        self._edges = edges
        self._deadline = deadline
        self._home = len(roadmap.rows)

    def find(self, start: FloatArray, goals: Sequence[FloatArray]) -> FloatArray | None:
        """Returns the waypoints of the shortest way that is found valid, or None."""
        from scipy.sparse.csgraph import dijkstra

        links = self._links(start)
        if not goals:
            return None
        rows = np.concatenate([self._roadmap.rows, start[None]])
        graph = self._extended(start, links)
        tried: dict[tuple[int, int], bool] = {}
        for turn in range(_WAYS_TRIED):
            distances, before = dijkstra(graph, directed=True, indices=self._home, return_predecessors=True)
            end = self._nearest_goal(rows, np.array(goals), distances, tried)
            if end is None:
                return None
            vertex, goal = end
            order = _trace(before, vertex)
            broken = self._first_invalid(rows[order])
            if broken is None:
                return np.concatenate([rows[order], goals[goal][None]])
            if turn == 0:
                self._remove_invalid(graph)
            _remove(graph, order[broken], order[broken + 1])
        return None

    def _remove_invalid(self, graph: Any) -> None:
        """Makes what leads to vertices that the query's checker rejects infinitely long."""
        rejected = np.append(~self._edges.checker.valid(self._roadmap.rows), False)
        graph.data[rejected[graph.indices]] = np.inf

    def _links(self, start: FloatArray) -> list[int]:
        """Returns vertices that a straight motion from the start reaches, some in each connected part near by."""
        found: list[int] = []
        parts: Counter[int] = Counter()
        for vertex in self._roadmap.nearest(start, _NEAREST).tolist():
            part = int(self._roadmap.components[vertex])
            if parts[part] < _START_LINKS and self._valid(start, self._roadmap.rows[vertex]):
                found.append(vertex)
                parts[part] += 1
        return found

    def _extended(self, start: FloatArray, links: list[int]) -> Any:
        """Returns the graph with a vertex for the start, from which its links lead away."""
        graph = self._roadmap.graph
        lengths = [max(self._roadmap.length(start, self._roadmap.rows[vertex]), 1e-12) for vertex in links]
        parts = (
            np.concatenate([graph.data, lengths]),
            np.concatenate([graph.indices, np.array(links, dtype=graph.indices.dtype)]),
            np.append(graph.indptr, graph.indptr[-1] + len(links)),
        )
        from scipy.sparse import csr_array

        return csr_array(parts, shape=(self._home + 1, self._home + 1))

    def _nearest_goal(
        self, rows: FloatArray, goals: FloatArray, distances: FloatArray, tried: dict[tuple[int, int], bool]
    ) -> tuple[int, int] | None:
        """Returns the vertex and the goal of the shortest way whose last motion is valid."""
        candidates: list[tuple[float, int, int]] = []
        for goal, row in enumerate(goals):
            near = np.append(self._roadmap.nearest(row, _NEAREST), self._home)
            near = near[np.isfinite(distances[near])]
            last = np.linalg.norm((rows[near] - row) * self._roadmap.motion_scale, axis=1)
            candidates += zip((distances[near] + last).tolist(), near.tolist(), [goal] * len(near), strict=True)
        for _, vertex, goal in sorted(candidates)[:_GOAL_LINKS_TRIED]:
            pair = vertex, goal
            if pair not in tried:
                tried[pair] = self._valid(rows[vertex], goals[goal])
            if tried[pair]:
                return pair
        return None

    def _first_invalid(self, rows: FloatArray) -> int | None:
        """Returns the first edge of a way that does not pass, or None."""
        for index, (row_a, row_b) in enumerate(pairwise(rows)):
            # The first leads from the start, whose links have been checked.
            if index > 0 and not self._valid(row_a, row_b):
                return index
        return None

    def _valid(self, row_a: FloatArray, row_b: FloatArray) -> bool:
        return time.monotonic() < self._deadline and self._edges.check_edge(row_a, row_b)


def _trace(before: IntArray, vertex: int) -> list[int]:
    """Returns the vertices on the way from the root of a tree of predecessors to a vertex."""
    order = [vertex]
    while before[order[-1]] >= 0:
        order.append(int(before[order[-1]]))
    return order[::-1]


def _remove(graph: Any, first: int, second: int) -> None:
    """Makes an edge of a graph infinitely long, both ways."""
    for here, there in ((first, second), (second, first)):
        span = slice(graph.indptr[here], graph.indptr[here + 1])
        graph.data[span][graph.indices[span] == there] = np.inf
