"""The survey: which points can be seen from valid states, and the states that see them."""

from __future__ import annotations

import time

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.inspection.visibility import Visibility
from tdcr_planner.planning.validity import ValidityChecker, sample_within_tensions

_BATCH = 1024  # states drawn at large for a batch; twice as many are drawn around known views
_SLOW_BATCH = 128  # the same for the reference, which takes a quarter of a millisecond a state
_REACH = 0.15  # longest step from a known view, in robot lengths of body motion
_HALVINGS = 6  # how often the longest step is halved at most
_ENOUGH = 30  # views of a point above which another is kept only for what else it sees
_MOST_VIEWS = 20_000
_KEPT_SHAPES = 3_000  # shapes that collide, kept to say why points are not seen


class Survey:
    """Collects views: valid states that see points, many of what is seldom seen.

    States are drawn over the whole space and, by small random steps, around views that see what few others see, so
    that what lies beside points that are not seen is looked at from all sides.

    Attributes:
        rows: Configurations of the views, shape (n, dimension).
        seen: What each of them sees, shape (n, p).
        counts: How many valid states have seen each point, shape (p,).
        states: How many valid states were looked from.
    """

    def __init__(self, checker: ValidityChecker, visibility: Visibility, seed: int) -> None:
        """Prepares a survey; nothing is drawn yet."""
        self.checker = checker
        self.visibility = visibility
        self.states = 0
        points = len(visibility.targets)
        self.rows: FloatArray = np.empty((0, checker.space.dimension))
        self.seen: BoolArray = np.empty((0, points), dtype=np.bool_)
        self.counts: IntArray = np.zeros(points, dtype=np.int64)
        self.blocked: list[tuple[FloatArray, FloatArray]] = []
        self._free: list[tuple[FloatArray, FloatArray]] = []
        self._generator = np.random.default_rng(seed)
        self._reach = _REACH * checker.robot.length
        self._batch = _SLOW_BATCH if checker.model.name == "reference" else _BATCH

    def add(self, rows: FloatArray) -> None:
        """Looks from configurations, shape (n, dimension), and keeps those valid ones that see what few others see."""
        shapes = self.checker.shapes(rows)
        known = shapes.codes == 0
        self.checker.collide(shapes)
        self.checker.count(shapes.codes)
        valid = np.flatnonzero(shapes.codes == 0)
        self._remember(shapes.positions, shapes.rotations, known, valid)
        if not len(valid):
            return
        seen = self.visibility.seen(shapes.positions[valid], shapes.rotations[valid])
        self.states += len(valid)
        seldom = (seen & (self.counts < _ENOUGH)).any(axis=1)
        self.counts += seen.sum(axis=0)
        self.rows = np.concatenate([self.rows, rows[valid][seldom]])
        self.seen = np.concatenate([self.seen, seen[seldom]])
        if len(self.rows) > _MOST_VIEWS:
            self._drop()

    def _remember(self, positions: FloatArray, rotations: FloatArray, known: BoolArray, valid: IntArray) -> None:
        """Keeps some tip poses, of states that collide and of those that do not, for `causes`."""
        hit = known.copy()
        hit[valid] = False
        for store, which in ((self.blocked, np.flatnonzero(hit)), (self._free, valid)):
            if sum(len(item[0]) for item in store) < _KEPT_SHAPES and len(which):
                store.append((positions[which, -1:], rotations[which, -1:]))

    def _drop(self) -> None:
        """Leaves out half of the views, those that see least of what is seldom seen."""
        worth = self.seen @ (1.0 / (1.0 + self.counts))
        kept = np.sort(np.argsort(-worth, kind="stable")[: _MOST_VIEWS // 2])
        self.rows, self.seen = self.rows[kept], self.seen[kept]

    def run(self, deadline: float, *, least_batches: int = 1) -> None:
        """Adds batches until a time by time.monotonic(), a few at least."""
        batches = 0
        while batches < least_batches or time.monotonic() < deadline:
            self.add(sample_within_tensions(self.checker, self._batch, self._generator))
            if len(self.rows):
                self.add(self._grown())
            batches += 1

    def _grown(self) -> FloatArray:
        """Returns configurations around views that see what few others see."""
        count = 2 * self._batch
        worth = self.seen @ (1.0 / (1.0 + self.counts) ** 2)
        roots = self._generator.choice(len(self.rows), size=count, p=worth / worth.sum())
        size = self._reach * 2.0 ** self._generator.uniform(-_HALVINGS, 0.0, (count, 1))
        steps = size * self._generator.normal(size=(count, self.rows.shape[1])) / self.checker.motion_scale
        space = self.checker.space
        return np.clip(self.rows[roots] + steps, space.lower, space.upper)

    @property
    def poses_of_free(self) -> tuple[FloatArray, FloatArray]:
        """Some tip poses of states that do not collide, shapes (n, 1, 3), m, and (n, 1, 3, 3)."""
        return _joined(self._free)

    @property
    def poses_of_blocked(self) -> tuple[FloatArray, FloatArray]:
        """Some tip poses of states that collide, shapes (n, 1, 3), m, and (n, 1, 3, 3)."""
        return _joined(self.blocked)


def _joined(poses: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    if not poses:
        return np.empty((0, 1, 3)), np.empty((0, 1, 3, 3))
    positions, rotations = (np.concatenate(part) for part in zip(*poses, strict=True))
    return positions, rotations
