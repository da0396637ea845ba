"""Backbone strain and stress against the arc, and their limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.solver import solve_statics
from tdcr_planner.statics.strain import largest_bending_strain, largest_bending_stress, within_strain_limits


def test_strain_of_an_arc(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of()
    solution = solve_statics(robot, [[3.0, 0.0, 0.0]])
    # kappa = M / (E I), the relative error of which is the axial strain of 6e-5.
    strain = 0.0005 * 3.0 * 0.008 / robot.backbone.stiffness_bending_torsion[0]
    np.testing.assert_allclose(largest_bending_strain(robot, solution), [[strain]], rtol=2e-4)
    np.testing.assert_allclose(largest_bending_stress(robot, solution), [[60e9 * strain]], rtol=2e-4)


def test_a_tip_force_strains_most_at_the_clamp(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of(circles=(0.008, 0.006))
    force = 1e-3
    solution = solve_statics(robot, np.zeros((1, 6)), tip_force=[force, 0.0, 0.0])
    per_moment = 0.0005 / robot.backbone.stiffness_bending_torsion[0]
    # The moment is force x distance from the tip in the straight shape; bent by 1e-3 of its length it is that to 1e-5.
    expected = [per_moment * force * 0.2, per_moment * force * 0.1]
    np.testing.assert_allclose(largest_bending_strain(robot, solution)[0], expected, rtol=1e-4)


def test_rest_curvature_and_torsion_are_no_bending_strain(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of(backbone={"rest_curvature_1_m": [3.0, -2.0, 0.0]})
    solution = solve_statics(robot, np.zeros((1, 3)))
    np.testing.assert_allclose(largest_bending_strain(robot, solution), 0.0, atol=1e-12)
    twisted = solve_statics(robot_of(), np.zeros((1, 3)), tip_moment=[0.0, 0.0, 0.005])
    np.testing.assert_allclose(largest_bending_strain(robot_of(), twisted), 0.0, atol=1e-12)


def test_limits(robot_of: Callable[..., RobotSpec]) -> None:
    tensions = np.array([[0.5, 0.0, 0.0], [3.0, 0.0, 0.0]])
    free, limited = robot_of(), robot_of(backbone={"max_strain": 0.002})
    assert within_strain_limits(free, solve_statics(free, tensions)).tolist() == [True, True]
    assert within_strain_limits(limited, solve_statics(limited, tensions)).tolist() == [True, False]
    lost = solve_statics(limited, tensions[:1], tip_force=[1e4, 0.0, -1e4])
    assert not within_strain_limits(limited, lost)[0]
