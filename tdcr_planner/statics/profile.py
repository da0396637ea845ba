"""What a solved rod carries along its length: strains, and forces and moments across the cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import record_cases
from tdcr_planner.statics.rod import RodArrays, rod_arrays
from tdcr_planner.statics.solver import RodSolution

# Weights of the four Runge-Kutta stages: an integral along the rod by them has the integrator's own order.
STAGE_WEIGHTS: FloatArray = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0


@dataclass(frozen=True)
class RodProfile:
    """Strains and loads of n cases at the four Runge-Kutta stages of each of c integration steps.

    The stages of a step stand at its start, its middle (twice) and its end, so both sides of a junction are kept.

    Attributes:
        arc_lengths: Shape (c, 4), m.
        rod: What the robot is at these steps.
        linear_strain: v, body frame, shape (n, c, 4, 3).
        curvature: u, body frame, shape (n, c, 4, 3), 1/m.
        force: R^T N, force across the cut through backbone and tendons, body frame, shape (n, c, 4, 3), N.
        moment: R^T M, moment across that cut about the backbone, body frame, shape (n, c, 4, 3), N m.
        rotations: base_from_body, shape (n, c, 4, 3, 3).
    """

    arc_lengths: FloatArray
    rod: RodArrays
    linear_strain: FloatArray
    curvature: FloatArray
    force: FloatArray
    moment: FloatArray
    rotations: FloatArray

    def integral(self, values: FloatArray, steps: BoolArray | None = None) -> FloatArray:
        """Returns the integral along the rod of values at the stages.

        Args:
            values: Shape (n, c, 4), or (n, k, 4) for the k steps chosen.
            steps: Which steps to integrate over, shape (c,); None for all.

        Returns:
            Shape (n,).
        """
        lengths = self.rod.step_lengths if steps is None else self.rod.step_lengths[steps]
        return np.asarray((values @ STAGE_WEIGHTS) @ lengths)


def rod_profile(robot: RobotSpec, solution: RodSolution) -> RodProfile:
    """Returns what a solution carries along the rod; NaN for cases without an equilibrium.

    Args:
        robot: The robot that was solved.
        solution: Its solution.
    """
    rod = solved_rod(robot, solution)
    record = record_solution(rod, solution)
    return RodProfile(
        arc_lengths=rod.stage_lengths,
        rod=rod,
        linear_strain=record[..., 6:9],
        curvature=record[..., 9:12],
        force=record[..., 0:3],
        moment=record[..., 3:6],
        rotations=record[..., 12:].reshape(*record.shape[:3], 3, 3),
    )


def solved_rod(robot: RobotSpec, solution: RodSolution) -> RodArrays:
    """Returns the arrays with which a solution was computed, or raises InputError if it is of another robot."""
    if solution.tensions.shape[1] != robot.tendon_count or solution.positions.shape[1] != robot.disk_count:
        raise InputError(
            "solution",
            f"a solution of robot {robot.name} ({robot.tendon_count} tendons, {robot.disk_count} disks)",
            f"one of {solution.tensions.shape[1]} tendons and {solution.positions.shape[1]} disks",
        )
    return rod_arrays(robot, solution.settings.steps_per_gap)


def pulls_of(rod: RodArrays, solution: RodSolution) -> FloatArray:
    """Returns the tensions along the tendons as `batch.record_cases` takes them."""
    if solution.pulls is None:
        return np.empty((0, len(rod.step_lengths), 3, rod.tendons.shape[1]))
    return solution.pulls


def record_solution(rod: RodArrays, solution: RodSolution) -> FloatArray:
    """Returns load, strain and rotation at every stage, shape (n, c, 4, 21); NaN where there is no equilibrium."""
    record = np.empty((len(solution.tensions), len(rod.step_lengths), 4, 21))
    record_cases(
        rod,
        solution.tensions,
        pulls_of(rod, solution),
        solution.loads.batch,
        solution.converged,
        solution.base_moment,
        record,
    )
    return record
