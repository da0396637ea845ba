"""Tendon lengths inside the robot, and how far each tendon is pulled at the base."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.limits import at_most
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import lengths_of_cases
from tdcr_planner.statics.drive_settings import drive_arrays
from tdcr_planner.statics.profile import record_solution, solved_rod
from tdcr_planner.statics.solver import RodSolution


def tendon_lengths(robot: RobotSpec, solution: RodSolution, tensions: ArrayLike | None = None) -> FloatArray:
    """Returns the length of each tendon's path from the base to the disk that it ends at.

    The integral of |p_i'| = |v + u x r_i + r_i'| (Rucker and Webster 2011, tendon kinematics).

    Args:
        robot: The robot.
        solution: Its shapes.
        tensions: Shape (n, t), N. Not needed for the path; where given it is checked like any tensions.

    Returns:
        Shape (n, t), m; NaN for cases without an equilibrium.
    """
    if tensions is not None:
        robot.check_tensions(tensions)
    rod = solved_rod(robot, solution)
    lengths = np.empty((len(solution.tensions), 2, robot.tendon_count))
    lengths_of_cases(rod, solution.tensions, solution.converged, record_solution(rod, solution), lengths)
    return np.ascontiguousarray(lengths[:, 0])


def tendon_displacements(robot: RobotSpec, solution: RodSolution, tensions: ArrayLike | None = None) -> FloatArray:
    """Returns how far the drive has pulled each tendon in, against the unloaded robot at rest with its pretension.

    At rest the robot is straight, or as curved as its backbone's `rest_curvature_1_m` says. Positive where the tendon
    is pulled. What tendon and transmission stretch by is included: that much more has to be pulled. For a slack tendon
    it is the displacement at which it becomes taut.

    Args:
        robot: The robot.
        solution: Its shapes.
        tensions: Shape (n, t), N; the solution's own where None.

    Returns:
        Shape (n, t), m; NaN for cases without an equilibrium.
    """
    tension = solution.tensions if tensions is None else robot.check_tensions(tensions)
    drive = drive_arrays(robot, solved_rod(robot, solution))
    lengths = tendon_lengths(robot, solution)
    stretched = (tension - drive.pretension) * drive.compliance
    stretched = stretched + (tension * lengths - drive.pretension * drive.rest_lengths) * drive.stretch
    return np.asarray(drive.rest_lengths - lengths + stretched)


def within_displacement_limits(robot: RobotSpec, solution: RodSolution) -> BoolArray:
    """Returns which cases keep the drive's displacement limits, shape (n,); false without an equilibrium."""
    displaced = tendon_displacements(robot, solution)
    lowest, highest = robot.drive.max_displacement
    return np.asarray(at_most(displaced, highest).all(axis=1) & at_most(-displaced, -lowest).all(axis=1))
