from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tdcr_planner.errors import InputError
from tdcr_planner.se3 import (
    rotation_about_z,
    rotation_distance,
    rotation_from_quaternion,
    rotation_from_vector,
    transform_points,
)

component = st.floats(-3.0, 3.0)
vector = st.tuples(component, component, component).map(np.array)
# All compare sums of a few float64 products of size 1 to 10.
ROUNDING = 1e-13


@given(vector)
def test_rotation_from_vector_equals_scipy(rotation_vector: np.ndarray) -> None:
    expected = Rotation.from_rotvec(rotation_vector).as_matrix()
    np.testing.assert_allclose(rotation_from_vector(rotation_vector), expected, atol=ROUNDING)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-7, 9.9e-7, 1.1e-6, 1e-5])
def test_rotation_from_small_vectors_has_no_step(size: float) -> None:
    rotation_vector = size * np.array([0.6, 0.0, 0.8])
    expected = Rotation.from_rotvec(rotation_vector).as_matrix()
    np.testing.assert_allclose(rotation_from_vector(rotation_vector), expected, atol=1e-15)


@given(st.tuples(component, component, component, component).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_rotation_from_quaternion_equals_scipy(quaternion: tuple[float, float, float, float]) -> None:
    expected = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), expected, atol=ROUNDING)


def test_zero_quaternion_is_refused() -> None:
    with pytest.raises(InputError, match="quaternion"):
        rotation_from_quaternion([0.0, 0.0, 0.0, 0.0])


@given(vector, st.floats(1e-9, 3.1))
def test_rotation_distance_is_the_angle_between(first: np.ndarray, angle: float) -> None:
    start = rotation_from_vector(first)
    turned = start @ rotation_from_vector(angle * np.array([2.0, -1.0, 2.0]) / 3.0)
    # Matrix entries are rounded to 1e-16; near pi the arcsine amplifies that by its slope, up to 1 / cos(1.55).
    assert rotation_distance(start, turned) == pytest.approx(angle, abs=1e-13)


def test_rotation_about_z_turns_x_to_y() -> None:
    np.testing.assert_allclose(rotation_about_z(np.array([np.pi / 2]))[0] @ [1, 0, 0], [0, 1, 0], atol=1e-16)


def test_transform_points_is_a_rotation_then_a_shift() -> None:
    rotation = rotation_about_z(np.array([np.pi / 2, 0.0]))
    points = np.array([[[1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]]])
    moved = transform_points(rotation, np.array([[0.0, 0.0, 1.0], [0.0, 2.0, 0.0]]), points)
    np.testing.assert_allclose(moved[:, 0], [[0, 1, 1], [1, 2, 0]], atol=1e-16)
