"""Goal states in narrow places: shapes moved to the goal and to room together, and the best where none is free."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.relaxation import Relaxation, Relaxed, Residuals
from tdcr_planner.planning.validity import ValidityChecker

_WANTED = 0.15  # room that shapes are moved to have, in radii of the thinnest disk
_UNIT = 0.3  # lack of room that weighs as much as a goal missed by its tolerance, in such radii
_ROUNDS = 10
_GENERATIONS = 2  # of variations of the best shapes of a search
_KEPT = 48
_LONGEST_M = 0.25  # of the robot's length: longest step
_LEAST_GAIN = 0.02  # of the radius: room that counts as gained
_PATIENCE = 4  # searches without gain after which more promise nothing


class RoomSearch:
    """Searches shapes that reach a goal and have room, in rounds, from many starts each.

    A round takes the most promising of random shapes, by how far they miss the goal and how much room their parts lack,
    and moves them by least squares to the goal and to room together. The best are varied, in one coordinate or in all,
    and moved again.

    Attributes:
        best: The roomiest shape that reaches the goal so far, shape (dimension,), or None.
        room: Its least room, m, below 0 where it collides.
        searches: Rounds so far.
        reaching: The shapes of the last round that reach the goal, shape (k, dimension).
    """

    def __init__(self, checker: ValidityChecker, residuals: Residuals, seed: int) -> None:
        """Prepares the search.

        Args:
            checker: The validity checker; its scene must offer rooms.
            residuals: Errors of the goal for positions and rotations of disks, 1 at the edge of the tolerance.
            seed: Seed of the variations.
        """
        self._checker = checker
        self._radius = float(checker.robot.disk_radii[1:].min())
        self._relaxation = Relaxation(checker, _WANTED * self._radius, _UNIT * self._radius, residuals)
        self._generator = np.random.default_rng(seed)
        self._longest = _LONGEST_M * checker.robot.length
        self.best: FloatArray | None = None
        self.room = -np.inf
        self.searches = 0
        self.reaching: FloatArray = np.empty((0, checker.space.dimension))
        self._idle = 0

    @property
    def evaluated(self) -> int:
        """How many shapes have been looked at."""
        return self._relaxation.evaluated

    @property
    def exhausted(self) -> bool:
        """Whether the last rounds have gained nothing."""
        return self._idle >= _PATIENCE

    def search(self, samples: FloatArray, near: FloatArray, kept: int = _KEPT) -> FloatArray:
        """Runs a round and returns shapes that reach the goal, the roomiest first, shape (n, dimension).

        Args:
            samples: Random shapes, shape (m, dimension).
            near: Shapes that reach the goal already, shape (k, dimension).
            kept: How many shapes are moved.
        """
        self.searches += 1
        measured = self._relaxation.measure(np.concatenate([near, samples]))
        relaxed = self._relax(_best(measured, kept).rows)
        for _ in range(_GENERATIONS):
            if self._reaching(relaxed).rooms.max(initial=-np.inf) > 0.0:
                break
            parents = _best(relaxed, max(kept // 4, 1)).rows
            relaxed = _best(_joined(relaxed, self._relax(self._varied(parents, kept))), kept)
        reaching = self._reaching(relaxed)
        self._remember(reaching)
        self.reaching = reaching.rows[np.argsort(-reaching.rooms, kind="stable")]
        return self.reaching

    def _relax(self, rows: FloatArray) -> Relaxed:
        return self._relaxation.relax(rows, rounds=_ROUNDS, longest=self._longest)

    def _reaching(self, relaxed: Relaxed) -> Relaxed:
        """Returns those within the tolerances: a position and, behind it, a direction."""
        within = np.linalg.norm(relaxed.residuals[:, :3], axis=1) <= 1.0
        within &= np.linalg.norm(relaxed.residuals[:, 3:], axis=1) <= 1.0
        return relaxed.take(np.flatnonzero(within))

    def _varied(self, parents: FloatArray, count: int) -> FloatArray:
        """Returns variations of shapes, half of them in one coordinate and half in all, shape (count, dimension)."""
        rows = parents[self._generator.integers(len(parents), size=count)]
        moves = self._generator.normal(size=rows.shape)
        moves *= 0.5 * self._longest * self._generator.uniform(size=(count, 1)) ** 2
        single = np.arange(count) % 2 == 0
        chosen = self._generator.integers(rows.shape[1], size=count)
        moves[single] *= 2.0 * (np.arange(rows.shape[1]) == chosen[single, None])
        return rows + moves / self._checker.motion_scale

    def _remember(self, reaching: Relaxed) -> None:
        self._idle += 1
        if not len(reaching.rows):
            return
        best = int(np.argmax(reaching.rooms))
        if reaching.rooms[best] > self.room + _LEAST_GAIN * self._radius:
            self._idle = 0
        if reaching.rooms[best] > self.room:
            self.best, self.room = reaching.rows[best], float(reaching.rooms[best])


def _best(relaxed: Relaxed, count: int) -> Relaxed:
    return relaxed.take(np.argsort(relaxed.costs, kind="stable")[:count])


def _joined(one: Relaxed, other: Relaxed) -> Relaxed:
    return Relaxed(
        np.concatenate([one.rows, other.rows]),
        np.concatenate([one.rooms, other.rooms]),
        np.concatenate([one.costs, other.costs]),
        np.concatenate([one.residuals, other.residuals]),
    )
