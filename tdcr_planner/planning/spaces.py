"""The configuration space: rows of numbers that stand for the drive, insertion and roll, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.limits import snap
from tdcr_planner.planning.coordinates import drive_coordinates
from tdcr_planner.planning.scenario import Goal, Scenario, Start
from tdcr_planner.se3 import rotation_about_z, transform_points


@dataclass(frozen=True)
class Actuation:
    """What a batch of configurations means for the robot.

    Attributes:
        tensions: What the drive sets, shape (n, t): tensions, N, or displacements, m, by the robot's drive.
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
    """Configurations of a scenario as rows: the drive's coordinates, then insertion (m) and roll (rad) if they vary.

    The drive's coordinates are bending vectors, x and y a segment, of tension (N) or of displacement (m), or a number a
    tendon; see `planning.coordinates`.

    Attributes:
        coordinates: The drive's coordinates.
        bending_count: How many they are.
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
        self.coordinates = drive_coordinates(self.robot)
        self.bending_count = self.coordinates.width
        bounds = list(zip(self.coordinates.lower.tolist(), self.coordinates.upper.tolist(), strict=True))
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

    def sample(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Returns random rows (count, dimension), uniform among those within the drive's limits."""
        rows = generator.uniform(self.lower, self.upper, (count, self.dimension))
        rows[:, : self.bending_count] = self.coordinates.sample(count, generator)
        return rows

    def confined(self, rows: FloatArray) -> FloatArray:
        """Returns rows (n, dimension) within the bounds and, by shrinking bending vectors, the drive's limits."""
        rows = np.clip(rows, self.lower, self.upper)
        rows[:, : self.bending_count] = self.coordinates.confined(rows[:, : self.bending_count])
        return rows

    def row(self, drive: ArrayLike, insertion_m: float = 0.0, roll_deg: float = 0.0) -> FloatArray:
        """Returns the row, shape (dimension,), of a configuration as the scenario file writes it.

        What lies within rounding of the end of its range is moved onto it.

        Args:
            drive: The drive's coordinates, as a scenario's `bending_n`, `bending_m`, `tendon_n` or `tendon_m`.
            insertion_m: Insertion, m.
            roll_deg: Roll, degrees.
        """
        values = np.asarray(drive, dtype=np.float64).ravel().tolist()
        if self.has_insertion:
            values.append(insertion_m)
        if self.has_roll:
            values.append(float(np.deg2rad(roll_deg)))
        return snap(values, self.lower, self.upper)

    def row_of(self, state: Start | Goal) -> FloatArray:
        """Returns the row, shape (dimension,), of a start or of a goal that is a configuration."""
        return self.row(getattr(state, self.coordinates.key), state.insertion_m, state.roll_deg)

    def drive(self, rows: FloatArray) -> FloatArray:
        """Returns the drive's coordinates of rows (n, dimension), shape (n, bending_count)."""
        return rows[:, : self.bending_count]

    def bending(self, rows: FloatArray) -> FloatArray:
        """Returns the bending vectors of rows (n, dimension), shape (n, segments, 2), N or m.

        Zeros where the drive's coordinates are no bending vectors.
        """
        if not self.coordinates.are_vectors:
            return np.zeros((len(rows), self.robot.segment_count, 2))
        return self.drive(rows).reshape(len(rows), -1, 2)

    def insertion(self, rows: FloatArray) -> FloatArray:
        """Returns the insertion of rows (n, dimension), shape (n,), m; zero where the base is fixed."""
        return rows[:, self.bending_count].copy() if self.has_insertion else np.zeros(len(rows))

    def roll(self, rows: FloatArray) -> FloatArray:
        """Returns the roll of rows (n, dimension), shape (n,), rad; zero where the base does not roll."""
        return rows[:, -1].copy() if self.has_roll else np.zeros(len(rows))

    def actuate(self, rows: FloatArray) -> Actuation:
        """Returns what the drive sets, loads in the base frame and base poses of rows (n, dimension)."""
        base_rotations = self._base_rotation @ rotation_about_z(self.roll(rows))
        base_positions = self._base_position + self.insertion(rows)[:, None] * self._base_rotation[:, 2]
        return Actuation(
            tensions=self.coordinates.driven(self.drive(rows)),
            gravity=np.einsum("nji,j->ni", base_rotations, self._gravity),
            tip_force=np.einsum("nji,j->ni", base_rotations, self._tip_force),
            base_positions=base_positions,
            base_rotations=base_rotations,
        )
