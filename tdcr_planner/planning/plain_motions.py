"""Plain motions: straight, push then bend, bend then push and the like, tried before any tree is grown."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.relaxation import within_limits
from tdcr_planner.planning.validity import ValidityChecker

_STRAIGHTENING_STEPS = 6
_MOST_STRAIGHT = 4  # goal states nearest to the start that are tried straight
_MOST_GOALS = 8  # and in several legs
_MOST_TRIED = 20  # motions of several legs of which an edge is checked


@dataclass(frozen=True)
class _Motion:
    """A sequence of waypoints (k, dimension) and its length in body motion, m."""

    length: float
    rows: FloatArray


class PlainMotions:
    """Motions of few legs in each of which only some coordinates move.

    From a start to a goal state: directly; pushed, then bent; bent, then pushed; straightened, pushed, bent; pulled
    back, bent, pushed; each also with the roll turned first. Straightened means bent so that the body lies nearest to
    the base's axis under its loads.

    Attributes:
        edges: Validity of edges.
    """

    def __init__(self, edges: EdgeChecker) -> None:
        """Prepares the motions of one query."""
        self.edges = edges
        self._space = edges.checker.space
        self._straight: tuple[FloatArray, float] | None = None

    def connect(
        self, start: FloatArray, goals: Sequence[FloatArray], deadline: float, most: int = _MOST_TRIED
    ) -> FloatArray | None:
        """Returns the waypoints (k, dimension) of the shortest plain motion that is found valid, or None.

        Args:
            start: A valid configuration, shape (dimension,).
            goals: Valid configurations, shape (dimension,) each.
            deadline: When to end, by time.monotonic().
            most: How many motions are tried.
        """
        if not len(goals):
            return None
        scale = self.edges.checker.motion_scale
        apart = np.linalg.norm((np.array(goals) - start) * scale, axis=1)
        nearest = np.argsort(apart, kind="stable")
        for index in nearest[:_MOST_STRAIGHT]:
            if time.monotonic() >= deadline:
                return None
            if self.edges.check_edge(start, goals[int(index)]):
                return np.stack([start, goals[int(index)]])
        motions = [motion for index in nearest[:_MOST_GOALS] for motion in self._motions(start, goals[int(index)])]
        usable = self._with_valid_waypoints(motions)
        for motion in sorted(usable, key=lambda motion: motion.length)[:most]:
            if time.monotonic() >= deadline:
                return None
            # The last leg leads into the narrow place and is the likeliest to fail.
            legs = list(itertools.pairwise(motion.rows))
            if all(self.edges.check_edge(a, b) for a, b in reversed(legs)):
                return motion.rows
        return None

    def _with_valid_waypoints(self, motions: list[_Motion]) -> list[_Motion]:
        """Returns the motions whose inner waypoints are valid, tested in one batch."""
        if not motions:
            return []
        inner = [motion.rows[1:-1] for motion in motions]
        valid = self.edges.checker.valid(np.concatenate(inner))
        ends = np.cumsum([len(rows) for rows in inner])
        return [
            motion for motion, rows, end in zip(motions, inner, ends, strict=True) if valid[end - len(rows) : end].all()
        ]

    def _motions(self, start: FloatArray, goal: FloatArray) -> list[_Motion]:
        """Returns the plain motions of several legs from a start to a goal state, each once."""
        found = []
        starts = [start]
        if self._space.has_roll:
            starts.append(self._mixed(start, start, goal))
        for first in starts:
            before = [start] if first is start else [start, first]
            for via in self._inner(first, goal):
                found.append(np.stack([*before, *via, goal]))
        distinct = {rows.tobytes(): rows for rows in map(_without_standstill, found)}
        return [_Motion(self._length(rows), rows) for rows in distinct.values() if len(rows) > 2]

    def _inner(self, start: FloatArray, goal: FloatArray) -> list[list[FloatArray]]:
        """Returns the waypoints between start and goal of each motion but the straight one."""
        straight_start, straight_goal = self._straightened(start), self._straightened(goal)
        inner = [
            [self._mixed(start, goal, goal)],
            [self._mixed(goal, start, goal)],
            [straight_start, straight_goal],
        ]
        if self._space.has_insertion:
            back = start.copy()
            back[self._space.bending_count] = self._space.lower[self._space.bending_count]
            inner.append([back, self._mixed(goal, back, goal)])
            inner.append([straight_start, self._mixed(straight_start, back, start), self._mixed(goal, back, goal)])
        return inner

    def _mixed(self, bending: FloatArray, insertion: FloatArray, roll: FloatArray) -> FloatArray:
        """Returns the configuration with the bending of one, the insertion of another and the roll of a third."""
        row = bending.copy()
        count = self._space.bending_count
        if self._space.has_insertion:
            row[count] = insertion[count]
        if self._space.has_roll:
            row[-1] = roll[-1]
        return row

    def _straightened(self, row: FloatArray) -> FloatArray:
        """Returns a configuration with the bending that lays the body nearest to the base's axis.

        It is sought at one roll; at others the same bending is meant as seen from the world.
        """
        roll = float(row[-1]) if self._space.has_roll else 0.0
        if self._straight is None:
            self._straight = straightest(self.edges.checker, row), roll
        straight, sought_at = self._straight
        back = roll - sought_at
        turn = np.array([[np.cos(back), np.sin(back)], [-np.sin(back), np.cos(back)]])
        turned = straight.copy()
        bending = self._space.bending(straight[None])[0]
        turned[: self._space.bending_count] = (bending @ turn.T).ravel()
        return self._mixed(within_limits(self.edges.checker, turned[None])[0], row, row)

    def _length(self, rows: FloatArray) -> float:
        return float(np.linalg.norm(np.diff(rows, axis=0) * self.edges.checker.motion_scale, axis=1).sum())


def straightest(checker: ValidityChecker, row: FloatArray) -> FloatArray:
    """Returns a configuration with the bending that brings its disks nearest to the base's axis, loads considered.

    Gauss-Newton steps with differences from zero bending; without loads that is the answer.

    Args:
        checker: Whose model and limits hold.
        row: The configuration whose insertion and roll are kept, shape (dimension,).
    """
    count = checker.space.bending_count
    best = row.copy()
    best[:count] = 0.0
    error = _off_axis(checker, best[None])[0]
    shifts = np.zeros((count, len(row)))
    shifts[:, :count] = np.diag(1e-3 / checker.motion_scale[:count])
    for _ in range(_STRAIGHTENING_STEPS):
        if not np.isfinite(error).all() or np.abs(error).max() < 1e-6:
            break
        slope = (_off_axis(checker, best + shifts) - error) / 1e-3
        move = np.linalg.lstsq(slope.T, -error, rcond=1e-6)[0]
        tried = best.copy()
        tried[:count] += move / checker.motion_scale[:count]
        tried = within_limits(checker, tried[None])[0]
        found = _off_axis(checker, tried[None])[0]
        if not np.isfinite(found).all() or np.linalg.norm(found) > 0.99 * np.linalg.norm(error):
            break
        best, error = tried, found
    return best


def _off_axis(checker: ValidityChecker, rows: FloatArray) -> FloatArray:
    """Returns the disks' coordinates across the base's axis, shape (n, 2 d), m."""
    positions, rotations, solved = checker.world_poses(rows)
    base = rotations[:, 0]
    local = np.einsum("nij,ndi->ndj", base, positions - positions[:, :1])[:, :, :2]
    local[~solved] = np.inf
    return np.asarray(local.reshape(len(rows), -1))


def _without_standstill(rows: FloatArray) -> FloatArray:
    """Returns waypoints without those that equal the one before."""
    moved = np.append(True, (np.diff(rows, axis=0) != 0.0).any(axis=1))
    kept = rows[moved]
    return kept if len(kept) > 1 else rows[[0, -1]]
