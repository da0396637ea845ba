"""Rotations and rigid poses as matrices: making them, comparing them, applying them to points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray, check_array
from tdcr_planner.errors import InputError


def rotation_from_quaternion(quaternion_wxyz: ArrayLike) -> FloatArray:
    """Returns the rotation matrix, shape (3, 3), of a quaternion (w, x, y, z).

    The quaternion is normalised first; a zero one is an InputError.
    """
    quaternion = check_array("quaternion_wxyz", quaternion_wxyz, (4,))
    norm = float(np.linalg.norm(quaternion))
    if norm < 1e-12:
        raise InputError("quaternion_wxyz", "a quaternion of length above 0", quaternion.tolist())
    w, x, y, z = quaternion / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_about_z(angle: FloatArray) -> FloatArray:
    """Returns rotations about the z axis.

    Args:
        angle: Shape (...), rad.

    Returns:
        Shape (..., 3, 3).
    """
    angle = np.asarray(angle, dtype=np.float64)
    cosine, sine = np.cos(angle), np.sin(angle)
    rotation = np.zeros((*angle.shape, 3, 3))
    rotation[..., 0, 0] = cosine
    rotation[..., 0, 1] = -sine
    rotation[..., 1, 0] = sine
    rotation[..., 1, 1] = cosine
    rotation[..., 2, 2] = 1.0
    return rotation


def skew(vector: FloatArray) -> FloatArray:
    """Returns the matrices [a]x with [a]x b = a x b; vector (..., 3) to (..., 3, 3)."""
    matrix = np.zeros((*vector.shape, 3))
    matrix[..., 0, 1] = -vector[..., 2]
    matrix[..., 0, 2] = vector[..., 1]
    matrix[..., 1, 0] = vector[..., 2]
    matrix[..., 1, 2] = -vector[..., 0]
    matrix[..., 2, 0] = -vector[..., 1]
    matrix[..., 2, 1] = vector[..., 0]
    return matrix


def rotation_from_vector(vector: FloatArray) -> FloatArray:
    """Returns exp([a]x) for rotation vectors a, shape (..., 3) in rad, by Rodrigues' formula."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    second = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    cross = skew(vector)
    return np.eye(3) + first * cross + second * (cross @ cross)


def rotation_distance(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the angle of the rotation between a and b, shape (...), rad, for (..., 3, 3) each.

    The half-angle form 2 asin(|a - b| / (2 sqrt 2)), |.| the Frobenius norm, keeps full precision near zero, where
    acos of the trace loses half the digits.
    """
    chord = np.linalg.norm(np.asarray(a) - np.asarray(b), axis=(-2, -1))
    return 2.0 * np.arcsin(np.clip(chord / (2.0 * np.sqrt(2.0)), 0.0, 1.0))


def transform_points(rotation: FloatArray, translation: FloatArray, points: FloatArray) -> FloatArray:
    """Returns rotation @ point + translation for a batch of poses.

    Args:
        rotation: Shape (n, 3, 3), a_from_b.
        translation: Shape (n, 3), m, origin of b in a.
        points: Shape (n, d, 3), m, in b.

    Returns:
        Shape (n, d, 3), m, in a.
    """
    return np.asarray(points @ np.swapaxes(rotation, -1, -2) + translation[:, None, :])
