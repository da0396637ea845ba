from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import rotation_distance
from tdcr_planner.shape.base import ShapeModel
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape


def test_it_is_a_shape_model(any_robot: RobotSpec) -> None:
    assert isinstance(ConstantCurvatureShape(any_robot), ShapeModel)


@pytest.mark.parametrize("force", [0.0, 1e-6, 1e-3, 0.7, 3.5])
def test_one_tendon_gives_the_textbook_arc(paper_robot: RobotSpec, force: float) -> None:
    poses = ConstantCurvatureShape(paper_robot).disk_poses([[force, 0.0, 0.0]])
    curvature = force * 0.008 / (60e9 * np.pi / 4 * 0.0005**4)
    angle = curvature * paper_robot.arc_lengths
    # The tendon stands at 90 degrees, so the arc lies in the y-z plane. sin(x)/x and (1-cos(x))/x^2 are what the
    # arc's coordinates are made of; np.sinc keeps both exact at zero.
    along = paper_robot.arc_lengths * np.sinc(angle / np.pi)
    across = 0.5 * curvature * paper_robot.arc_lengths**2 * np.sinc(angle / 2 / np.pi) ** 2
    expected = np.stack([np.zeros(21), across, along], axis=1)
    np.testing.assert_allclose(poses.positions[0], expected, atol=1e-14)
    np.testing.assert_allclose(rotation_distance(poses.rotations[0], np.eye(3)), angle, atol=1e-12)


def test_distal_tendons_bend_both_segments(two_segment_robot: RobotSpec) -> None:
    poses = ConstantCurvatureShape(two_segment_robot).disk_poses([[0, 0, 0, 0, 0, 2.0]])
    angle = rotation_distance(poses.rotations[0, 1:], poses.rotations[0, :-1])
    np.testing.assert_allclose(angle, angle[0], rtol=1e-9)
    assert poses.positions[0, -1, 1] < 0.0


def test_rotations_stay_orthonormal(any_robot: RobotSpec, random: np.random.Generator) -> None:
    tensions = random.uniform(0.0, 1.0, (200, any_robot.tendon_count)) * any_robot.max_tensions
    rotations = ConstantCurvatureShape(any_robot).disk_poses(tensions).rotations
    np.testing.assert_allclose(
        np.swapaxes(rotations, -1, -2) @ rotations, np.broadcast_to(np.eye(3), rotations.shape), atol=1e-13
    )


def test_loads_are_checked_though_ignored(paper_robot: RobotSpec) -> None:
    model = ConstantCurvatureShape(paper_robot)
    loaded = model.disk_poses([[1.0, 0, 0]], gravity=[0, 9.81, 0], tip_force=[0.1, 0, 0])
    np.testing.assert_array_equal(loaded.positions, model.disk_poses([[1.0, 0, 0]]).positions)
    with pytest.raises(InputError, match="gravity"):
        model.disk_poses([[1.0, 0, 0]], gravity=[0, np.nan, 0])
