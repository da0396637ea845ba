"""Small matrices in compiled code: inverses, linear systems, signs of eigenvalues."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.options import OPTIONS


@njit(**OPTIONS)
def invert3(matrix: FloatArray, inverse: FloatArray) -> float:
    """Writes the inverse of a 3 x 3 matrix by its adjugate and returns the determinant (0 leaves it unwritten)."""
    c00 = matrix[1, 1] * matrix[2, 2] - matrix[1, 2] * matrix[2, 1]
    c01 = matrix[1, 2] * matrix[2, 0] - matrix[1, 0] * matrix[2, 2]
    c02 = matrix[1, 0] * matrix[2, 1] - matrix[1, 1] * matrix[2, 0]
    det = matrix[0, 0] * c00 + matrix[0, 1] * c01 + matrix[0, 2] * c02
    if det == 0.0 or not np.isfinite(det):
        return 0.0
    s = 1.0 / det
    inverse[0, 0] = c00 * s
    inverse[1, 0] = c01 * s
    inverse[2, 0] = c02 * s
    inverse[0, 1] = (matrix[0, 2] * matrix[2, 1] - matrix[0, 1] * matrix[2, 2]) * s
    inverse[1, 1] = (matrix[0, 0] * matrix[2, 2] - matrix[0, 2] * matrix[2, 0]) * s
    inverse[2, 1] = (matrix[0, 1] * matrix[2, 0] - matrix[0, 0] * matrix[2, 1]) * s
    inverse[0, 2] = (matrix[0, 1] * matrix[1, 2] - matrix[0, 2] * matrix[1, 1]) * s
    inverse[1, 2] = (matrix[0, 2] * matrix[1, 0] - matrix[0, 0] * matrix[1, 2]) * s
    inverse[2, 2] = (matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]) * s
    return det


@njit(**OPTIONS)
def positive_spectrum(numerator: FloatArray, denominator: FloatArray) -> bool:
    """Returns whether every eigenvalue of numerator @ denominator^-1 (3 x 3) has a positive real part.

    Routh-Hurwitz on the characteristic polynomial; false where the denominator is singular.
    """
    inverse = np.empty((3, 3))
    det = invert3(denominator, inverse)
    if det == 0.0:
        return False
    q = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            q[i, j] = (
                numerator[i, 0] * inverse[0, j] + numerator[i, 1] * inverse[1, j] + numerator[i, 2] * inverse[2, j]
            )
    first = q[0, 0] + q[1, 1] + q[2, 2]
    second = (
        q[0, 0] * q[1, 1]
        - q[0, 1] * q[1, 0]
        + q[0, 0] * q[2, 2]
        - q[0, 2] * q[2, 0]
        + q[1, 1] * q[2, 2]
        - q[1, 2] * q[2, 1]
    )
    third = (
        q[0, 0] * (q[1, 1] * q[2, 2] - q[1, 2] * q[2, 1])
        - q[0, 1] * (q[1, 0] * q[2, 2] - q[1, 2] * q[2, 0])
        + q[0, 2] * (q[1, 0] * q[2, 1] - q[1, 1] * q[2, 0])
    )
    return first > 0.0 and third > 0.0 and first * second > third


@njit(**OPTIONS)
def negative_eigenvalues(numerator: FloatArray, denominator: FloatArray) -> int:
    """Returns how many eigenvalues of numerator @ denominator^-1 (3 x 3, real eigenvalues) are negative.

    Descartes' rule of signs on the characteristic polynomial, exact where all its roots are real. A singular
    denominator counts as one.
    """
    inverse = np.empty((3, 3))
    if invert3(denominator, inverse) == 0.0:
        return 1
    q = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            q[i, j] = (
                numerator[i, 0] * inverse[0, j] + numerator[i, 1] * inverse[1, j] + numerator[i, 2] * inverse[2, j]
            )
    first = q[0, 0] + q[1, 1] + q[2, 2]
    second = q[0, 0] * q[1, 1] - q[0, 1] * q[1, 0] + q[0, 0] * q[2, 2] - q[0, 2] * q[2, 0]
    second += q[1, 1] * q[2, 2] - q[1, 2] * q[2, 1]
    third = q[0, 0] * (q[1, 1] * q[2, 2] - q[1, 2] * q[2, 1]) - q[0, 1] * (q[1, 0] * q[2, 2] - q[1, 2] * q[2, 0])
    third += q[0, 2] * (q[1, 0] * q[2, 1] - q[1, 1] * q[2, 0])
    count = 1 if first < 0.0 else 0
    if (second < 0.0) != (first < 0.0):
        count += 1
    if (third < 0.0) != (second < 0.0):
        count += 1
    return count


@njit(**OPTIONS)
def invert(matrix: FloatArray, inverse: FloatArray) -> bool:
    """Writes the inverse of a square matrix by elimination with row exchange; the matrix is used up.

    Returns:
        Whether it is regular.
    """
    size = matrix.shape[0]
    for i in range(size):
        for j in range(size):
            inverse[i, j] = 1.0 if i == j else 0.0
    for column in range(size):
        pivot = column
        for i in range(column + 1, size):
            if abs(matrix[i, column]) > abs(matrix[pivot, column]):
                pivot = i
        largest = matrix[pivot, column]
        if not abs(largest) > 0.0:
            return False
        for j in range(size):
            matrix[column, j], matrix[pivot, j] = matrix[pivot, j], matrix[column, j]
            inverse[column, j], inverse[pivot, j] = inverse[pivot, j], inverse[column, j]
        scale = 1.0 / largest
        for j in range(size):
            matrix[column, j] *= scale
            inverse[column, j] *= scale
        for i in range(size):
            factor = matrix[i, column]
            if i != column and factor != 0.0:
                for j in range(size):
                    matrix[i, j] -= factor * matrix[column, j]
                    inverse[i, j] -= factor * inverse[column, j]
    return True
