"""Verification: the Cosserat reference on every state of a path, independent of the model that found it.

What lies between two neighbouring states is judged as in the search (`collision.prover`), on the reference shapes: a
part of the body is free if balls about it are, all along its straight way, or if its clearances c_i and c_j in the two
states suffice for the distance L_ij that its points move, since anywhere in between its clearance is at least
(c_i + c_j - L_ij) / 2. A path is verified when every part is shown to keep the asked clearance on every gap; gaps where
one is not are halved until it is or the halves say that it never will be.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.planning.kernels import disk_motions
from tdcr_planner.planning.scenario import Goal
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import disk_reaches
from tdcr_planner.query.friction_states import FrictionState, describe_state, friction_states
from tdcr_planner.query.solved_states import SolvedStates, StateSolver
from tdcr_planner.query.verification_report import FrictionSpread, VerificationReport
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.base import ShapeModel

# Halving a gap of step_m this often leaves 1/1024 of it: below that, missing clearance is missing, not unproven. The
# search ends at 1/64, so that what it accepts is not refused here for want of halvings.
MAX_HALVINGS = 10


class _Failure(NamedTuple):
    """Why a path is not verified: the cause, a sentence, the state."""

    cause: str
    message: str
    state: int


def _least(values: FloatArray) -> int:
    """Returns the index of the smallest number; 0 where none is a number."""
    return int(np.argmin(np.where(np.isnan(values), np.inf, values)))


def _judge_time(states: SolvedStates) -> _Failure | None:
    """Returns that the time was over before all states were solved, or None."""
    if states.solved.all():
        return None
    solved, count = int(states.solved.sum()), len(states.rows)
    message = f"the time limit ended the verification after {solved:,} of {count:,} states"
    return _Failure("time", message, int(np.argmin(states.solved)))


def _at(report: VerificationReport, which: IntArray) -> VerificationReport:
    """Returns a report on some of its states alone; what failed is told of the last of them that is not behind it."""
    before = int(np.searchsorted(which, report.worst_state, side="right")) - 1
    arrays = ("converged", "residual", "deviation", "clearance", "in_limits", "positions", "rotations")
    clearance = report.clearance.copy()
    # What was found between two states counts for the one before.
    np.fmin.at(clearance, which[np.searchsorted(which, np.arange(len(clearance)), side="right") - 1], clearance)
    parts = {name: getattr(report, name)[which] for name in arrays} | {"clearance": clearance[which]}
    return replace(report, worst_state=max(before, 0), model_positions=None, **parts)


def _merge(report: VerificationReport, judged: VerificationReport, state: str, count: int) -> VerificationReport:
    """Returns a report on the same states with what another friction state adds to it."""
    clearance = np.fmin(report.clearance, judged.clearance)
    spread = np.linalg.norm(judged.positions - report.positions, axis=2).max(axis=1)
    widest = int(np.argmax(np.nan_to_num(spread)))
    known = report.friction
    friction = known
    if known is None or not known.spread_m >= spread[widest]:
        friction = FrictionSpread(float(spread[widest]), widest, state)
    merged = replace(report, clearance=clearance, friction=friction, worst_state=_least(clearance))
    if judged.verified:
        return merged
    message = f"{judged.message}, {state}" if judged.message else state
    worst = min(judged.worst_state, count - 1)
    return replace(merged, verified=False, cause=judged.cause, message=message, worst_state=worst)


class Verifier:
    """Solves the states of a path with the reference and judges them in a scene.

    Attributes:
        step: No point of the body moves farther between two verified states, m.
        clearance: Distance to be kept from every surface, m.
    """

    def __init__(
        self,
        space: ConfigurationSpace,
        scene: CollisionScene,
        *,
        step: float,
        clearance: float,
        model: ShapeModel | None = None,
        measure: bool = True,
    ) -> None:
        """Prepares verification.

        Args:
            space: The scenario's configurations.
            scene: The scene with the body as it is, without margins.
            step: Largest motion of a body point between two states, m.
            clearance: Distance to be kept from every surface, m.
            model: The shape model that the search asked, for the deviation.
            measure: Whether to measure the clearance of each state; without, one that has the asked clearance is
                stated to have no more. The verdict is the same and several times faster.
        """
        self.space = space
        self.scene = scene
        self.step = step
        self.clearance = clearance
        self.model = model
        self._robot: RobotSpec = space.robot
        self._reaches = disk_reaches(self._robot)
        self._enough = None if measure else clearance
        self._friction_states = friction_states(space.robot)
        self._prover = scene.make_prover(np.full(space.robot.disk_count, clearance))

    def verify(
        self, rows: FloatArray, goals: Sequence[tuple[int, Goal]] = (), *, deadline: float = math.inf
    ) -> tuple[VerificationReport, SolvedStates]:
        """Returns the reference's judgement on a path, and the states it solved for it.

        A robot with friction is judged in every one of its `friction_states`, each along the whole path; the states
        returned are those without friction, and the report's clearance is the least at each of them. Goals are judged
        without friction.

        Args:
            rows: Configurations of the path's states in order, shape (k, dimension); interpolated linearly in between.
            goals: What is to be reached, each with the index of the state that must reach it; where it is a tip
                position, the reference's tip must lie within the tolerances.
            deadline: When to end, by time.monotonic(); a path that is not proved by then is not verified.
        """
        report, states = self._verify_under(None, rows, goals, deadline)
        for friction in self._friction_states[1:]:
            if not report.verified:
                break
            judged, _ = self._verify_under(friction, states.rows, (), deadline)
            report = _merge(report, judged, describe_state(friction), len(states.rows))
        return report, states

    def _verify_under(
        self, friction: FrictionState, rows: FloatArray, goals: Sequence[tuple[int, Goal]], deadline: float
    ) -> tuple[VerificationReport, SolvedStates]:
        """Returns the judgement on a path in one friction state; see `verify`."""
        solver = StateSolver(self.space, self.scene, friction, enough=self._enough)
        states = solver.solve(rows, deadline)
        given = np.ones(len(rows), dtype=np.bool_)
        for number, (index, _) in enumerate(goals):
            states.goals[index] = number
        # Gaps wider than the step get the halvings that lead down to it for free.
        excess = np.maximum(self.body_motion(states.positions, states.rotations) / self.step, 1.0)
        allowance = np.nan_to_num(np.ceil(np.log2(excess))).astype(np.int64)
        states = replace(states, halvings=np.append(-allowance, 0))
        failure = self._judge_states(states) or self._judge_goals(states, goals) or _judge_time(states)
        shown = np.zeros(len(rows) - 1, dtype=np.bool_)
        while failure is None:
            apart = self.body_motion(states.positions, states.rotations)
            shown = self._show(states, apart, shown)
            gaps = np.flatnonzero(~shown | (apart > self.step))
            if not len(gaps):
                break
            failure = self._judge_gaps(states, gaps)
            if failure is None:
                middle = 0.5 * (states.rows[gaps] + states.rows[gaps + 1])
                states = states.halve(gaps, solver.solve(middle, deadline))
                given = np.insert(given, gaps + 1, False)
                shown = np.insert(shown, gaps + 1, shown[gaps])
                failure = self._judge_states(states) or _judge_time(states)
            if failure is None and time.monotonic() >= deadline:
                what = f"with {len(gaps):,} of {len(shown):,} motions between states not yet shown to be free"
                failure = _Failure("time", f"the time limit ended the verification {what}", int(gaps[0]))
        report = self._report(states, failure)
        return (report if friction is None else _at(report, np.flatnonzero(given))), states

    def judge_each(self, rows: FloatArray) -> tuple[BoolArray, SolvedStates]:
        """Returns which states the reference accepts in every friction state, shape (k,), and those without friction.

        What lies between them is not judged, nor self-collision: the rows may be any configurations, shape
        (k, dimension).
        """
        kept = np.ones(len(rows), dtype=np.bool_)
        solved = []
        for friction in self._friction_states:
            states = StateSolver(self.space, self.scene, friction, enough=self._enough).solve(rows)
            clear = np.nan_to_num(states.clearance, nan=-np.inf) >= self.clearance
            kept &= states.converged & states.stable & states.in_limits(self._robot) & clear
            solved.append(states)
        return kept, solved[0]

    def _judge_states(self, states: SolvedStates) -> _Failure | None:
        """Returns the first failure of a state by itself, or None."""
        count = len(states.rows)
        for failing, cause, reason in (
            (states.solved & ~states.converged, "statics", "the reference did not converge"),
            (states.converged & ~states.stable, "statics", "the reference shape is not stable"),
            (
                states.solved & ~states.in_limits(self._robot),
                "limits",
                "a limit on tension, tendon displacement or strain is exceeded",
            ),
            (states.touches_itself, "self_collision", "the robot touches itself"),
        ):
            if failing.any():
                state = int(np.argmax(failing))
                return _Failure(cause, f"state {state + 1} of {count}: {reason}", state)
        state = _least(states.clearance)
        if states.clearance[state] < self.clearance:
            distance, asked = 1e3 * states.clearance[state], 1e3 * self.clearance
            message = f"clearance {distance:.3f} mm under the reference, asked {asked:.3f} mm"
            return _Failure("clearance", f"state {state + 1} of {count}: {message}", state)
        return None

    def _judge_goals(self, states: SolvedStates, goals: Sequence[tuple[int, Goal]]) -> _Failure | None:
        """Returns the first goal that a state of the reference misses, or None."""
        for number, (state, goal) in enumerate(goals):
            if not states.solved[state]:
                continue
            problem = goal.kind.miss(goal, states.positions[state, -1], states.rotations[state, -1])
            if problem:
                where = f"state {state + 1} of {len(states.rows)}, goal {number + 1}"
                return _Failure("goal", f"{where}: {problem}", state)
        return None

    def _show(self, states: SolvedStates, apart: FloatArray, shown: BoolArray) -> BoolArray:
        """Returns which gaps are shown to keep the clearance.

        Args:
            states: The states, k of them.
            apart: How far the body moves between neighbours, shape (k - 1,), m.
            shown: Which gaps are known to keep it, shape (k - 1,).
        """
        gaps = np.flatnonzero(~shown)
        if not len(gaps):
            return shown
        # Along the path by how far the body moves, so that a motion of even speed has no second differences.
        along = np.concatenate([[0.0], np.cumsum(apart + 1e-12)])
        order = np.arange(len(along))
        motions, stray = disk_motions(states.positions, states.rotations, along, order, self._reaches)
        if len(along) == 2:
            stray = np.full(stray.shape, np.inf)
        # Pairs of states, one after the other; between two pairs nothing moves.
        pairs = np.stack([gaps, gaps + 1], axis=1).reshape(-1)
        motion = np.zeros((len(pairs) - 1, motions.shape[1]))
        off = np.zeros_like(motion)
        motion[::2], off[::2] = motions[gaps], stray[gaps]
        record = self._prover.record(len(pairs))
        # No part keeps less than the body as a whole.
        record.slack[:] = (states.clearance[pairs] - self.clearance)[:, None]
        _, moved = self._prover.open_intervals(
            states.positions[pairs], states.rotations[pairs], np.arange(len(pairs)), motion, off, record, np.inf
        )
        shown = shown.copy()
        shown[gaps] = moved[::2] == 0.0
        return shown

    def _judge_gaps(self, states: SolvedStates, gaps: IntArray) -> _Failure | None:
        """Returns the failure of the first open gap that has been halved as often as is sensible, or None."""
        spent = gaps[states.halvings[gaps] >= MAX_HALVINGS]
        if not len(spent):
            return None
        state = int(spent[0])
        pair = slice(state, state + 2)
        motion = float(self.body_motion(states.positions[pair], states.rotations[pair])[0])
        where = f"between states {state + 1} and {state + 2} of {len(states.rows)}"
        if motion > self.step:
            return _Failure("jump", f"{where} the reference shape jumps by {1e3 * motion:.2f} mm", state)
        lowest = 1e3 * float(states.clearance[pair].min())
        return _Failure("clearance", f"{where} a clearance of {lowest:.3f} mm leaves no room for the motion", state)

    def body_motion(self, positions: FloatArray, rotations: FloatArray) -> FloatArray:
        """Returns how far any point of the body moves at most between neighbouring states, shape (k - 1,), m.

        A point of disk d moves by at most |dp_d| plus its distance from the centre times the rotation's chord
        2 sin(angle / 2) = |dR|_F / sqrt 2; everything between two disks is spanned by points of the disks.
        """
        shift = np.linalg.norm(np.diff(positions, axis=0), axis=2)
        chord = np.linalg.norm(np.diff(rotations, axis=0), axis=(2, 3)) / np.sqrt(2.0)
        return np.asarray((shift + self._reaches * chord).max(axis=1))

    def _report(self, states: SolvedStates, failure: _Failure | None) -> VerificationReport:
        if failure is None:
            failure = _Failure("", "", _least(states.clearance))
        deviation = np.full(len(states.rows), np.nan)
        model_positions = None
        if self.model is not None:
            actuation = self.space.actuate(states.rows)
            inside = self.model.in_domain(actuation.tensions, actuation.gravity, actuation.tip_force) & states.solved
            model_positions = np.full_like(states.positions, np.nan)
            if inside.any():
                part = actuation.take(inside)
                poses = self.model.disk_poses(part.tensions, gravity=part.gravity, tip_force=part.tip_force)
                model_positions[inside] = part.in_world(poses.positions, poses.rotations)[0]
                deviation = np.linalg.norm(model_positions - states.positions, axis=2).max(axis=1)
        return VerificationReport(
            verified=not failure.cause,
            message=failure.message,
            cause=failure.cause,
            worst_state=failure.state,
            converged=states.converged,
            residual=states.residual,
            deviation=deviation,
            clearance=states.clearance,
            in_limits=states.in_limits(self._robot),
            positions=states.positions,
            rotations=states.rotations,
            model_positions=model_positions,
        )
