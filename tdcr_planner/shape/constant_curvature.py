"""The constant-curvature baseline: each segment a circular arc, outside loads ignored."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray, check_batch
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import rotation_from_vector
from tdcr_planner.shape.base import DiskPoses, ShapeModel


class ConstantCurvatureShape(ShapeModel):
    """Circular arcs with curvature M / (E I) (Webster and Jones 2010), M the tendons' moment.

    Loads are accepted and ignored: that is what a planner does that trusts constant curvature.
    """

    name = "constant_curvature"
    title = "constant curvature"
    colour = "#D55E00"
    marker = "D"

    def __init__(self, robot: RobotSpec) -> None:
        """Prepares the baseline for a robot."""
        self.robot = robot
        self.error_bound: FloatArray = np.zeros(robot.disk_count)

    @classmethod
    def load(cls, robot: RobotSpec, file: Path | None) -> Self:  # noqa: ARG003
        """Returns the baseline for a robot; it has no file."""
        return cls(robot)

    def disk_poses(
        self,
        tensions: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        tip_force: ArrayLike | None = None,
    ) -> DiskPoses:
        """Returns the disk poses of a batch; see `ShapeModel.disk_poses`."""
        tension = self.robot.check_tensions(tensions)
        count = len(tension)
        check_batch("gravity", gravity, count, 3)
        check_batch("tip_force", tip_force, count, 3)
        positions = np.zeros((count, self.robot.disk_count, 3))
        rotations = np.zeros((count, self.robot.disk_count, 3, 3))
        rotations[:, 0] = np.eye(3)
        offsets = self.robot.tendon_offsets
        disk = 0
        for index, (segment, backbone) in enumerate(
            zip(self.robot.segments, self.robot.segment_backbones, strict=True)
        ):
            present = self.robot.tendon_segments >= index
            # M = sum r_i x (-tau_i e3): a pulled tendon pushes back on the last disk that it is tied to.
            moment = np.stack(
                [-tension[:, present] @ offsets[present, 1], tension[:, present] @ offsets[present, 0]], axis=1
            )
            curvature = np.zeros((count, 3))
            curvature[:, :2] = moment / backbone.stiffness_bending_torsion[0]
            curvature += np.asarray(backbone.rest_curvature_1_m)
            start_position, start_rotation = positions[:, disk, None], rotations[:, disk, None]
            arc_lengths = segment.length_m * np.arange(1, segment.disks + 1) / segment.disks
            turns = curvature[:, None] * arc_lengths[:, None]
            here = slice(disk + 1, disk + 1 + segment.disks)
            rotations[:, here] = start_rotation @ rotation_from_vector(turns)
            chords = arc_lengths[:, None] * _unit_chord(turns)
            positions[:, here] = start_position + (start_rotation @ chords[..., None])[..., 0]
            disk += segment.disks
        return DiskPoses(positions, rotations, np.ones(count, dtype=np.bool_))


def _unit_chord(turn: FloatArray) -> FloatArray:
    """Returns the integral of exp([a]x s) e3 over s in [0, 1] for rotation vectors a, shape (..., 3)."""
    angle = np.linalg.norm(turn, axis=-1)[..., None]
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    second = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    e3 = np.broadcast_to(np.array([0.0, 0.0, 1.0]), turn.shape)
    once = np.cross(turn, e3)
    return np.asarray(e3 + first * once + second * np.cross(turn, once))
