"""The reference as a shape model."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.base import ShapeModel
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape
from tdcr_planner.shape.reference import ReferenceShape
from tdcr_planner.statics.solver import SolverSettings, SolveStatus, solve_statics


def test_it_is_a_shape_model(any_robot: RobotSpec) -> None:
    model = ReferenceShape(any_robot)
    assert isinstance(model, ShapeModel)
    assert model.name == "reference"
    np.testing.assert_array_equal(model.error_bound, np.zeros(any_robot.disk_count))
    assert model.in_domain(np.ones((4, any_robot.tendon_count)), np.zeros((4, 3)), np.zeros((4, 3))).all()


def test_it_returns_what_the_solver_returns(two_segment_robot: RobotSpec, random: np.random.Generator) -> None:
    tensions = random.uniform(0.0, 3.0, (5, 6))
    poses = ReferenceShape(two_segment_robot).disk_poses(tensions, gravity=[0, 0, -9.81], tip_force=[0.02, 0, 0])
    solution = solve_statics(two_segment_robot, tensions, gravity=[0, 0, -9.81], tip_force=[0.02, 0, 0])
    np.testing.assert_array_equal(poses.positions, solution.positions)
    np.testing.assert_array_equal(poses.rotations, solution.rotations)
    assert poses.solved.all()


def test_without_loads_one_segment_is_the_arc(paper_robot: RobotSpec, random: np.random.Generator) -> None:
    tensions = paper_robot.tensions_from_bending(random.uniform(-1.5, 1.5, (20, 1, 2)))
    poses = ReferenceShape(paper_robot).disk_poses(tensions)
    arc = ConstantCurvatureShape(paper_robot).disk_poses(tensions)
    # Axial compression of up to 3.5 N / (E A) = 7e-5 over 0.2 m, and as much in the curvature.
    np.testing.assert_allclose(poses.positions, arc.positions, atol=3e-5)


def test_neither_lost_nor_unstable_shapes_count_as_solved(paper_robot: RobotSpec) -> None:
    model = ReferenceShape(paper_robot, SolverSettings(steps_per_gap=2))
    forces = np.array([[0.0, 0.0, -0.1], [0.0, 0.0, -0.3], [1e4, 0.0, -1e4]])
    solution = model.solve(np.zeros((3, 3)), tip_force=forces)
    assert solution.status.tolist()[:2] == [SolveStatus.CONVERGED, SolveStatus.UNSTABLE]
    assert model.disk_poses(np.zeros((3, 3)), tip_force=forces).solved.tolist() == [True, False, False]


def test_bad_input_is_refused(paper_robot: RobotSpec) -> None:
    with pytest.raises(InputError, match="only pull"):
        ReferenceShape(paper_robot).disk_poses([[1.0, -1.0, 0.0]])
