"""Tendon lengths inside the robot, and how far each tendon is pulled at the base."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.profile import rod_profile
from tdcr_planner.statics.solver import RodSolution


def tendon_lengths(robot: RobotSpec, solution: RodSolution, tensions: ArrayLike | None = None) -> FloatArray:
    """Returns the length of each tendon's path from the base to the disk that it ends at.

    The integral of |p_i'| = |v + u x r_i| (Rucker and Webster 2011, tendon kinematics) over the tendon's segments.

    Args:
        robot: The robot.
        solution: Its shapes.
        tensions: Shape (n, t), N. Not needed for the path; where given it is checked like any tensions.

    Returns:
        Shape (n, t), m; NaN for cases without an equilibrium.
    """
    if tensions is not None:
        robot.check_tensions(tensions)
    profile = rod_profile(robot, solution)
    lengths = np.empty((len(solution.tensions), robot.tendon_count))
    for tendon, (offset, segment) in enumerate(zip(robot.tendon_offsets, robot.tendon_segments, strict=True)):
        passes = profile.segments <= segment
        direction = profile.linear_strain[:, passes] + np.cross(profile.curvature[:, passes], offset)
        stretch = np.linalg.norm(direction, axis=-1)
        lengths[:, tendon] = profile.integral(stretch, passes)
    return lengths


def tendon_displacements(robot: RobotSpec, solution: RodSolution, tensions: ArrayLike | None = None) -> FloatArray:
    """Returns how far each tendon is pulled out at the base, against the straight unloaded robot.

    Positive where the tendon is pulled out. Where the segment gives `tendon_axial_stiffness_n`, the elastic stretch
    tension x length / stiffness of the part inside the robot is added: that much more has to be pulled.

    Args:
        robot: The robot.
        solution: Its shapes.
        tensions: Shape (n, t), N; the solution's own where None.

    Returns:
        Shape (n, t), m; NaN for cases without an equilibrium.
    """
    tension = solution.tensions if tensions is None else robot.check_tensions(tensions)
    lengths = tendon_lengths(robot, solution)
    straight = robot.segment_ends[robot.tendon_segments]
    stiffness = np.array([segment.tendon_axial_stiffness_n or np.inf for segment in robot.segments])
    return np.asarray(straight - lengths + tension * lengths / stiffness[robot.tendon_segments])
