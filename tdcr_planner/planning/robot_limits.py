"""A robot's limits on tension, tendon displacement and backbone strain, for the search and for verification."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.limits import at_most
from tdcr_planner.planning.causes import Cause, Codes
from tdcr_planner.planning.kernels import gap_curvatures
from tdcr_planner.robot import RobotSpec


class RobotLimits:
    """A robot's limits on tension, tendon displacement and backbone strain.

    `hold` judges displacements and strains that are known, as the reference's are; `check` takes them from the poses
    of the disks.
    """

    def __init__(self, robot: RobotSpec) -> None:
        """Collects a robot's limits."""
        self._spacing = np.diff(robot.arc_lengths)
        self._max_tensions = robot.max_tensions
        self._lowest, self._highest = robot.drive.max_displacement
        strains = [rod.max_strain for rod in robot.segment_backbones]
        self._segment_strain = np.array([np.inf if limit is None else limit for limit in strains])
        self._max_strain = self._segment_strain[robot.disk_segments[1:]]
        backbones = [robot.segment_backbones[index] for index in robot.disk_segments[1:]]
        self._radii = np.array([rod.radius_m for rod in backbones])
        self._rest_curvature = np.array([rod.rest_curvature_1_m for rod in backbones])
        # The first-order displacements hold for what a version 1 file can say; others come with a solution.
        self._knows_displacements = not robot.features
        self._offsets = robot.tendon_offsets if self._knows_displacements else np.zeros((robot.tendon_count, 3))
        present = robot.tendon_segments[:, None] >= robot.disk_segments[None, 1:]
        self._present = present * self._spacing
        self._tendon_compliance = robot.segment_ends[robot.tendon_segments] / robot.tendon_stiffnesses
        self._axial_compliance = np.array([1.0 / rod.stiffness_shear_extension[2] for rod in backbones])
        self.any = bool(np.isfinite([self._lowest, self._highest]).any() or np.isfinite(self._max_strain).any())

    def hold(self, tensions: FloatArray, displacements: FloatArray, strain: FloatArray) -> BoolArray:
        """Returns which states keep all limits, shape (n,).

        Args:
            tensions: Shape (n, t), N.
            displacements: Tendon pulled out at the base against the unloaded robot, shape (n, t), m.
            strain: Largest bending strain of each segment's backbone, shape (n, segments).
        """
        kept = at_most(tensions, self._max_tensions).all(axis=1)
        limited = np.isfinite(self._highest)
        kept &= self._within_travel(displacements[:, limited], limited)
        limited = np.isfinite(self._segment_strain)
        return np.asarray(kept & at_most(strain[:, limited], self._segment_strain[limited]).all(axis=1))

    def tendon_displacements(self, tensions: FloatArray, rotations: FloatArray) -> FloatArray:
        """Returns how far each tendon is pulled out at the base against the unloaded robot at rest.

        A tendon at constant offset r from a backbone of curvature u and axial strain e has the length
        integral of 1 + e + (u x r)_z (Rucker and Webster 2011, tendon kinematics, to first order in the angle between
        tendon and backbone); u is the mean between disks, e the tendons' compression, and the tendon's own stretch
        adds. At rest u is the backbone's u*, so that u - u* is what displaces.

        Args:
            tensions: Shape (n, t), N.
            rotations: Shape (n, d, 3, 3), any frame.

        Returns:
            Shape (n, t), m.
        """
        curvature = gap_curvatures(rotations, self._spacing) - self._rest_curvature
        along_x = curvature[:, :, 0] @ self._present.T
        along_y = curvature[:, :, 1] @ self._present.T
        bent = along_y * self._offsets[:, 0] - along_x * self._offsets[:, 1]
        present = self._present > 0.0
        strain = (tensions @ present) * self._axial_compliance
        return np.asarray(bent + strain @ self._present.T + tensions * self._tendon_compliance)

    def bending_strain(self, rotations: FloatArray) -> FloatArray:
        """Returns the backbone's bending strain between disks, radius x |u - u*|, shape (n, d - 1), dimensionless.

        Args:
            rotations: Shape (n, d, 3, 3), any frame.
        """
        bending = gap_curvatures(rotations, self._spacing)[:, :, :2] - self._rest_curvature[:, :2]
        return np.asarray(self._radii * np.linalg.norm(bending, axis=2))

    def check(self, tensions: FloatArray, rotations: FloatArray) -> Codes:
        """Returns 0 or the code of the limit that is broken, shape (n,)."""
        codes = np.zeros(len(tensions), dtype=np.int8)
        kept = at_most(self.bending_strain(rotations), self._max_strain).all(axis=1)
        codes[~kept] = Cause.STRAIN.code
        if not self._knows_displacements:
            return codes
        kept = self._within_travel(
            self.tendon_displacements(tensions, rotations), np.ones(len(self._highest), np.bool_)
        )
        codes[~kept] = Cause.TENDON_DISPLACEMENT.code
        return codes

    def _within_travel(self, displacements: FloatArray, tendons: BoolArray) -> BoolArray:
        """Returns which states keep some tendons, shape (t,), within their travel, shape (n,)."""
        low, high = self._lowest[tendons], self._highest[tendons]
        return np.asarray((at_most(displacements, high) & at_most(-displacements, -low)).all(axis=1))

    @staticmethod
    def explain(cause: Cause, robot: RobotSpec, tensions: FloatArray) -> str:
        """Returns a sentence on a limit that is broken."""
        if cause is Cause.TENSION_LIMIT:
            worst = int(np.argmax(tensions - robot.max_tensions))
            limit = robot.max_tensions[worst]
            return f"{cause.value}: tendon {worst + 1} needs {tensions[worst]:.3g} N of at most {limit:.3g} N"
        if cause is Cause.TENDON_DISPLACEMENT:
            return f"{cause.value}: a tendon moves beyond its displacement limit from where it is at rest"
        if cause is Cause.STRAIN:
            return f"{cause.value}: the backbone is bent from its rest curvature by more than max_strain"
        return cause.value
