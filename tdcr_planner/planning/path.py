"""The tension path: the states a planned motion passes, with what each asks of the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray


@dataclass(frozen=True)
class TensionPath:
    """States of a path in order. Between two states bending, insertion and roll are interpolated linearly.

    Attributes:
        bending: Shape (k, segments, 2), N; m where the drive sets displacements, zeros without bending vectors.
        insertion: Shape (k,), m.
        roll: Shape (k,), rad.
        tensions: Shape (k, t), N.
        tendon_displacements: Tendon pulled out at the base against the straight robot, shape (k, t), m.
        tip_positions: Centre of the last disk, shape (k, 3), m, world frame.
        times: Shape (k,), s, from the scenario's limits; starts at 0.
        goal_states: Index of the state that reaches each goal, and the goal's number in the scenario (from 0), in
            the order of travel.
        drive: The drive's coordinates, shape (k, c), N or m, see `planning.coordinates`; None where they are the
            bending vectors of tension.
    """

    bending: FloatArray
    insertion: FloatArray
    roll: FloatArray
    tensions: FloatArray
    tendon_displacements: FloatArray
    tip_positions: FloatArray
    times: FloatArray
    goal_states: tuple[tuple[int, int], ...] = ()
    drive: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.insertion)

    @property
    def tip_travel(self) -> float:
        """Length of the tip's way, m."""
        return float(np.linalg.norm(np.diff(self.tip_positions, axis=0), axis=1).sum())
