"""Tendon lengths inside the robot, and how far each tendon is pulled at the base."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.limits import at_most
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import lengths_of_cases
from tdcr_planner.statics.drive_settings import drive_arrays
from tdcr_planner.statics.profile import pulls_of, record_solution, solved_rod
from tdcr_planner.statics.rod import RodArrays
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
    return _path_integrals(rod, solution)[:, 0]


def _path_integrals(rod: RodArrays, solution: RodSolution) -> FloatArray:
    """Returns each path's length, m, and the integral of the tension along it, N m, shape (n, 2, t)."""
    lengths = np.empty((len(solution.tensions), 2, rod.tendons.shape[1]))
    record, pulls = record_solution(rod, solution), pulls_of(rod, solution)
    lengths_of_cases(rod, solution.tensions, pulls, solution.converged, record, lengths)
    return lengths


def tendon_tensions(robot: RobotSpec, solution: RodSolution) -> tuple[FloatArray, FloatArray]:
    """Returns the tension along each tendon.

    Args:
        robot: The robot.
        solution: Its solution, with friction or without.

    Returns:
        Arc lengths of start, middle and end of each integration step, shape (c, 3), m, and the tensions there, shape
        (n, c, 3, t), N, NaN where a tendon does not run.
    """
    rod = solved_rod(robot, solution)
    tensions = np.full((len(solution.tensions), len(rod.step_lengths), 3, robot.tendon_count), np.nan)
    for tendon in range(robot.tendon_count):
        steps, columns = rod.steps_of(tendon)
        if solution.pulls is None:
            tensions[:, steps, :, tendon] = solution.tensions[None, :, tendon, None]
        else:
            tensions[:, steps, :, tendon] = solution.pulls[:, steps, :, columns]
    return rod.stage_lengths[:, [0, 1, 3]], tensions


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
    rod = solved_rod(robot, solution)
    drive = drive_arrays(robot, rod)
    integrals = _path_integrals(rod, solution)
    lengths, stretching = integrals[:, 0], integrals[:, 1]
    tension = solution.tensions
    if tensions is not None:
        tension = robot.check_tensions(tensions)
        stretching = tension * lengths
    stretched = (tension - drive.pretension) * drive.compliance
    stretched = stretched + (stretching - drive.pretension * drive.rest_lengths) * drive.stretch
    return np.asarray(drive.rest_lengths - lengths + stretched)


def within_displacement_limits(robot: RobotSpec, solution: RodSolution) -> BoolArray:
    """Returns which cases keep the drive's displacement limits, shape (n,); false without an equilibrium."""
    displaced = tendon_displacements(robot, solution)
    lowest, highest = robot.drive.max_displacement
    return np.asarray(at_most(displaced, highest).all(axis=1) & at_most(-displaced, -lowest).all(axis=1))
