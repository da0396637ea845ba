"""Edges: whether the straight motion between two configurations is valid, without a gap that anything fits into."""

from __future__ import annotations

import itertools
import math
from collections import deque
from functools import lru_cache

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.planning.causes import CAUSES, Cause
from tdcr_planner.planning.kernels import disk_motions, fill_intervals
from tdcr_planner.planning.proved_edges import ProvedEdges
from tdcr_planner.planning.validity import Scene, Shapes, ValidityChecker, disk_reaches

_COARSE_STEPS = 4.0  # spacing of the first states of an edge, in steps
_WIDEST_STEPS = 8.0  # motion, in steps, above which an interval is split however much room there is
_EXACT_STEPS = 1.0  # motion, in steps, above which distances are not measured: a split costs less
_SPLITS = 64.0  # steps over the motion at which an edge counts as blocked
_FINEST_M = 2e-6  # the same as an absolute motion: twice what the collision tests resolve
_MOST_PIECES = 4  # of an interval at once
_MOST_ROUNDS = 40
_MOST_STATES = 50_000
_REMEMBERED = 200_000


class EdgeChecker:
    """Checks edges by conservative advancement: long steps where there is room, short ones beside walls.

    What is guaranteed. Let m be the clearance asked for plus the model's error bound. Each state taken keeps m
    (`planning_margins`), and of each part of the body a lower bound c on its slack, what it keeps beyond m, is known.
    Where the points of the part stray from two neighbouring states by L, both added up, its slack in between is at
    least (c_i + c_j - L) / 2 (Schwarzer, Saha and Latombe 2005, "Adaptive dynamic collision checking for single and
    multiple articulated robots in complex environments"). An interval is proved where that is 0 or more for every
    part, else it is split, down to a motion of step / 64, where the edge counts as blocked. The points between two
    disks (backbone, tendons, sleeve) lie on straight lines between disk points and move no farther than the farther
    end, the shaft follows disk 0.

    What it rests on. The bound on the motion between two states (`kernels.disk_motions`) takes the curvature of the
    motion from second differences at the spacing of the states, doubled. It holds for shape models that do not change
    their mind between two states; a model that jumps between two equilibria has no bound at any spacing.

    A part of an edge that is proved is not tested again (`proved_edges`).

    The end state is tested first, then states in between, and the first one found to hit ends it; only the states up
    to that one count as checked.

    Attributes:
        checker: The validity checker that it asks.
        step: Largest motion of a point of the body between the states of a path as written, m; an edge's first states
            stand some steps apart.
        resolution: Motion below which an interval that is not proved counts as blocked, m.
        edges_checked: How many edges it has tested.
        edges_rejected: How many of them were rejected.
    """

    def __init__(self, checker: ValidityChecker, step: float) -> None:
        """Prepares the edge checker for a step in metres."""
        self.checker = checker
        self.step = float(step)
        self.resolution = max(self.step / _SPLITS, _FINEST_M)
        self.edges_checked = 0
        self.edges_rejected = 0
        self._reaches = disk_reaches(checker.robot)
        self._known: set[bytes] = set()
        self._proved = ProvedEdges()

    def state_valid(self, row: FloatArray) -> bool:
        """Returns whether one state is valid, and remembers it when it is."""
        key = row.tobytes()
        if key in self._known:
            return True
        if self.checker.check(row[None])[0] != 0:
            return False
        self._remember(key)
        return True

    def check_edge(self, row_a: FloatArray, row_b: FloatArray) -> bool:
        """Returns whether every state of the straight motion from row_a to row_b, both included, is valid.

        Args:
            row_a: Start, shape (dimension,).
            row_b: End, shape (dimension,).
        """
        self.edges_checked += 1
        valid = self._proved.contain(row_a, row_b, self.checker.motion_scale) or self._edge_valid(row_a, row_b)
        if valid:
            self._proved.add(row_a, row_b)
        self.edges_rejected += not valid
        return valid

    def subdivide(self, row_a: FloatArray, row_b: FloatArray, step: float | None = None) -> FloatArray:
        """Returns states from row_a to row_b, both included, between which no point of the body moves more than step.

        Validity is not tested. Rows without a shape have no poses to measure; the motion beside them counts as zero.

        Args:
            row_a: Start, shape (dimension,).
            row_b: End, shape (dimension,).
            step: Largest motion, m; None for the checker's own.

        Returns:
            Shape (n, dimension), n of 2 or more.
        """
        size = self.step if step is None else float(step)
        along = np.linspace(0.0, 1.0, self._coarse(row_a, row_b, size) + 1)
        for _ in range(_MOST_ROUNDS):
            positions, rotations, _ = self.checker.world_poses(_between(row_a, row_b, along))
            order = np.arange(len(along))
            motions, _ = disk_motions(positions, rotations, along, order, self._reaches)
            motion = np.nan_to_num(motions).max(axis=1)
            added = fill_intervals(along, order, motion, np.full(len(motion), size), _MOST_STATES)
            if not len(added) or len(along) + len(added) > _MOST_STATES:
                break
            along = np.sort(np.concatenate([along, added]))
        return _between(row_a, row_b, along)

    def densify(self, rows: FloatArray, step: float | None = None) -> FloatArray:
        """Returns the states of a whole path, waypoints (k, dimension) included, at most step apart."""
        parts = [rows[:1]]
        for row_a, row_b in itertools.pairwise(rows):
            parts.append(self.subdivide(row_a, row_b, step)[1:])
        return np.concatenate(parts)

    def path_valid(self, rows: FloatArray) -> bool:
        """Returns whether every edge of a path of waypoints (k, dimension) is valid."""
        if len(rows) == 1:
            return self.state_valid(rows[0])
        return all(self.check_edge(a, b) for a, b in itertools.pairwise(rows))

    def _edge_valid(self, row_a: FloatArray, row_b: FloatArray) -> bool:
        checker = self.checker
        key_a, key_b = row_a.tobytes(), row_b.tobytes()
        # Ends that are known stand first, to be skipped; else the far one does.
        known_a, known_b = key_a in self._known, key_b in self._known
        along, order = _ends_first(self._coarse(row_a, row_b, self.step), known_a)
        shapes = checker.shapes(_between(row_a, row_b, along))
        if shapes.codes.any():
            checker.count(shapes.codes)
            return False
        scene = checker.scene_for(shapes)
        # What is known was tested at its own margin; an edge keeps the largest of its states'.
        first = known_a + known_b if shapes.levels is None else 0
        if not self._all_free(shapes, first, scene):
            return False
        self._remember(key_a)
        self._remember(key_b)
        return self._between_free(row_a, row_b, shapes, along, order, scene)

    def _between_free(
        self, row_a: FloatArray, row_b: FloatArray, shapes: Shapes, along: FloatArray, order: IntArray, scene: Scene
    ) -> bool:
        """Returns whether all that lies between the free states of an edge is shown to be free, adding states to them.

        Args:
            row_a: Start, shape (dimension,).
            row_b: End, shape (dimension,).
            shapes: The states that are known to be free.
            along: Where on the edge they lie, shape (n,).
            order: What puts them in order, shape (n,).
            scene: The scene with the margins that they keep.
        """
        checker, prover = self.checker, scene.prover
        record = prover.record(len(along))
        while True:
            motion, stray = disk_motions(shapes.positions, shapes.rotations, along, order, self._reaches)
            room, moved = prover.open_intervals(
                shapes.positions, shapes.rotations, order, motion, stray, record, _EXACT_STEPS * self.step
            )
            blocked = (moved > 0.0) & (moved <= self.resolution)
            wide = (moved == 0.0) & (motion.max(axis=1) > _WIDEST_STEPS * self.step)
            moved[wide], room[wide] = motion[wide].max(axis=1), _WIDEST_STEPS * self.step
            added = fill_intervals(along, order, moved, room, _MOST_PIECES)
            if not len(added):
                return True
            if blocked.any() or len(along) + len(added) > _MOST_STATES:
                checker.rejected[Cause.EDGE] += 1
                return False
            added = added[_middles_first(len(added))]
            tested = checker.shapes(_between(row_a, row_b, added))
            if tested.codes.any():
                checker.count(tested.codes)
                return False
            along = np.concatenate([along, added])
            order = np.argsort(along, kind="stable")
            shapes = _join(shapes, tested)
            wider = checker.scene_for(shapes)
            if not self._all_free(tested if wider is scene else shapes, 0, wider):
                return False
            record = record.extended(len(added))
            if wider is not scene:
                scene, prover = wider, wider.prover
                record = prover.record(len(along))

    def _all_free(self, shapes: Shapes, first: int, scene: Scene) -> bool:
        """Asks a scene about states, from `first` on, that no cheaper test has rejected, and counts them."""
        hit, code = scene.find_hit(shapes.positions[first:], shapes.rotations[first:])
        if hit < 0:
            self.checker.states_checked += len(shapes.codes) - first
            return True
        self.checker.states_checked += hit + 1
        self.checker.rejected[CAUSES[code - 1]] += 1
        return False

    def _coarse(self, row_a: FloatArray, row_b: FloatArray, step: float) -> int:
        """Returns into how many even intervals the first states split the edge: some steps wide, 2 at least."""
        motion = float(np.abs((row_b - row_a) * self.checker.motion_scale).sum())
        if not math.isfinite(motion):
            return 2
        return min(max(2, math.ceil(motion / (_COARSE_STEPS * step))), _MOST_STATES // 2)

    def _remember(self, key: bytes) -> None:
        if len(self._known) >= _REMEMBERED:
            self._known.clear()
        self._known.add(key)


@lru_cache(maxsize=256)
def _ends_first(intervals: int, start_first: bool) -> tuple[FloatArray, IntArray]:
    """Returns the parameters of the ends of even intervals, and what puts them in order; neither is to be written to.

    The two ends of the edge stand first, its start or its far end before the other, then the middle of what is widest.
    """
    even = np.linspace(0.0, 1.0, intervals + 1)
    ends = [0, intervals] if start_first else [intervals, 0]
    places = np.concatenate([ends, 1 + _middles_first(intervals - 1)])
    return even[places], np.argsort(places)


@lru_cache(maxsize=256)
def _middles_first(count: int) -> IntArray:
    """Returns the numbers below count, the middle one first, then those of the halves, and so on."""
    places, halves = [], deque([(0, count)])
    while halves:
        low, high = halves.popleft()
        if low < high:
            middle = (low + high) // 2
            places.append(middle)
            halves += [(low, middle), (middle + 1, high)]
    return np.array(places, dtype=np.int64)


def _between(row_a: FloatArray, row_b: FloatArray, along: FloatArray) -> FloatArray:
    """Returns the states at parameters (n,) of an edge, its ends exactly those given, shape (n, dimension)."""
    rows = row_a + along[:, None] * (row_b - row_a)
    rows[along == 1.0] = row_b
    return np.asarray(rows)


def _join(old: Shapes, new: Shapes) -> Shapes:
    return Shapes(
        np.concatenate([old.codes, new.codes]),
        np.concatenate([old.positions, new.positions]),
        np.concatenate([old.rotations, new.rotations]),
        None if old.levels is None or new.levels is None else np.concatenate([old.levels, new.levels]),
    )
