"""Energy of a solved rod: what the backbone stores, and the potential whose stationary points the equilibria are."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.profile import rod_profile
from tdcr_planner.statics.solver import RodSolution
from tdcr_planner.statics.tendons import tendon_lengths


def stored_energy(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns the elastic energy of the backbone, shape (n,), J; NaN for cases without an equilibrium.

    The integral of (v - v*)^T Kse (v - v*) / 2 + (u - u*)^T Kbt (u - u*) / 2.
    """
    profile = rod_profile(robot, solution)
    backbones = [robot.segment_backbones[index] for index in profile.segments]
    shear = np.array([backbone.stiffness_shear_extension for backbone in backbones])[:, None]
    bending = np.array([backbone.stiffness_bending_torsion for backbone in backbones])[:, None]
    rest = np.array([backbone.rest_curvature_1_m for backbone in backbones])[:, None]
    linear = profile.linear_strain - np.array([0.0, 0.0, 1.0])
    density = (linear**2 * shear).sum(axis=-1) + ((profile.curvature - rest) ** 2 * bending).sum(axis=-1)
    return profile.integral(0.5 * density)


def total_potential(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns the potential energy of robot, tendons and forces together, shape (n,), J.

    Stored energy, plus tension times length of each tendon, less force times position of each dead force. Tip moments
    are left out of it: a moment of fixed direction has no potential, and a case with one is an InputError.
    """
    if solution.loads.tip_moment.any():
        raise InputError("solution", "cases without a tip moment (it has no potential)", "a tip moment")
    loads = solution.loads
    tendons = (solution.tensions * tendon_lengths(robot, solution)).sum(axis=1)
    forces = (loads.point_forces(robot) * solution.positions).sum(axis=(1, 2))
    return stored_energy(robot, solution) + tendons - forces - _distributed_work(robot, solution)


def _distributed_work(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns the integral of w . p along the backbone, shape (n,), J, w its weight and the distributed force.

    With W(s) = the integral of w from s to l it is the integral of W . p', since p(0) = 0.
    """
    profile = rod_profile(robot, solution)
    mass = np.array([backbone.weight_per_length_kg_m for backbone in robot.segment_backbones])[profile.segments]
    density = mass[None, :, None] * solution.loads.gravity[:, None, :] + solution.loads.distributed_force[:, None, :]
    behind = np.cumsum((density * profile.step_lengths[:, None])[:, ::-1], axis=1)[:, ::-1]
    ends = profile.arc_lengths[:, 3:]
    rest = (
        behind[:, :, None, :]
        - density[:, :, None, :] * (profile.step_lengths[:, None] - (ends - profile.arc_lengths))[None, :, :, None]
    )
    tangent = np.einsum("ncsij,ncsj->ncsi", profile.rotations, profile.linear_strain)
    return profile.integral((rest * tangent).sum(axis=-1))
