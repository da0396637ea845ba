"""Energy of a solved rod: what the backbone stores, and the potential whose stationary points the equilibria are."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.profile import rod_profile, solved_rod
from tdcr_planner.statics.rod import POINT_OF_STAGE
from tdcr_planner.statics.solver import RodSolution
from tdcr_planner.statics.tendons import tendon_lengths


def stored_energy(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns the elastic energy of the backbone, shape (n,), J; NaN for cases without an equilibrium.

    The integral of (v - v*)^T Kse (v - v*) / 2 + (u - u*)^T Kbt (u - u*) / 2.
    """
    profile = rod_profile(robot, solution)
    points = list(POINT_OF_STAGE)
    stiffness, rest = profile.rod.stiffness[:, points], profile.rod.rest_strain[:, points]
    strain = np.concatenate([profile.linear_strain, profile.curvature], axis=-1) - rest
    return profile.integral(0.5 * (strain**2 * stiffness).sum(axis=-1))


def total_potential(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns the potential energy of robot, tendons and forces together, shape (n,), J.

    Stored energy, plus tension times length of each tendon, less force times position of each dead force. Moments
    are left out of it: a moment of fixed direction has no potential, and a case with one is an InputError.
    """
    loads = solution.loads
    if solution.pulls is not None:
        raise InputError("solution", "a solution without friction (friction has no potential)", "one with friction")
    for name in ("tip_moment", "distributed_moment", "disk_moments"):
        if getattr(loads, name).any():
            kind = name.replace("_", " ")
            raise InputError("solution", f"cases without a {kind} (it has no potential)", f"a {kind}")
    tendons = (solution.tensions * tendon_lengths(robot, solution)).sum(axis=1)
    forces = (loads.point_forces(robot) * solution.positions).sum(axis=(1, 2))
    lever = solution.rotations[:, -1] @ solved_rod(robot, solution).payload[1:]
    forces += robot.tip.mass_kg * (loads.gravity * lever).sum(axis=1)
    return stored_energy(robot, solution) + tendons - forces - _distributed_work(robot, solution)


def _distributed_work(robot: RobotSpec, solution: RodSolution) -> FloatArray:
    """Returns the integral of w . p along the backbone, shape (n,), J, w its weight and the distributed force.

    With W(s) = the integral of w from s to l it is the integral of W . p', since p(0) = 0.
    """
    profile = rod_profile(robot, solution)
    rod = profile.rod
    gravity, spread = solution.loads.gravity, solution.loads.distributed_force
    # Mass and length from each stage point to the step's end, and the load of the steps behind.
    mass = rod.step_masses[:, [1, 1, 1, 1]] - np.insert(rod.step_masses, 0, 0.0, axis=1)[:, list(POINT_OF_STAGE)]
    length = profile.arc_lengths[:, 3:] - profile.arc_lengths
    step = rod.step_masses[None, :, 1, None] * gravity[:, None] + rod.step_lengths[None, :, None] * spread[:, None]
    behind = np.cumsum(step[:, ::-1], axis=1)[:, ::-1] - step
    beyond = behind[:, :, None] + mass[..., None] * gravity[:, None, None] + length[..., None] * spread[:, None, None]
    tangent = np.einsum("ncsij,ncsj->ncsi", profile.rotations, profile.linear_strain)
    return profile.integral((beyond * tangent).sum(axis=-1))
