"""How much of a robot's own limits on strain and tendon displacement its tensions use up, without loads."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.solver import RodSolution
from tdcr_planner.statics.strain import within_strain_limits
from tdcr_planner.statics.tendons import within_displacement_limits


class LimitUse:
    """The part of `max_strain` and `max_tendon_displacement_m` that tensions use in the unloaded robot.

    Without loads a segment bends by the moment of the tendons that pass it: u - u* = sum tau_i r_i x (-e3) / (E I), to
    first order. Strain and displacement are linear in the tensions, so that tensions divided by their use keep both.

    Attributes:
        any: Whether the robot has such limits.
    """

    def __init__(self, robot: RobotSpec) -> None:
        """Collects the limits of a robot."""
        rods, offsets = robot.segment_backbones, robot.tendon_offsets
        passes = robot.tendon_segments[None, :] >= np.arange(robot.segment_count)[:, None]
        stiffness = np.array([rod.stiffness_bending_torsion[0] for rod in rods])
        # Curvature about x and y of each segment for 1 N of each tendon, shape (segments, 2, t), 1/m.
        lever = np.stack([-offsets[:, 1], offsets[:, 0]])
        curvature = passes[:, None] * lever / stiffness[:, None, None]
        strain = np.array([rod.radius_m / (rod.max_strain or np.inf) for rod in rods])
        self._strain = strain[:, None, None] * curvature
        lengths = np.array([segment.length_m for segment in robot.segments])
        bent = np.einsum("s,sj,skt,kj->jt", lengths, passes, curvature, lever)
        low, high = robot.drive.max_displacement
        self._displacement = bent / np.minimum(-low, high)[:, None]
        self.any = bool(self._strain.any() or self._displacement.any())

    def largest(self, tensions: FloatArray) -> FloatArray:
        """Returns the largest part of a limit that each case uses, shape (n,); above 1 it is broken.

        Args:
            tensions: Shape (n, t), N.
        """
        strain = np.linalg.norm(np.einsum("skt,nt->nsk", self._strain, tensions), axis=2)
        displacement = np.abs(tensions @ self._displacement.T)
        return np.asarray(np.maximum(strain.max(axis=1), displacement.max(axis=1)))

    @staticmethod
    def kept(robot: RobotSpec, solution: RodSolution) -> BoolArray:
        """Returns which solved cases keep the limits under their loads, shape (n,)."""
        return np.asarray(within_strain_limits(robot, solution) & within_displacement_limits(robot, solution))
