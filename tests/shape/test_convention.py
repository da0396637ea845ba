"""Conventions: what a network of another one answers is what ours would."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import rotation_distance
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape
from tdcr_planner.shape.convention import Convention, decode, encode

ORDER = (1, 2, 3)


@pytest.fixture(scope="module")
def shapes() -> tuple[np.ndarray, np.ndarray, np.ndarray, RobotSpec]:
    from pathlib import Path

    from tdcr_planner.robot import load_robot

    robot = load_robot(Path(__file__).resolve().parents[2] / "models/robots/paper.toml")
    tensions = np.random.default_rng(5).uniform(0.1, 3.0, (4, 3))
    poses = ConstantCurvatureShape(robot).disk_poses(tensions)
    return tensions, poses.positions, poses.rotations, robot


def answers(outputs: tuple[str, ...], positions: np.ndarray, rotations: np.ndarray) -> list[np.ndarray]:
    turn = Rotation.from_matrix(rotations.reshape(-1, 3, 3))
    poses = np.zeros((*positions.shape[:2], 4, 4))
    poses[..., :3, :3], poses[..., :3, 3], poses[..., 3, 3] = rotations, positions, 1.0
    each = {
        "positions": positions,
        "rotations": rotations,
        "poses": poses,
        "quaternions_wxyz": 2.0 * turn.as_quat(scalar_first=True).reshape(*positions.shape[:2], 4),
        "quaternions_xyzw": turn.as_quat().reshape(*positions.shape[:2], 4),
        "rotations_6d": np.concatenate([3.0 * rotations[..., 0], rotations[..., 1]], axis=-1),
        "rotation_vectors": turn.as_rotvec().reshape(*positions.shape[:2], 3),
    }
    return [each[name] for name in outputs]


@pytest.mark.parametrize(
    "outputs",
    [
        ("positions", "rotations"),
        ("poses",),
        ("quaternions_wxyz", "positions"),
        ("positions", "quaternions_xyzw"),
        ("positions", "rotations_6d"),
        ("positions", "rotation_vectors"),
    ],
)
@pytest.mark.parametrize("joined", [False, True])
def test_outputs_come_back_as_ours(shapes, outputs, joined) -> None:
    _, positions, rotations, robot = shapes
    given = answers(outputs, positions, rotations)
    if joined:
        given = [np.concatenate([part.reshape(*positions.shape[:2], -1) for part in given], axis=2)]
    convention = Convention(inputs=("tensions",), outputs=outputs, outputs_joined=joined, tendon_order=ORDER)
    p, R = decode(convention, robot, len(positions), given)
    np.testing.assert_allclose(p, positions, atol=1e-15)
    np.testing.assert_allclose(R, rotations, atol=1e-12)


def test_units_frames_and_orders_are_undone(shapes) -> None:
    tensions, positions, rotations, robot = shapes
    turn = Rotation.from_euler("z", 30, degrees=True)
    convention = Convention(
        inputs=("gravity", "tensions", "tip_force", "bending"),
        outputs=("positions", "rotations"),
        length_unit="mm",
        force_unit="mN",
        tendon_order=(3, 1, 2),
        base_quaternion_wxyz=tuple(turn.as_quat(scalar_first=True)),
        transposed=True,
        disk_order="tip_to_base",
        with_base=False,
    )
    matrix = turn.as_matrix()
    theirs = np.swapaxes(matrix @ rotations @ matrix.T, -1, -2)
    p, R = decode(convention, robot, 4, [1e3 * (positions @ matrix.T)[:, :0:-1], theirs[:, :0:-1]])
    np.testing.assert_allclose(p, positions, atol=1e-15)
    np.testing.assert_allclose(R, rotations, atol=1e-14)

    load = np.tile([1.0, 0.0, 2.0], (4, 1))
    gravity, tension, force, bending = encode(convention, robot, tensions, load, load)
    np.testing.assert_allclose(gravity[0], turn.apply([1.0, 0.0, 2.0]), atol=1e-12)
    np.testing.assert_allclose(force, 1e3 * gravity)
    np.testing.assert_allclose(tension, 1e3 * tensions[:, [2, 0, 1]])
    ours = robot.bending_from_tensions(tensions)[:, 0]
    np.testing.assert_allclose(bending, 1e3 * ours @ matrix[:2, :2].T)


def test_points_have_a_row_a_disk(shapes) -> None:
    tensions, _, _, robot = shapes
    convention = Convention(
        inputs=("arc_length", "tensions"),
        inputs_joined=True,
        rows="points",
        outputs=("positions",),
        with_base=False,
        tendon_order=ORDER,
        number="float32",
    )
    (rows,) = encode(convention, robot, tensions, np.zeros((4, 3)), np.zeros((4, 3)))
    assert rows.shape == (4 * (robot.disk_count - 1), 4)
    assert rows.dtype == np.float32
    np.testing.assert_allclose(rows[: robot.disk_count - 1, 0], robot.arc_lengths[1:], rtol=1e-6)


def test_positions_alone_give_rotations_along_the_curve(shapes) -> None:
    _, positions, rotations, robot = shapes
    convention = Convention(inputs=("tensions",), outputs=("positions",), tendon_order=ORDER)
    p, R = decode(convention, robot, 4, [positions])
    np.testing.assert_array_equal(p, positions)
    # Of an arc: a cubic spline's slope errs by (u h)^3 / 24, below 1e-4 here.
    assert rotation_distance(R, rotations).max() < 1e-4


def test_nearly_rotations_become_rotations(shapes) -> None:
    _, positions, rotations, robot = shapes
    convention = Convention(inputs=("tensions",), outputs=("positions", "rotations"), tendon_order=ORDER)
    _, R = decode(convention, robot, 4, [positions, rotations + 1e-3])
    np.testing.assert_allclose(np.swapaxes(R, -1, -2) @ R, np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    assert (np.linalg.det(R) > 0.0).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"inputs": ("gravity",)}, "tensions or bending"),
        ({"outputs": ("rotations",)}, "positions or poses"),
        ({"tendon_order": (1, 1, 2)}, "each tendon once"),
        ({"rows": "points"}, "arc_length"),
        ({"inputs": ("tensions", "tensions")}, "each once"),
        ({"base_quaternion_wxyz": (0.0, 0.0, 0.0, 0.0)}, "length 1"),
    ],
)
def test_conventions_that_do_not_fit_together_are_refused(changes, words) -> None:
    with pytest.raises(ValidationError, match=words):
        Convention(**({"inputs": ("tensions",), "outputs": ("positions",), "tendon_order": ORDER} | changes))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (np.zeros((4, 20, 3)), "3 numbers for each of 21 disks of 4 states"),
        (np.zeros((4, 7, 3, 3)), "3 numbers for each of 21 disks of 4 states"),
        (np.zeros((4, 21, 3), dtype=np.int64), "int64"),
        (np.zeros((4, 21, 3), dtype=np.float16), "float16"),
    ],
)
def test_answers_of_another_shape_or_type_are_refused(shapes, answer, words) -> None:
    robot = shapes[3]
    convention = Convention(inputs=("tensions",), outputs=("positions",), tendon_order=ORDER)
    with pytest.raises(InputError, match=words):
        decode(convention, robot, 4, [answer])
