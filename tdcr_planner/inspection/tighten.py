"""Tightening: a shorter path that still sees enough, where every state on the way counts."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.inspection.visibility import Visibility
from tdcr_planner.planning.edges import EdgeChecker

_MOVES = (1.0, 0.6, 0.3, 0.1)  # of the way from a waypoint to the middle of its neighbours
_SHARES = (0.15, 0.5)  # least and largest share of a leg at which a waypoint is moved along it
_LEAST_GAIN = 1e-5  # share of the length
_LOOKS_STEPS = 2.0  # motion between two looks of the search, in steps


class CoveragePath:
    """A path of waypoints with proven motions, and what is seen from the states on each of its legs.

    Attributes:
        rows: Waypoints, shape (k, dimension).
        length: Body motion, m.
        covered: Weight of what is seen.
        seen: Points that are seen, shape (p,).
    """

    def __init__(
        self, edges: EdgeChecker, visibility: Visibility, weights: FloatArray, target: float, rows: FloatArray
    ) -> None:
        """Takes a path.

        Args:
            edges: Validity of motions.
            visibility: What is seen.
            weights: Of the points, shape (p,).
            target: Weight that must be kept; where the path sees less, what it sees.
            rows: Waypoints of a valid path, shape (k, dimension).
        """
        self._edges = edges
        self._visibility = visibility
        self._weights = weights
        self._scale = edges.checker.motion_scale
        self.rows = rows
        self._legs = [self._look(a, b) for a, b in pairwise(rows)] or [self._look(rows[0], rows[0])]
        self._counts = np.sum(self._legs, axis=0, dtype=np.int64)
        self.target = min(target, self.covered)

    @property
    def seen(self) -> BoolArray:
        """Points that are seen, shape (p,)."""
        return np.asarray(self._counts > 0)

    @property
    def covered(self) -> float:
        """Weight of what is seen."""
        return float(self._weights[self.seen].sum())

    @property
    def length(self) -> float:
        """Body motion, m."""
        return self._length(self.rows)

    def tighten(
        self,
        deadline: float,
        generator: np.random.Generator,
        tries: int = 10**9,
        found: Callable[[], None] | None = None,
    ) -> None:
        """Shortens the path until a time by time.monotonic(), and keeps what must be seen.

        Waypoints are left out, moved towards the straight way between their neighbours, or along a leg; corners that
        are not needed vanish with them.

        Args:
            deadline: When to end.
            generator: Of the random choices.
            tries: Largest number of tries.
            found: Told of each shorter path.
        """
        for _ in range(tries):
            if time.monotonic() >= deadline or len(self.rows) < 3:
                return
            index = int(generator.integers(1, len(self.rows) - 1))
            before, here, after = self.rows[index - 1 : index + 2]
            choice = generator.uniform()
            if choice < 0.25:
                changed = self._replace(index - 1, index + 1, np.array([before, after]))
            elif choice < 0.75:
                changed = self._pull(index, generator)
            elif choice < 0.9:
                changed = self._cut(index, generator)
            else:
                spread = 0.1 * generator.uniform() * max(self._length(np.array([before, here, after])), 1e-6)
                step = generator.normal(size=len(here)) * spread / self._scale
                space = self._edges.checker.space
                moved = np.clip(here + step, space.lower, space.upper)
                changed = self._replace(index - 1, index + 1, np.array([before, moved, after]))
            if changed and found is not None:
                found()

    def _pull(self, index: int, generator: np.random.Generator) -> bool:
        """Moves a waypoint towards the straight way between its neighbours, as far as it may."""
        before, here, after = self.rows[index - 1 : index + 2]
        share = generator.uniform(0.2, 0.8)
        straight = before + share * (after - before)
        if generator.uniform() < 0.5:
            chord = (after - before) * self._scale
            along = float(((here - before) * self._scale) @ chord) / max(float(chord @ chord), 1e-18)
            straight = before + min(max(along, 0.0), 1.0) * (after - before)
        for move in _MOVES:
            moved = here + move * (straight - here)
            if self._replace(index - 1, index + 1, np.array([before, moved, after])):
                return True
        return False

    def _cut(self, index: int, generator: np.random.Generator) -> bool:
        """Replaces a waypoint by two on its legs."""
        before, here, after = self.rows[index - 1 : index + 2]
        first, second = generator.uniform(*_SHARES, size=2)
        cut = np.array([before, here + first * (before - here), here + second * (after - here), after])
        return self._replace(index - 1, index + 1, cut)

    def _replace(self, first: int, last: int, rows: FloatArray) -> bool:
        """Replaces the waypoints from first to last where that is shorter, valid and loses too little to matter."""
        old = self.rows[first : last + 1]
        gain = self._length(old) - self._length(rows)
        if gain <= _LEAST_GAIN * max(self.length, 1e-9):
            return False
        legs = [self._look(a, b) for a, b in pairwise(rows)]
        counts = self._counts - np.sum(self._legs[first:last], axis=0) + np.sum(legs, axis=0)
        if float(self._weights[counts > 0].sum()) < self.target:
            return False
        if not all(self._edges.check_edge(a, b) for a, b in pairwise(rows)):
            return False
        self._take(first, last, rows, legs)
        return True

    def detour(self, row: FloatArray) -> bool:
        """Puts a waypoint in where it costs least, if the motions to it are valid; returns whether it was."""
        apart = np.linalg.norm((self.rows - row) * self._scale, axis=1)
        added = apart[:-1] + apart[1:] - np.linalg.norm(np.diff(self.rows, axis=0) * self._scale, axis=1)
        for index in np.argsort(added, kind="stable")[:4].tolist():
            rows = np.array([self.rows[index], row, self.rows[index + 1]])
            if all(self._edges.check_edge(a, b) for a, b in pairwise(rows)):
                self._take(index, index + 1, rows, [self._look(a, b) for a, b in pairwise(rows)])
                return True
        return False

    def _take(self, first: int, last: int, rows: FloatArray, legs: list[BoolArray]) -> None:
        self._counts = self._counts - np.sum(self._legs[first:last], axis=0) + np.sum(legs, axis=0)
        self.rows = np.concatenate([self.rows[:first], rows, self.rows[last + 1 :]])
        self._legs[first:last] = legs

    def _length(self, rows: FloatArray) -> float:
        return float(np.linalg.norm(np.diff(rows, axis=0) * self._scale, axis=1).sum())

    def _look(self, row_a: FloatArray, row_b: FloatArray) -> BoolArray:
        """Returns what is seen from states on a leg, its ends included, shape (p,)."""
        motion = float(np.linalg.norm((row_b - row_a) * self._scale))
        count = max(2, int(np.ceil(motion / (_LOOKS_STEPS * self._edges.step))) + 1)
        along = np.linspace(0.0, 1.0, count)[:, None]
        positions, rotations, known = self._edges.checker.world_poses(row_a + along * (row_b - row_a))
        return np.asarray(self._visibility.seen(positions[known], rotations[known]).any(axis=0))
