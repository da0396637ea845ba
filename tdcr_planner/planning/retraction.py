"""Retraction: from a state in a narrow place back out of it, as a tree of valid states joined by checked edges."""

from __future__ import annotations

import heapq
import itertools
import time
from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.relaxation import Relaxation

WANTED = 0.5  # room that bodies are centred to have, in radii of the thinnest disk
_LONGEST = 0.05  # of the robot's length: longest step back
_SHORTEST = 0.0015  # of the robot's length: a step that fails at this length has failed
_GROWTH = 1.6
_CANDIDATES = 12
_ROUNDS = 5
_EDGES_TRIED = 3
_MOST_FAILURES = 3  # tries of one state before another one is taken


@dataclass
class _Node:
    row: FloatArray
    parent: int
    step: float
    failures: int = 0


@dataclass(frozen=True)
class Obstacle:
    """What stopped a retraction: the part that lacked most room in the best shape that was tried.

    Attributes:
        row: That shape, (dimension,).
        room: Its room, m, below 0 where it collides.
    """

    row: FloatArray
    room: float


class Retraction:
    """A tree of valid states that grows from a state in a narrow place in the direction of pulling out.

    A step pulls back by a small insertion, and bending and roll are chosen anew in a batch: as they are, continued as
    in the step before, and varied at random; all of them are moved to where the body has room. The roomiest valid one
    that an edge joins becomes a state of the tree. Steps grow while they succeed and are halved where they fail; a
    state from which nothing leads on is varied in place, then given up for the next best. Without insertion a step
    leads to more room.

    Attributes:
        rows: States of the tree, the first its root.
        obstacle: What stopped it last, or None.
        steps: How often it has tried to step.
    """

    def __init__(self, edges: EdgeChecker, root: FloatArray, seed: int) -> None:
        """Prepares the tree of a valid state, shape (dimension,)."""
        checker = edges.checker
        self._edges = edges
        self._checker = checker
        robot, space = checker.robot, checker.space
        self._column = space.bending_count if space.has_insertion else -1
        self._lowest = float(space.lower[self._column]) if space.has_insertion else 0.0
        radius = float(robot.disk_radii[1:].min())
        self._relaxation = Relaxation(checker, WANTED * radius, 0.5 * radius)
        self._generator = np.random.default_rng(seed)
        self._longest, self._shortest = _LONGEST * robot.length, _SHORTEST * robot.length
        self._nodes: list[_Node] = []
        self._open: list[tuple[float, int]] = []
        self.obstacle: Obstacle | None = None
        self.steps = 0
        self._add(root, -1, 0.2 * self._longest)

    @property
    def rows(self) -> list[FloatArray]:
        """The states of the tree, shape (dimension,) each, its root first."""
        return [node.row for node in self._nodes]

    @property
    def finished(self) -> bool:
        """Whether the body is out as far as it can be pulled, or no state leads on."""
        return not self._open or self._open[0][0] <= self._goal_key()

    @property
    def is_out(self) -> bool:
        """Whether a state of the tree is pulled out as far as it can be."""
        return bool(self._open) and self._open[0][0] <= self._goal_key()

    def grow(self, steps: int, deadline: float) -> list[int]:
        """Tries so many steps and returns the numbers of the states that were added."""
        begin = len(self._nodes)
        for _ in range(steps):
            if self.finished or time.monotonic() >= deadline:
                break
            self.steps += 1
            number = self._open[0][1]
            node = self._nodes[number]
            if self._step(number):
                continue
            if node.step > self._shortest:
                node.step *= 0.5
                continue
            node.failures += 1
            if node.failures >= _MOST_FAILURES or not self._vary(number):
                heapq.heappop(self._open)
        return list(range(begin, len(self._nodes)))

    def chain(self, number: int) -> FloatArray:
        """Returns the states from one of the tree to its root, shape (k, dimension)."""
        rows = []
        while number >= 0:
            rows.append(self._nodes[number].row)
            number = self._nodes[number].parent
        return np.array(rows)

    def _goal_key(self) -> float:
        return self._lowest if self._column >= 0 else -self._relaxation.wanted

    def _add(self, row: FloatArray, parent: int, step: float) -> None:
        number = len(self._nodes)
        self._nodes.append(_Node(row, parent, step))
        key = float(row[self._column]) if self._column >= 0 else -float(self._relaxation.measure(row[None]).rooms[0])
        heapq.heappush(self._open, (key, number))

    def _step(self, number: int) -> bool:
        """Tries to pull back from a state by its step; returns whether a state was added."""
        node = self._nodes[number]
        rows, fixed = self._pulled(node), () if self._column < 0 else (self._column,)
        relaxed = self._relaxation.relax(rows, rounds=_ROUNDS, longest=4.0 * node.step, fixed=fixed)
        rows, rooms = relaxed.rows, relaxed.rooms
        if self._column < 0:
            before = self._relaxation.measure(node.row[None]).rooms[0]
            rows, rooms = rows[rooms > before + 1e-6], rooms[rooms > before + 1e-6]
        row = self._first_joined(node.row, rows, rooms)
        if row is None:
            return False
        self._add(row, number, min(_GROWTH * node.step, self._longest))
        return True

    def _vary(self, number: int) -> bool:
        """Adds states beside one from which nothing leads on; returns whether there is any."""
        node = self._nodes[number]
        rows = np.repeat(node.row[None], 2 * _CANDIDATES, axis=0)
        rows = self._varied(rows, self._longest * self._generator.uniform(0.1, 1.0, len(rows)))
        fixed = () if self._column < 0 else (self._column,)
        relaxed = self._relaxation.relax(rows, rounds=_ROUNDS, longest=0.2 * self._longest, fixed=fixed)
        row = self._first_joined(node.row, relaxed.rows, relaxed.rooms)
        if row is None:
            return False
        # Slightly behind the state it stands beside, so that the heap takes it next.
        self._add(row, number, 8.0 * self._shortest)
        return True

    def _pulled(self, node: _Node) -> FloatArray:
        """Returns shapes to be moved to where there is room, (n, dimension)."""
        rows = np.repeat(node.row[None], _CANDIDATES, axis=0)
        if self._column >= 0:
            rows[:, self._column] = max(node.row[self._column] - node.step, self._lowest)
        sizes = node.step * 2.0 ** self._generator.uniform(-2.0, 2.0, _CANDIDATES)
        sizes[:2] = 0.0
        rows = self._varied(rows, sizes)
        if node.parent >= 0 and self._column >= 0:
            last = node.row - self._nodes[node.parent].row
            if last[self._column] < 0.0:
                rows[1] = node.row + last * (rows[0, self._column] - node.row[self._column]) / last[self._column]
        return rows

    def _varied(self, rows: FloatArray, sizes: FloatArray) -> FloatArray:
        """Returns rows moved at random in bending and roll by so much body motion each, shape (n,), m."""
        columns = [column for column in range(rows.shape[1]) if column != self._column]
        moves = self._generator.normal(size=(len(rows), len(columns))) / np.sqrt(len(columns))
        rows[:, columns] += moves * sizes[:, None] / self._checker.motion_scale[columns]
        return rows

    def _first_joined(self, here: FloatArray, rows: FloatArray, rooms: FloatArray) -> FloatArray | None:
        """Returns the roomiest valid row that a valid edge joins to a state; keeps what stopped it otherwise."""
        if not len(rows):
            return None
        order = np.argsort(-rooms, kind="stable")
        best = int(order[0])
        valid = self._checker.valid(rows[order])
        for index in order[valid][:_EDGES_TRIED]:
            if self._edges.check_edge(here, rows[index]):
                return np.asarray(rows[index])
        if not valid.any():
            self.obstacle = Obstacle(rows[best], float(rooms[best]))
        return None


def thinned(edges: EdgeChecker, rows: FloatArray) -> FloatArray:
    """Returns waypoints (k, dimension) of a valid path without those that straight motions pass; ends are kept.

    From each waypoint on, spans are doubled while the straight motion over them is valid.
    """
    kept, here = [0], 0
    while here < len(rows) - 1:
        span = 1
        for doubling in itertools.count(1):
            there = min(here + 2**doubling, len(rows) - 1)
            if there - here <= span or not edges.check_edge(rows[here], rows[there]):
                break
            span = there - here
        here += span
        kept.append(here)
    return np.asarray(rows[kept])
