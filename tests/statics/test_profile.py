"""What the rod carries along its length, and the balance at a junction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.profile import rod_profile
from tdcr_planner.statics.solver import SolverSettings, solve_statics


def test_forces_and_moments_balance_at_every_junction(
    general_robot: RobotSpec, tight: SolverSettings, loads_of: Callable, random: np.random.Generator
) -> None:
    """Balance of the junction disk: backbone on both sides, tendons that end there and that pass, weight."""
    tensions, loads = loads_of(general_robot, random, 3, share=0.5, everything=True)
    solution = solve_statics(general_robot, tensions, **loads, settings=tight)
    profile = rod_profile(general_robot, solution)
    outside = solution.loads.point_forces(general_robot)
    kinks = []
    for segment in range(general_robot.segment_count - 1):
        last = int(
            np.flatnonzero(np.searchsorted(general_robot.segment_ends, profile.arc_lengths[:, 1]) == segment)[-1]
        )
        disk = int(np.flatnonzero(general_robot.disk_segments == segment)[-1])
        rotation = solution.rotations[:, disk]
        weight = np.einsum("nji,nj->ni", rotation, outside[:, disk])
        force, moment = weight.copy(), np.zeros_like(weight)
        # Before the junction stage 3 of the last step, behind it stage 0 of the next; the part behind pulls with +.
        for step, stage, side, sign in ((last, 3, segment, -1.0), (last + 1, 0, segment + 1, 1.0)):
            backbone = general_robot.segment_backbones[side]
            v, u = profile.linear_strain[:, step, stage], profile.curvature[:, step, stage]
            force += sign * np.asarray(backbone.stiffness_shear_extension) * (v - [0.0, 0.0, 1.0])
            moment += (
                sign * np.asarray(backbone.stiffness_bending_torsion) * (u - np.asarray(backbone.rest_curvature_1_m))
            )
            for tendon in np.flatnonzero(general_robot.tendon_segments >= side):
                offset = general_robot.tendon_offsets[tendon]
                along = v + np.cross(u, offset)
                pull = sign * tensions[:, tendon, None] * along / np.linalg.norm(along, axis=1)[:, None]
                force += pull
                moment += np.cross(offset, pull)
                if general_robot.tendon_segments[tendon] > segment:
                    kinks.append(pull)
        # The stage at a step's end is of the integrator's order; at four steps a gap that is 1e-8 of 30 N.
        np.testing.assert_allclose(force, 0.0, atol=1e-6)
        np.testing.assert_allclose(moment, 0.0, atol=1e-8)
    # The tendons that pass do bend there: leaving their kink out would leave this force over.
    passing = len(np.flatnonzero(general_robot.tendon_segments > 0))
    kink = sum(kinks[:passing]) + sum(kinks[passing : 2 * passing])
    assert np.linalg.norm(kink, axis=1).max() > 1e-3


def test_moment_of_a_straight_cantilever(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of()
    solution = solve_statics(robot, np.zeros((1, 3)), tip_force=[1e-4, 0.0, 0.0])
    profile = rod_profile(robot, solution)
    # Bent by 1e-4 of its length, moment and force are those of the straight rod to 1e-4.
    np.testing.assert_allclose(profile.moment[0, :, :, 1], 1e-4 * (0.2 - profile.arc_lengths), atol=2e-9)
    np.testing.assert_allclose(profile.force[0, :, :, 0], 1e-4, rtol=1e-4)


def test_no_equilibrium_no_profile(paper_robot: RobotSpec) -> None:
    solution = solve_statics(paper_robot, np.ones((1, 3)), tip_force=[1e5, 0.0, -1e5])
    assert np.isnan(rod_profile(paper_robot, solution).curvature).all()


def test_integral_has_the_integrators_order(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of(disks=5)
    values = []
    for steps in (1, 2, 4):
        settings = SolverSettings(tolerance=1e-12, steps_per_gap=steps)
        solution = solve_statics(robot, [[2.0, 0.0, 1.0]], tip_force=[0.08, -0.08, 0.05], settings=settings)
        profile = rod_profile(robot, solution)
        values.append(profile.integral((profile.curvature**2).sum(axis=-1))[0])
    assert 3.5 < np.log2(abs(values[0] - values[1]) / abs(values[1] - values[2])) < 4.7
