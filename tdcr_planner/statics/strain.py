"""Bending strain and stress of the backbone, against the limit that the robot file states."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.limits import at_most
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.profile import rod_profile
from tdcr_planner.statics.rod import POINT_OF_STAGE
from tdcr_planner.statics.solver import RodSolution


def largest_bending_strain(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns the largest bending strain of each segment's backbone.

    radius x |bending part of u - u*|, at the outer fibre, taken over all stages of all integration steps, both sides of
    every junction included (Gere and Goodno, Mechanics of Materials, ch. 5).

    Returns:
        Shape (n, segments), dimensionless; NaN for cases without an equilibrium.
    """
    profile = rod_profile(robot, solution)
    strain = np.empty((len(solution.tensions), robot.segment_count))
    rest = profile.rod.rest_strain[:, list(POINT_OF_STAGE), 3:5]
    owner = np.searchsorted(robot.segment_ends, profile.arc_lengths[:, 1])
    for index, backbone in enumerate(robot.segment_backbones):
        own = owner == index
        bending = profile.curvature[:, own, :, :2] - rest[own]
        strain[:, index] = backbone.radius_m * np.linalg.norm(bending, axis=-1).max(axis=(1, 2))
    return strain


def largest_bending_stress(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns the largest bending stress of each segment's backbone, E x strain, shape (n, segments), Pa."""
    modulus = np.array([backbone.youngs_modulus_pa for backbone in robot.segment_backbones])
    return largest_bending_strain(robot, solution) * modulus


def within_strain_limits(robot: RobotSpec, solution: RodSolution) -> BoolArray:
    """Returns which cases keep every segment's `Backbone.max_strain`, shape (n,); false without an equilibrium."""
    limits = np.array([backbone.max_strain or np.inf for backbone in robot.segment_backbones])
    return np.asarray(at_most(largest_bending_strain(robot, solution), limits).all(axis=1))
