"""Tendon lengths inside the robot, and how far each tendon is pulled at the base."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.limits import at_most
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import lengths_of_cases, rest_lengths
from tdcr_planner.statics.profile import record_solution, solved_rod
from tdcr_planner.statics.rod import rod_arrays
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
    """Returns how far each tendon is pulled out at the base, against the unloaded robot at rest.

    At rest the robot is straight, or as curved as its backbone's `rest_curvature_1_m` says. Positive where the tendon
    is pulled out. Where the segment gives `tendon_axial_stiffness_n`, the elastic stretch
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
    rest = rest_tendon_lengths(robot, solution.settings.steps_per_gap)
    stiffness = np.array([segment.tendon_axial_stiffness_n or np.inf for segment in robot.segments])
    return np.asarray(rest - lengths + tension * lengths / stiffness[robot.tendon_segments])


def rest_tendon_lengths(robot: RobotSpec, steps_per_gap: int | None = None) -> FloatArray:
    """Returns the length of each tendon's path in the unloaded robot, shape (t,), m, by the quadrature of the shapes."""
    return np.asarray(rest_lengths(rod_arrays(robot, steps_per_gap)))


def within_displacement_limits(robot: RobotSpec, solution: RodSolution) -> BoolArray:
    """Returns which cases keep every `Segment.max_tendon_displacement_m`, (n,); false without an equilibrium."""
    limits = np.array([segment.max_tendon_displacement_m or np.inf for segment in robot.segments])
    displaced = np.abs(tendon_displacements(robot, solution))
    return np.asarray(at_most(displaced, limits[robot.tendon_segments]).all(axis=1))
