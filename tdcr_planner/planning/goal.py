"""Goals: the configurations that end a query, given or found by batched sampling and refinement of the shape model."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.planning.goal_room import RoomSearch
from tdcr_planner.planning.relaxation import offers_room, within_limits
from tdcr_planner.planning.scenario import Goal
from tdcr_planner.planning.shortfall import count_free_without_bound, describe_shortfall
from tdcr_planner.planning.validity import ValidityChecker, sample_within_tensions

_DIFFERENCE_M = 1e-3  # body motion of a finite difference: far above float32 noise, far below the arcs' radii
_LONGEST_STEP_M = 0.05
_REFINEMENTS = 12
_DIVERSITY_M = 0.005
_AIM = 0.05  # refinement stops this near to its aim, as a share of the tolerances
_MOST_ROUNDS = 16  # rounds without a goal state after which no more are promised
_NEAR_KEPT = 48  # shapes that reach the goal and collide, from which a search for room starts
_LEAST_SHARE = 0.3  # of the tolerances, left for aiming beside what the model errs by


class GoalSource(Protocol):
    """Where the search gets goal states from."""

    @property
    def rows(self) -> list[FloatArray]:
        """Valid goal states found so far."""
        ...

    def take(self) -> list[FloatArray]:
        """Returns the valid goal states found since the last call."""
        ...

    def due(self, iterations: int) -> bool:
        """Returns whether it is time to look for more, after so many iterations of the planner."""
        ...

    def search(self) -> None:
        """Looks for more goal states, once."""
        ...

    def unreachable(self) -> str:
        """Returns why the goal cannot be a goal at all; empty when it can, or when nobody knows yet."""
        ...

    def obstruction(self) -> str:
        """Returns what is in the way of a configuration that reaches the goal; empty where none is known."""
        ...

    def exhausted(self) -> bool:
        """Returns whether looking for more goal states has stopped gaining."""
        ...

    def satisfied(self, row: FloatArray) -> bool:
        """Returns whether a configuration, shape (dimension,), reaches the goal."""
        ...


class ConfigurationGoal:
    """A goal that is one configuration."""

    def __init__(self, checker: ValidityChecker, row: FloatArray) -> None:
        """Takes the configuration, shape (dimension,); it is tested at once."""
        self._row = row
        self._problem = checker.explain(row)
        self.rows: list[FloatArray] = [] if self._problem else [row]
        self._taken = False

    def take(self) -> list[FloatArray]:
        """Returns the configuration, once, when it is valid."""
        fresh = [] if self._taken else self.rows
        self._taken = True
        return fresh

    def due(self, iterations: int) -> bool:  # noqa: ARG002
        """Returns false: there is no other state to be found."""
        return False

    def search(self) -> None:
        """Does nothing: the state is given."""

    def unreachable(self) -> str:
        """Returns why the configuration is not valid, naming disk and mesh for a contact."""
        return self._problem

    def obstruction(self) -> str:
        """Returns nothing: an invalid configuration is told by `unreachable`."""
        return ""

    def exhausted(self) -> bool:
        """Returns true: there is no other state to be found."""
        return True

    def satisfied(self, row: FloatArray) -> bool:
        """Returns whether a row is the goal configuration."""
        return bool(np.allclose(row, self._row, rtol=0.0, atol=1e-9))


class TipGoal:
    """A goal for the tip: a position, or a position and a viewing direction.

    Goal states come in rounds. A round samples shapes within the tension limits, takes those whose tip is nearest,
    and moves each to the goal by damped Gauss-Newton steps with differences of the model, all of them in one batch.
    Each ends near where it started, so that they are as diverse as the samples. Half of them aim at the goal itself,
    half at random places within the tolerances, less what the model may err by. What collides is dropped, what lies
    next to a state that is known already is dropped as well.

    Attributes:
        rows: Valid goal states found so far.
        reached: How many configurations were found that reach the goal, valid or not.
        nearest: Errors of the best configuration seen in units of the tolerances, and its tip position, m, world frame.
    """

    def __init__(self, checker: ValidityChecker, goal: Goal, seed: int) -> None:
        """Prepares the goal; the first round is run by the first `search`."""
        assert goal.tip_position_m is not None  # the caller has told the kinds of goal apart
        self._checker = checker
        self._target = np.asarray(goal.tip_position_m, dtype=np.float64)
        self._tolerance = goal.tip_tolerance_m
        self._view: FloatArray | None = None
        if goal.view_direction is not None:
            view = np.asarray(goal.view_direction, dtype=np.float64)
            self._view = view / np.linalg.norm(view)
        self._chord = 2.0 * np.sin(np.deg2rad(goal.view_tolerance_deg) / 2.0)
        self._share = float(np.clip(1.0 - checker.model.error_bound[-1] / self._tolerance, _LEAST_SHARE, 0.9))
        self._generator = np.random.default_rng(seed)
        sparse = not checker.model.is_fast
        self._samples, self._kept, self._moved = (384, 16, 32) if sparse else (2048, 96, 48)
        self._next_due = 32
        self._taken = 0
        self.rounds = 0
        self.rows: list[FloatArray] = []
        self.reached = 0
        self.nearest: tuple[FloatArray, FloatArray] = (np.full(3, np.inf), np.full(3, np.nan))
        self._nearest_row: FloatArray | None = None
        self._blocked: FloatArray | None = None
        self._room: RoomSearch | None = None
        if offers_room(checker):
            self._room = RoomSearch(checker, lambda *poses: self._errors(*poses) / self._share, seed)

    def take(self) -> list[FloatArray]:
        """Returns the valid goal states found since the last call."""
        fresh = self.rows[self._taken :]
        self._taken = len(self.rows)
        return fresh

    def due(self, iterations: int) -> bool:
        """Returns true after 32, 64, 128 ... iterations, so that the share of time spent here falls."""
        if iterations < self._next_due:
            return False
        self._next_due = 2 * iterations
        return True

    def search(self) -> None:
        """Runs one round; valid states that it finds are added to `rows`."""
        self.rounds += 1
        samples = sample_within_tensions(self._checker, self._samples, self._generator)
        residual, _ = self._residuals(samples)
        size = np.linalg.norm(residual, axis=1)
        rows = samples[np.argsort(size, kind="stable")[: self._kept]]
        rows = self._refine(rows, self._aims(len(rows)))
        residual, tips = self._residuals(rows)
        size = np.linalg.norm(residual, axis=1)
        nearest = int(np.argmin(size))
        if size[nearest] < np.linalg.norm(self.nearest[0]):
            self.nearest = (residual[nearest], tips[nearest])
            self._nearest_row = rows[nearest]
        within = self._within(residual, self._share)
        if not (self.reached or within.any()):
            # What the model errs by is kept back from the tolerance only where something is left of it.
            within = self._within(residual, 1.0)
        candidates = rows[within]
        if not self._keep_valid(candidates) and self._room is not None and len(candidates):
            narrow = self._room.search(samples, candidates[:_NEAR_KEPT], self._moved)
            self._keep_valid(narrow[:_NEAR_KEPT])

    def _keep_valid(self, candidates: FloatArray) -> bool:
        """Keeps the valid ones of configurations that reach the goal; returns whether there is any."""
        self.reached += len(candidates)
        if not len(candidates):
            return False
        valid = self._checker.valid(candidates)
        self.rows.extend(self._diverse(candidates[valid]))
        if not valid.all():
            self._blocked = candidates[~valid][0]
        return bool(valid.any())

    def unreachable(self) -> str:
        """Returns the nearest reachable tip position when no round has come within the tolerance, collisions aside."""
        if self.reached or not self.rounds:
            return ""
        residual, tip = self.nearest
        if not np.isfinite(tip).all():
            return (
                "no shape was found for any configuration (statics): is the robot's stiffness right, and are gravity "
                "and tip force loads that it carries?"
            )
        distance = float(np.linalg.norm(tip - self._target))
        angle = np.rad2deg(2.0 * np.arcsin(min(1.0, np.linalg.norm(residual[3:]) * self._chord / 2.0)))
        place = ", ".join(f"{value:.4f}" for value in tip)
        wanted = ", ".join(f"{value:.4f}" for value in self._target)
        return (
            f"no configuration brings the tip to ({wanted}) m within {self._tolerance:g} m"
            + ("" if self._view is None else " looking that way")
            + f"; the nearest that can be reached, collisions aside, is ({place}) m, {distance:.4f} m away"
            + ("" if self._view is None else f", looking {angle:.1f} degrees off")
            + self._insertion_spent()
        )

    def _insertion_spent(self) -> str:
        """Returns that the nearest configuration is inserted as far as the base allows, as the end of a sentence."""
        space = self._checker.space
        if self._nearest_row is None or not space.has_insertion:
            return ""
        inserted, most = self._nearest_row[space.bending_count], space.upper[space.bending_count]
        if inserted < most - 1e-6:
            return ""
        return f", with the base at the end of its insertion of {most:g} m"

    def obstruction(self) -> str:
        """Returns what is in the way of the roomiest configuration that reaches the goal, and how many were tried."""
        blocked, which = self._blocked, "one"
        if self._room is not None and self._room.best is not None:
            blocked, which = self._room.best, "the roomiest"
        if blocked is None:
            return ""
        tried = f"{self.reached} that reach it were tried"
        if self._room is not None and self._checker.model.error_bound.max() > 0.0:
            free = count_free_without_bound(self._checker, self._room.reaching)
            tried += (
                f", {free} of the {len(self._room.reaching)} roomiest would be free without the model's error bound"
            )
        return f"{tried}; in the way of {which}: {describe_shortfall(self._checker, blocked)}"

    def exhausted(self) -> bool:
        """Returns whether the last rounds have brought no goal state and nothing nearer to one."""
        return self._room is not None and (self._room.exhausted or self.rounds >= _MOST_ROUNDS)

    def satisfied(self, row: FloatArray) -> bool:
        """Returns whether a configuration brings the tip within the tolerances."""
        residual, _ = self._residuals(row[None])
        return bool(self._within(residual, 1.0)[0])

    def _residuals(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns errors in units of their tolerance, shape (n, 3 or 6), infinite without a shape, and the tips."""
        positions, rotations, solved = self._checker.world_poses(rows)
        residual = self._errors(positions, rotations)
        residual[~solved] = np.inf
        return residual, positions[:, -1]

    def _errors(self, positions: FloatArray, rotations: FloatArray) -> FloatArray:
        """Returns the errors of shapes in units of their tolerance, shape (n, 3 or 6)."""
        residual = (positions[:, -1] - self._target) / self._tolerance
        if self._view is not None:
            residual = np.concatenate([residual, (rotations[:, -1, :, 2] - self._view) / self._chord], axis=1)
        return residual

    def _within(self, residual: FloatArray, share: float) -> BoolArray:
        inside = np.linalg.norm(residual[:, :3], axis=1) <= share
        if self._view is not None:
            inside &= np.linalg.norm(residual[:, 3:], axis=1) <= share
        return np.asarray(inside)

    def _aims(self, count: int) -> FloatArray:
        """Returns the residuals to aim at, shape (count, 3 or 6): none for the even rows, random ones for the odd."""
        width = 3 if self._view is None else 6
        aims = self._generator.normal(size=(count, width // 3, 3))
        aims /= np.linalg.norm(aims, axis=2)[:, :, None]
        aims *= self._share * self._generator.uniform(size=(count, width // 3, 1)) ** (1.0 / 3.0)
        aims[::2] = 0.0
        return np.asarray(aims.reshape(count, width))

    def _refine(self, rows: FloatArray, aims: FloatArray) -> FloatArray:
        """Returns rows (n, dimension) moved to where their residuals are as near to their aims as they can get."""
        best, best_residual = rows.copy(), self._residuals(rows)[0] - aims
        damping = np.full(len(rows), 1e-3)
        for _ in range(_REFINEMENTS):
            active = np.flatnonzero(~self._within(best_residual, _AIM) & np.isfinite(best_residual).all(axis=1))
            if not len(active):
                break
            moves = self._step(best[active], best_residual[active], aims[active], damping[active])
            tried = within_limits(self._checker, best[active] + moves)
            residual = self._residuals(tried)[0] - aims[active]
            better = np.linalg.norm(residual, axis=1) < np.linalg.norm(best_residual[active], axis=1)
            moved = active[better]
            best[moved], best_residual[moved] = tried[better], residual[better]
            damping[moved] *= 0.3
            damping[active[~better]] *= 10.0
        return best

    def _step(self, rows: FloatArray, residual: FloatArray, aims: FloatArray, damping: FloatArray) -> FloatArray:
        """Returns the damped Gauss-Newton step, the shortest in body motion, at most `_LONGEST_STEP_M` of it."""
        count, dimension = rows.shape
        scale = self._checker.motion_scale
        shifts = np.diag(_DIFFERENCE_M / scale)
        shifted, _ = self._residuals((rows[:, None, :] + shifts).reshape(-1, dimension))
        shifted = shifted.reshape(count, dimension, -1) - aims[:, None, :]
        slope = np.where(np.isfinite(shifted), shifted - residual[:, None, :], 0.0) / _DIFFERENCE_M
        normal = np.swapaxes(slope, 1, 2) @ slope
        size = np.trace(normal, axis1=1, axis2=2) / normal.shape[1]
        normal += (damping * size + 1e-12)[:, None, None] * np.eye(normal.shape[1])
        moves = -(slope @ np.linalg.solve(normal, residual[:, :, None]))[:, :, 0]
        length = np.linalg.norm(moves, axis=1)
        moves *= np.minimum(1.0, _LONGEST_STEP_M / np.maximum(length, 1e-12))[:, None]
        return np.asarray(moves / scale)

    def _diverse(self, rows: FloatArray) -> FloatArray:
        """Returns the rows that are not next to one another or to a known state."""
        scale = self._checker.motion_scale
        known = [row * scale for row in self.rows]
        kept = []
        for row in rows:
            place = row * scale
            if all(np.linalg.norm(place - other) > _DIVERSITY_M for other in known):
                known.append(place)
                kept.append(row)
        return np.array(kept).reshape(-1, rows.shape[1])
