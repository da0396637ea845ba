"""A session whose learned model is the reference, moved sideways by a stated distance: its errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.query.session import PlanningSession
from tdcr_planner.shape.base import DiskPoses
from tdcr_planner.shape.reference import ReferenceShape


class ShiftedShape(ReferenceShape):
    """The reference's shapes, all disks but the base moved along the base frame's x axis."""

    name = "learned"
    sha256 = "0" * 64

    def __init__(self, robot, shift, bound):
        super().__init__(robot)
        self.shift = np.array([shift, 0.0, 0.0])
        self.error_bound = np.full(robot.disk_count, bound)

    def disk_poses(self, tensions, *, gravity=None, tip_force=None):
        poses = super().disk_poses(tensions, gravity=gravity, tip_force=tip_force)
        moved = poses.positions + self.shift
        moved[:, 0] = poses.positions[:, 0]
        return DiskPoses(moved, poses.rotations, poses.solved)


@pytest.fixture
def make_session(make_scenario):
    """Returns a function that builds a session beside a wall with a learned model of known error."""

    def make(shift=0.0, bound=0.0, robot="inspection", **changes):
        # The box has its near face at x = 250 mm, 80 mm off the straight robot; gravity pulls towards it.
        table = {"gravity_m_s2": [9.81, 0.0, 0.0], "base": {"position_m": [0.17, 0.0, -0.15]}, **changes}
        session = PlanningSession(make_scenario(robot, **table))
        session.use_model("learned", ShiftedShape(session.scenario.robot, shift, bound))
        return session

    return make
