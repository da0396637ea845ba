"""Relaxation: batches of configurations moved to where the body has room, and to a tip's goal where there is one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.part_room import HELD, room_slopes
from tdcr_planner.planning.validity import ValidityChecker

Residuals = Callable[[FloatArray, FloatArray], FloatArray]

_DIFFERENCE_M = 2e-4  # body motion of a finite difference: above float32 noise, below the gaps of narrow places
_DAMPING = 1e-2
_NO_SHAPE = 1e6  # stands for the deficit of a row without a shape


@dataclass(frozen=True)
class Relaxed:
    """What a relaxation has come to.

    Attributes:
        rows: The configurations, shape (n, dimension).
        rooms: Least room of each body, shape (n,), m, at most what was wanted; see `CollisionScene.part_rooms`.
        costs: Sum of squares that was minimised, shape (n,).
        residuals: The goal's residuals, shape (n, 0, 3 or 6).
    """

    rows: FloatArray
    rooms: FloatArray
    costs: FloatArray
    residuals: FloatArray

    def take(self, places: IntArray) -> Relaxed:
        """Returns the rows at some places."""
        return Relaxed(self.rows[places], self.rooms[places], self.costs[places], self.residuals[places])


@dataclass
class _Evaluated:
    """Configurations' residuals (n, width of the goal's + q), least rooms (n,), and what their slopes follow from."""

    residuals: FloatArray
    rooms: FloatArray
    width: int
    positions: FloatArray
    rotations: FloatArray
    held: FloatArray | None

    def take(self, places: IntArray | BoolArray) -> _Evaluated:
        held = None if self.held is None else self.held[places]
        return _Evaluated(
            self.residuals[places], self.rooms[places], self.width, self.positions[places], self.rotations[places], held
        )

    def put(self, places: IntArray, other: _Evaluated) -> None:
        self.residuals[places], self.rooms[places] = other.residuals, other.rooms
        self.positions[places], self.rotations[places] = other.positions, other.rotations
        if self.held is not None:
            self.held[places] = other.held


class Relaxation:
    """Moves configurations by damped least squares to where every part of the body has the room that is wanted.

    Each part that lacks room is a residual, its deficit over `unit`; what a goal asks for are residuals beside them.
    The steps are those of Levenberg and Marquardt, the shortest in body motion, with differences of the shape model.
    Many rows move at once. Where less room than wanted exists the deficits balance, which centres the body.

    Attributes:
        checker: The validity checker whose model, limits and scene are used.
        wanted: Room that parts are moved to have beyond their margins, m.
        evaluated: How many shapes it has asked for.
    """

    def __init__(
        self, checker: ValidityChecker, wanted: float, unit: float, residuals: Residuals | None = None
    ) -> None:
        """Prepares the relaxation.

        Args:
            checker: The validity checker; its scene must offer `part_rooms`, see `offers_room`.
            wanted: Room that parts are to have beyond their margins, m.
            unit: Deficit that weighs as much as a residual of 1, m.
            residuals: Gives further residuals, shape (n, k), for positions (n, d, 3) and rotations (n, d, 3, 3).
        """
        self.checker = checker
        self.wanted = wanted
        self._unit = unit
        self._residuals = residuals
        self.evaluated = 0

    def measure(self, rows: FloatArray) -> Relaxed:
        """Returns rows (n, dimension) as they are, with their rooms, costs and residuals."""
        state = self._evaluate(rows)
        return Relaxed(rows, state.rooms, (state.residuals**2).sum(axis=1), state.residuals[:, : state.width])

    def relax(self, rows: FloatArray, *, rounds: int, longest: float, fixed: Sequence[int] = ()) -> Relaxed:
        """Returns rows moved to more room and nearer to the goal; each is at least as good as it was.

        Args:
            rows: Shape (n, dimension).
            rounds: Most steps of a row.
            longest: Longest step, m of body motion.
            fixed: Columns that stay as they are.
        """
        best = rows.copy()
        state = self._evaluate(best, with_slopes=True)
        costs = (state.residuals**2).sum(axis=1)
        damping = np.full(len(rows), _DAMPING)
        free = np.array([column for column in range(rows.shape[1]) if column not in fixed])
        active = np.flatnonzero(costs > 0.0)
        for _ in range(rounds):
            if not len(active):
                break
            moves = self._step(best[active], state.take(active), damping[active], free, longest)
            tried = best[active]
            tried[:, free] += moves
            tried = within_limits(self.checker, tried)
            found = self._evaluate(tried, with_slopes=True)
            found_costs = (found.residuals**2).sum(axis=1)
            better = found_costs < costs[active]
            gained = np.where(better, 1.0 - found_costs / np.maximum(costs[active], 1e-300), 0.0)
            moved = active[better]
            best[moved], costs[moved] = tried[better], found_costs[better]
            state.put(moved, found.take(better))
            damping[active] = np.clip(np.where(better, 0.3 * damping[active], 8.0 * damping[active]), 1e-6, 1e6)
            # A row that gains next to nothing is at its best; one that failed tries again with more damping.
            settled = (better & (gained < 1e-3)) | (damping[active] > 1e3) | (costs[active] <= 1e-12)
            active = active[~settled]
        return Relaxed(best, state.rooms, costs, state.residuals[:, : state.width])

    def _evaluate(self, rows: FloatArray, *, with_slopes: bool = False) -> _Evaluated:
        self.evaluated += len(rows)
        positions, rotations, solved = self._poses(rows)
        held = None
        if with_slopes:
            held = np.zeros((len(rows), len(self.checker.scene.body.part_names), HELD))  # type: ignore[attr-defined]
        rooms = self.checker.scene.part_rooms(positions, rotations, self.wanted, held)  # type: ignore[attr-defined]
        deficits = (self.wanted - rooms) / self._unit
        goal = np.empty((len(rows), 0)) if self._residuals is None else self._residuals(positions, rotations)
        residuals = np.concatenate([goal, deficits], axis=1)
        residuals[~solved] = _NO_SHAPE
        least = np.where(solved, rooms.min(axis=1), -np.inf)
        return _Evaluated(residuals, least, goal.shape[1], positions, rotations, held)

    def _poses(self, rows: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        positions, rotations, solved = self.checker.world_poses(rows)
        if not solved.all():
            # A row without a shape has no poses: what stands there may be any number.
            positions[~solved], rotations[~solved] = np.nan, np.nan
        return positions, rotations, solved

    def _step(
        self, rows: FloatArray, state: _Evaluated, damping: FloatArray, free: FloatArray, longest: float
    ) -> FloatArray:
        """Returns the damped step of each row in the free columns, shape (n, free).

        Differences give how the disks move; how far each part is from the walls follows the disks that it hangs on.
        """
        count, dimension = rows.shape
        scale = self.checker.motion_scale[free]
        shifts = np.zeros((len(free), dimension))
        shifts[np.arange(len(free)), free] = _DIFFERENCE_M / scale
        positions, rotations, solved = self._poses((rows[:, None, :] + shifts).reshape(-1, dimension))
        slope = np.zeros((count, len(free), state.residuals.shape[1]))
        if self._residuals is not None:
            shifted = self._residuals(positions, rotations).reshape(count, len(free), -1)
            slope[:, :, : state.width] = shifted - state.residuals[:, None, : state.width]
        room_slopes(
            state.held, state.residuals[:, state.width :] > 0.0, state.positions, state.rotations,
            positions.reshape(count, len(free), -1, 3), rotations.reshape(count, len(free), -1, 3, 3),
            slope[:, :, state.width :],
        )  # fmt: skip
        slope[:, :, state.width :] /= -self._unit
        slope /= _DIFFERENCE_M
        usable = solved.reshape(count, -1).all(axis=1) & (np.abs(state.residuals).max(axis=1) < _NO_SHAPE)
        slope[~usable] = 0.0
        normal = slope @ np.swapaxes(slope, 1, 2)
        size = np.trace(normal, axis1=1, axis2=2) / len(free)
        normal += (damping * size + 1e-9)[:, None, None] * np.eye(len(free))
        moves = -np.linalg.solve(normal, slope @ state.residuals[:, :, None])[:, :, 0]
        length = np.linalg.norm(moves, axis=1)
        moves *= np.minimum(1.0, longest / np.maximum(length, 1e-12))[:, None]
        return np.asarray(moves / scale)


def offers_room(checker: ValidityChecker) -> bool:
    """Returns whether a checker's scene can say how much room a body has."""
    return hasattr(checker.scene, "part_rooms")


def within_limits(checker: ValidityChecker, rows: FloatArray) -> FloatArray:
    """Returns rows (n, dimension) within the bounds and, by shrinking bending vectors, within the drive's limits."""
    return checker.space.confined(rows)
