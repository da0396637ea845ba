"""The configuration space: rows of numbers that stand for bending, insertion and roll, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.limits import snap
from tdcr_planner.planning.scenario import Bending, Goal, Scenario, Start
from tdcr_planner.se3 import rotation_about_z, transform_points


@dataclass(frozen=True)
class Actuation:
    """What a batch of configurations means for the robot.

    Attributes:
        tensions: Shape (n, t), N.
        gravity: Shape (n, 3), m/s^2, base frame (it turns with the roll).
        tip_force: Shape (n, 3), N, base frame.
        base_positions: Origin of the base frame, shape (n, 3), m, world frame.
        base_rotations: world_from_base, shape (n, 3, 3).
    """

    tensions: FloatArray
    gravity: FloatArray
    tip_force: FloatArray
    base_positions: FloatArray
    base_rotations: FloatArray

    def take(self, which: BoolArray | IntArray) -> Actuation:
        """Returns the configurations of a mask or of indices."""
        return Actuation(
            self.tensions[which],
            self.gravity[which],
            self.tip_force[which],
            self.base_positions[which],
            self.base_rotations[which],
        )

    def in_world(self, positions: FloatArray, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns disk poses in the world frame: positions (n, d, 3), m, and world_from_disk (n, d, 3, 3).

        Args:
            positions: Shape (n, d, 3), m, base frame.
            rotations: base_from_disk, shape (n, d, 3, 3).
        """
        placed = transform_points(self.base_rotations, self.base_positions, positions)
        return placed, self.base_rotations[:, None] @ rotations


class ConfigurationSpace:
    """Configurations of a scenario as rows: bending x, y a segment (N), then insertion (m) and roll (rad) if they vary.

    Attributes:
        dimension: Length of a row.
        lower: Lower bound of each column, shape (dimension,).
        upper: Upper bound of each column, shape (dimension,).
    """

    def __init__(self, scenario: Scenario) -> None:
        """Prepares the space of a scenario."""
        self.robot = scenario.robot
        self._gravity = scenario.gravity
        self._tip_force = scenario.tip_force
        self._base_position = scenario.base_position
        self._base_rotation = scenario.base_rotation
        base = scenario.file.base
        self.has_insertion = base.insertion_m is not None
        self.has_roll = base.roll_deg is not None
        self.bending_count = 2 * self.robot.segment_count
        bounds = [(-bound, bound) for bound in self._bending_bounds() for _ in range(2)]
        if base.insertion_m is not None:
            bounds.append(base.insertion_m)
        if base.roll_deg is not None:
            bounds.append((np.deg2rad(base.roll_deg[0]), np.deg2rad(base.roll_deg[1])))
        self.lower: FloatArray = np.array([low for low, _ in bounds])
        self.upper: FloatArray = np.array([high for _, high in bounds])
        self.dimension = len(bounds)

    @property
    def world(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """What stays the same for all configurations, world frame: base position and rotation, gravity, tip force."""
        return self._base_position, self._base_rotation, self._gravity, self._tip_force

    def _bending_bounds(self) -> list[float]:
        """Largest length of a segment's bending vector within the tension limits, N.

        The set of reachable bending vectors is a polygon whose corners are sums of neighbouring tendons at full
        tension, so one of the corners is the farthest point.
        """
        bounds = []
        for index, segment in enumerate(self.robot.segments):
            angles = np.sort(np.mod(self.robot.tendon_angles[self.robot.tendon_segments == index], 2.0 * np.pi))
            gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
            farthest = max(1.0, float((2.0 * np.cos(gaps / 2.0)).max()))
            bounds.append((segment.max_tension_n - segment.pretension_n) * farthest)
        return bounds

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Returns random rows (count, dimension), uniform among those whose tensions are within their limits.

        A bending vector lies in the cone of one pair of neighbouring tendons and asks only them, so that the reachable
        vectors of a segment are a parallelogram a pair: one is chosen by its area, then a point of it.
        """
        rows = generator.uniform(self.lower, self.upper, (count, self.dimension))
        room = self.robot.max_tensions - self.robot.pretensions
        for index in range(self.robot.segment_count):
            columns = np.flatnonzero(self.robot.tendon_segments == index)
            angles = np.mod(self.robot.tendon_angles[columns], 2.0 * np.pi)
            order = np.argsort(angles, kind="stable")
            after = np.roll(order, -1)
            # Two tendons half a turn or more apart span no cone.
            areas = room[columns[order]] * room[columns[after]] * np.maximum(np.sin(angles[after] - angles[order]), 0.0)
            pair = generator.choice(len(order), count, p=areas / areas.sum())
            first, second = columns[order[pair]], columns[after[pair]]
            pulls = np.stack([room[first], room[second]], axis=1) * generator.uniform(size=(count, 2))
            directions = self.robot.tendon_angles[np.stack([first, second], axis=1)]
            rows[:, 2 * index] = (pulls * np.cos(directions)).sum(axis=1)
            rows[:, 2 * index + 1] = (pulls * np.sin(directions)).sum(axis=1)
        return rows

    def row(self, bending: Bending, insertion_m: float = 0.0, roll_deg: float = 0.0) -> FloatArray:
        """Returns the row, shape (dimension,), of a configuration as the scenario file writes it.

        What lies within rounding of the end of its range is moved onto it.
        """
        values = [component for vector in bending for component in vector]
        if self.has_insertion:
            values.append(insertion_m)
        if self.has_roll:
            values.append(float(np.deg2rad(roll_deg)))
        return snap(values, self.lower, self.upper)

    def row_of(self, state: Start | Goal) -> FloatArray:
        """Returns the row, shape (dimension,), of a start or of a goal that is a configuration."""
        assert state.bending_n is not None  # the caller has told the kinds of goal apart
        return self.row(state.bending_n, state.insertion_m, state.roll_deg)

    def bending(self, rows: FloatArray) -> FloatArray:
        """Returns the bending vectors of rows (n, dimension), shape (n, segments, 2), N."""
        return rows[:, : self.bending_count].reshape(len(rows), -1, 2)

    def insertion(self, rows: FloatArray) -> FloatArray:
        """Returns the insertion of rows (n, dimension), shape (n,), m; zero where the base is fixed."""
        return rows[:, self.bending_count].copy() if self.has_insertion else np.zeros(len(rows))

    def roll(self, rows: FloatArray) -> FloatArray:
        """Returns the roll of rows (n, dimension), shape (n,), rad; zero where the base does not roll."""
        return rows[:, -1].copy() if self.has_roll else np.zeros(len(rows))

    def actuate(self, rows: FloatArray) -> Actuation:
        """Returns tensions, loads in the base frame and base poses of rows (n, dimension)."""
        base_rotations = self._base_rotation @ rotation_about_z(self.roll(rows))
        base_positions = self._base_position + self.insertion(rows)[:, None] * self._base_rotation[:, 2]
        return Actuation(
            tensions=self.robot.tensions_from_bending(self.bending(rows)),
            gravity=np.einsum("nji,j->ni", base_rotations, self._gravity),
            tip_force=np.einsum("nji,j->ni", base_rotations, self._tip_force),
            base_positions=base_positions,
            base_rotations=base_rotations,
        )
