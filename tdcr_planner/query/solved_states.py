"""Solved states: configurations of a path under the Cosserat reference, with all that a judgement needs of them."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, fields, replace

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.planning.robot_limits import RobotLimits
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.query.friction_states import FrictionState
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.driven import driven_displacements, solve_driven
from tdcr_planner.statics.strain import largest_bending_strain

# States solved between two looks at the clock.
BATCH = 256


@dataclass(frozen=True)
class SolvedStates:
    """The states of a path in order, solved by the reference.

    Attributes:
        rows: Configurations, shape (k, dimension).
        tensions: Shape (k, t), N.
        displacements: Tendon pulled out at the base against the unloaded robot, shape (k, t), m.
        solved: Whether the time sufficed for the state, shape (k,); where it did not, nothing but its row and what the
            drive sets is known.
        converged: Shape (k,).
        stable: Shape (k,).
        residual: Shape (k,), N m.
        strain: Largest bending strain of each segment's backbone, shape (k, segments).
        clearance: Shape (k,), m; NaN where there is no shape.
        touches_itself: Whether the body touches itself, shape (k,).
        positions: Disk centres, shape (k, d, 3), m, world frame.
        rotations: world_from_disk, shape (k, d, 3, 3).
        halvings: How often the gap behind each state has been halved below the step, shape (k,).
        goals: Number of the goal (from 0) that a state must satisfy, -1 for none, shape (k,).
    """

    rows: FloatArray
    tensions: FloatArray
    displacements: FloatArray
    solved: BoolArray
    converged: BoolArray
    stable: BoolArray
    residual: FloatArray
    strain: FloatArray
    clearance: FloatArray
    touches_itself: BoolArray
    positions: FloatArray
    rotations: FloatArray
    halvings: IntArray
    goals: IntArray

    def halve(self, gaps: IntArray, middle: SolvedStates) -> SolvedStates:
        """Returns the states with others inserted into some gaps.

        Args:
            gaps: Index of the state before each gap, increasing, shape (g,).
            middle: The g states that belong there.
        """
        depth = self.halvings.copy()
        depth[gaps] += 1
        before = replace(self, halvings=depth)
        between = replace(middle, halvings=depth[gaps])
        merged = {
            item.name: np.insert(getattr(before, item.name), gaps + 1, getattr(between, item.name), axis=0)
            for item in fields(self)
        }
        return SolvedStates(**merged)

    def in_limits(self, robot: RobotSpec) -> BoolArray:
        """Returns which states keep the robot's limits on tension, tendon displacement and strain, shape (k,)."""
        return RobotLimits(robot).hold(self.tensions, self.displacements, self.strain)


class StateSolver:
    """Solves configurations with the reference and measures their shapes in a scene."""

    def __init__(
        self,
        space: ConfigurationSpace,
        scene: CollisionScene,
        friction: FrictionState = None,
        *,
        enough: float | None = None,
    ) -> None:
        """Prepares the solver.

        Args:
            space: The scenario's configurations.
            scene: The scene with the body as it is, without margins.
            friction: How the tendons slide.
            enough: A clearance, m, above which it is not measured: such states are stated to have just this one, which
                the distance field shows several times faster. None to measure all.
        """
        self._space = space
        self._scene = scene
        self._friction = friction
        self._enough = enough

    def solve(self, rows: FloatArray, deadline: float = math.inf) -> SolvedStates:
        """Returns the states of configurations, shape (k, dimension), each by itself.

        Args:
            rows: The configurations.
            deadline: When to leave the rest unsolved, by time.monotonic().
        """
        if not math.isfinite(deadline) or len(rows) <= BATCH:
            return self._solve(rows)
        parts: list[SolvedStates] = []
        for start in range(0, len(rows), BATCH):
            if time.monotonic() >= deadline:
                parts.append(self._unsolved(rows[start:]))
                break
            parts.append(self._solve(rows[start : start + BATCH]))
        names = [item.name for item in fields(SolvedStates)]
        return SolvedStates(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def _clearance(self, positions: FloatArray, rotations: FloatArray) -> FloatArray:
        """Returns the clearance of shapes, shape (n,), m; where there is `enough`, that."""
        if self._enough is None:
            return self._scene.clearance(positions, rotations)
        grown = self._scene.with_margins(np.full(self._space.robot.disk_count, self._enough))
        near = grown.check(positions, rotations) != 0
        clearance = np.full(len(positions), self._enough)
        if near.any():
            clearance[near] = self._scene.clearance(positions[near], rotations[near])
        return clearance

    def _unsolved(self, rows: FloatArray) -> SolvedStates:
        """Returns what is known of configurations without solving them."""
        robot, count = self._space.robot, len(rows)
        driven, displaced = self._space.actuate(rows).tensions, robot.drive.kind == "displacement"
        return SolvedStates(
            rows=rows,
            tensions=np.full((count, robot.tendon_count), np.nan) if displaced else driven,
            displacements=driven if displaced else np.full((count, robot.tendon_count), np.nan),
            solved=np.zeros(count, dtype=np.bool_),
            converged=np.zeros(count, dtype=np.bool_),
            stable=np.zeros(count, dtype=np.bool_),
            residual=np.full(count, np.nan),
            strain=np.full((count, robot.segment_count), np.nan),
            clearance=np.full(count, np.nan),
            touches_itself=np.zeros(count, dtype=np.bool_),
            positions=np.full((count, robot.disk_count, 3), np.nan),
            rotations=np.full((count, robot.disk_count, 3, 3), np.nan),
            halvings=np.zeros(count, dtype=np.int64),
            goals=np.full(count, -1, dtype=np.int64),
        )

    def _solve(self, rows: FloatArray) -> SolvedStates:
        robot = self._space.robot
        actuation = self._space.actuate(rows)
        solution = solve_driven(
            robot,
            actuation.tensions,
            friction=self._friction,
            gravity=actuation.gravity,
            tip_force=actuation.tip_force,
        )
        converged = np.asarray(solution.converged, dtype=np.bool_)
        positions, rotations = actuation.in_world(solution.positions, solution.rotations)
        clearance = np.full(len(rows), np.nan)
        touches_itself = np.zeros(len(rows), dtype=np.bool_)
        if converged.any():
            clearance[converged] = self._clearance(positions[converged], rotations[converged])
            touches_itself[converged] = self._scene.touches_itself(positions[converged], rotations[converged])
        return SolvedStates(
            rows=rows,
            tensions=solution.tensions,
            displacements=driven_displacements(robot, solution),
            solved=np.ones(len(rows), dtype=np.bool_),
            converged=converged,
            stable=np.asarray(solution.stable, dtype=np.bool_),
            residual=solution.residual,
            strain=largest_bending_strain(robot, solution),
            clearance=clearance,
            touches_itself=touches_itself,
            positions=positions,
            rotations=rotations,
            halvings=np.zeros(len(rows), dtype=np.int64),
            goals=np.full(len(rows), -1, dtype=np.int64),
        )
