"""What a robot on its bench would have shown: tracked points and tensions of measured states, from its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.data import MeasuredStates
from tdcr_planner.calibration.unloaded import solve_arcs
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import rotation_from_vector


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shapes of the n measured states in the base frame.

    Attributes:
        positions: Disk centres, shape (n, d, 3), m; NaN where there is no equilibrium.
        rotations: base_from_disk, shape (n, d, 3, 3).
        tensions: At the robot's base, shape (n, t), N.
        solved: Whether there is an equilibrium, shape (n,).
        start: What the next solution with similar parameters may start from.
    """

    positions: FloatArray
    rotations: FloatArray
    tensions: FloatArray
    solved: BoolArray
    start: FloatArray


class Mechanics(Protocol):
    """A solver of the shapes of measured states."""

    name: str

    def shapes(self, bench: Bench, states: MeasuredStates, start: FloatArray | None) -> Shapes:
        """Returns the shapes of all states, in their order."""
        ...


def displacements_of(bench: Bench, states: MeasuredStates) -> FloatArray:
    """Returns the displacements that acted, shape (n, t), m: what the drive read, its zeros and their drift."""
    return np.asarray(states.displacements + bench.zeros + bench.drift * states.times[:, None])


def tensions_of(bench: Bench, states: MeasuredStates) -> FloatArray:
    """Returns the tensions that acted in the straight robot, shape (n, t), N."""
    if bench.drives_displacement:
        return np.tile(bench.robot.drive.pretension, (len(states), 1))
    return np.maximum(states.tensions + bench.pretension_shift, 0.0)


class UnloadedMechanics:
    """Arcs: quick, with slack and friction's history, for states without gravity and tip force."""

    name = "arcs"

    def shapes(self, bench: Bench, states: MeasuredStates, start: FloatArray | None) -> Shapes:
        """Returns the shapes of all states; see `unloaded.solve_arcs`."""
        found = solve_arcs(bench.robot, displacements_of(bench, states), tensions_of(bench, states), start)
        return Shapes(found.positions, found.rotations, found.tensions, found.solved, found.bends)


class Forward:
    """Tracked points and tensions of measured states; remembers the last robot's shapes.

    Attributes:
        states: The measured states.
        mechanics: What solves their shapes.
        correction: Added to the points, shape (n, k, 3), m: by how much other mechanics differ; see `mapping`.
    """

    def __init__(self, states: MeasuredStates, mechanics: Mechanics) -> None:
        self.states = states
        self.mechanics = mechanics
        self.correction: FloatArray = np.zeros((1, 1, 3))
        self._start: FloatArray | None = None
        self._known: tuple[tuple[RobotSpec, bytes], Shapes] | None = None

    def shapes(self, bench: Bench, *, keep: bool = True) -> Shapes:
        """Returns the shapes of all states.

        Args:
            bench: The robot on its bench.
            keep: Whether the next solution starts from this one.
        """
        key = (bench.robot, np.concatenate([bench.zeros, [bench.drift], bench.pretension_shift]).tobytes())
        if self._known is not None and self._known[0][0] is key[0] and self._known[0][1] == key[1]:
            return self._known[1]
        found = self.mechanics.shapes(bench, self.states, self._start)
        if keep:
            self._known = (key, found)
            if found.solved.all():
                self._start = found.start
        return found

    def points(self, bench: Bench, *, keep: bool = True) -> FloatArray:
        """Returns the tracked points in the frame of the measurements, shape (n, k, 3), m."""
        return place_points(bench, self.states, self.shapes(bench, keep=keep)) + self.correction


def place_points(bench: Bench, states: MeasuredStates, shapes: Shapes) -> FloatArray:
    """Returns the tracked points of solved shapes in the frame of the measurements, shape (n, k, 3), m."""
    offsets = np.where(np.array(states.is_marker)[:, None], bench.marker, 0.0)
    at_disks = shapes.positions[:, states.points]
    moved = at_disks + np.einsum("nkij,kj->nki", shapes.rotations[:, states.points], offsets)
    return np.asarray(moved @ rotation_from_vector(bench.base_rotation).T + bench.base_position)
