"""The compiled rod against the reference solver, which is other code, and against itself at other steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.rod_kernel import (
    integrate_poses,
    rod_constants,
    rod_constants_at,
    tip_residual,
    tip_residual_jacobian,
)
from tdcr_planner.statics.solver import RodSolution, solve_statics


def loaded_cases(robot: RobotSpec, count: int, random: np.random.Generator) -> tuple[np.ndarray, ...]:
    tensions = random.uniform(0.0, 1.0, (count, robot.tendon_count)) * robot.max_tensions
    return tensions, random.normal(0.0, 5.0, (count, 3)), random.normal(0.0, 0.02, (count, 3))


@pytest.fixture(scope="module")
def solved(two_segment_robot: RobotSpec) -> tuple[tuple[np.ndarray, ...], RodSolution]:
    cases = loaded_cases(two_segment_robot, 40, np.random.default_rng(5))
    solution = solve_statics(two_segment_robot, cases[0], gravity=cases[1], tip_force=cases[2])
    assert solution.converged.all()
    return cases, solution


def test_shape_and_tip_moment_are_those_of_the_reference(any_robot, random):
    cases = loaded_cases(any_robot, 60, random)
    solution = solve_statics(any_robot, cases[0], gravity=cases[1], tip_force=cases[2])
    ok = solution.converged
    assert ok.mean() > 0.9
    cases = tuple(array[ok] for array in cases)
    positions, rotations, residual = integrate_poses(rod_constants(any_robot), *cases, solution.base_moment[ok])
    # Two fourth-order integrators at one step a gap: each is within some micrometres of the limit.
    np.testing.assert_allclose(positions, solution.positions[ok], atol=1e-5)
    np.testing.assert_allclose(rotations, solution.rotations[ok], atol=1e-4)
    np.testing.assert_allclose(residual, 0.0, atol=2e-6)


def test_without_loads_the_robot_is_the_arc(paper_robot, random):
    tensions = random.uniform(0.0, 3.5, (20, 3))
    zero = np.zeros((20, 3))
    positions, rotations, residual = integrate_poses(rod_constants(paper_robot), tensions, zero, zero, zero)
    assert (residual == 0.0).all()
    moment = tensions @ paper_robot.tendon_offsets[:, :2]
    curvature = np.linalg.norm(moment, axis=1) / paper_robot.backbone.stiffness_bending_torsion[0]
    turned = np.arccos(rotations[:, -1, 2, 2])
    # kappa = M / EI; the compression of the axis makes the arc shorter, not its angle smaller.
    np.testing.assert_allclose(turned, curvature * paper_robot.length, rtol=1e-12)
    stretch = 1.0 - tensions.sum(axis=1) / paper_robot.backbone.stiffness_shear_extension[2]
    chord = np.linalg.norm(positions[:, -1], axis=1)
    expected = stretch * 2.0 * np.sin(0.5 * curvature * paper_robot.length) / curvature
    np.testing.assert_allclose(chord, expected, rtol=1e-12)


def test_tendons_at_one_place_share_their_tension(paper_robot, random):
    tensions, gravity, tip_force = loaded_cases(paper_robot, 9, random)
    moment = random.normal(0.0, 0.005, (9, 3))
    constants = rod_constants(paper_robot)
    nine = replace(constants, offsets=np.tile(constants.offsets, (3, 1)))
    whole = integrate_poses(constants, tensions, gravity, tip_force, moment)
    shared = integrate_poses(nine, np.tile(tensions / 3.0, (1, 3)), gravity, tip_force, moment)
    for expected, found in zip(whole, shared, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-13)


def test_converges_with_the_step(two_segment_robot, solved):
    cases, solution = solved
    tips = []
    for parts in (1, 2, 4, 32):
        stops = np.interp(
            np.arange(20 * parts + 1) / parts, np.arange(two_segment_robot.disk_count), two_segment_robot.arc_lengths
        )
        constants, _ = rod_constants_at(two_segment_robot, stops)
        tips.append(integrate_poses(constants, *cases, solution.base_moment)[0][:, -1])
    errors = np.array([np.linalg.norm(tip - tips[-1], axis=1).max() for tip in tips[:-1]])
    # What is left at one step a gap is the age of the tendon sums, one stage: an error of first order, and tiny.
    assert errors[0] < 2e-6
    assert (errors[:-1] / errors[1:] > 1.7).all(), errors


def test_stops_between_disks_do_not_move_the_disks(two_segment_robot, solved):
    cases, solution = solved
    between = np.array([0.0, 0.0042, 0.0577, 0.1, 0.1731, 0.2])
    constants, columns = rod_constants_at(two_segment_robot, between)
    positions, _, _ = integrate_poses(constants, *cases, solution.base_moment)
    disks, _, _ = integrate_poses(rod_constants(two_segment_robot), *cases, solution.base_moment)
    # More stops are smaller steps: they change the result by the error of the larger ones.
    np.testing.assert_allclose(positions[:, columns[[0, 3, 5]]], disks[:, [0, 10, 20]], atol=2e-6)


@settings(max_examples=12, deadline=None)
@given(count=st.integers(1, 40))
def test_a_case_does_not_depend_on_its_neighbours(count, two_segment_robot):
    cases = loaded_cases(two_segment_robot, count, np.random.default_rng(count))
    moment = np.random.default_rng(count).normal(0.0, 0.005, (count, 3))
    constants = rod_constants(two_segment_robot)
    together = integrate_poses(constants, *cases, moment)
    last = integrate_poses(constants, *(array[-1:] for array in cases), moment[-1:])
    for whole, single in zip(together, last, strict=True):
        np.testing.assert_array_equal(whole[-1:], single)


def test_jacobian_is_that_of_central_differences(two_segment_robot, solved):
    cases, solution = solved
    constants = rod_constants(two_segment_robot)
    residual, jacobian = tip_residual_jacobian(constants, *cases, solution.base_moment)
    np.testing.assert_array_equal(residual, tip_residual(constants, *cases, solution.base_moment))
    for column in range(3):
        step = np.zeros(3)
        step[column] = 1e-5
        ahead = tip_residual(constants, *cases, solution.base_moment + step)
        behind = tip_residual(constants, *cases, solution.base_moment - step)
        np.testing.assert_allclose(jacobian[:, :, column], (ahead - behind) / 2e-5, atol=2e-4)


def test_rotations_are_orthonormal(two_segment_robot, solved):
    cases, solution = solved
    _, rotations, _ = integrate_poses(rod_constants(two_segment_robot), *cases, solution.base_moment)
    np.testing.assert_allclose(
        np.swapaxes(rotations, -1, -2) @ rotations, np.broadcast_to(np.eye(3), rotations.shape), atol=1e-13
    )
