"""Small linear complementarity problems in compiled code: which tendons are taut, and how hard they pull."""

from __future__ import annotations

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.options import OPTIONS

PASSES = 200


@njit(**OPTIONS)
def solve_active(matrix: FloatArray, right: FloatArray, active: BoolArray, work: FloatArray, x: FloatArray) -> float:
    """Solves the rows and columns of a linear system that are active; x is 0 elsewhere.

    Args:
        matrix: Shape (t, t).
        right: Shape (t,).
        active: Shape (t,).
        work: Shape (t, t + 1); used up.
        x: Shape (t,); written.

    Returns:
        The determinant of the active part, 0 where it is singular; x is unwritten then.
    """
    total = right.shape[0]
    for i in range(total):
        for j in range(total):
            work[i, j] = matrix[i, j] if active[i] and active[j] else (1.0 if i == j else 0.0)
        work[i, total] = right[i] if active[i] else 0.0
    determinant = 1.0
    for k in range(total):
        pivot = k
        for i in range(k + 1, total):
            if abs(work[i, k]) > abs(work[pivot, k]):
                pivot = i
        if not abs(work[pivot, k]) > 0.0:
            return 0.0
        if pivot != k:
            determinant = -determinant
            for j in range(k, total + 1):
                work[k, j], work[pivot, j] = work[pivot, j], work[k, j]
        determinant *= work[k, k]
        for i in range(k + 1, total):
            factor = work[i, k] / work[k, k]
            if factor != 0.0:
                for j in range(k, total + 1):
                    work[i, j] -= factor * work[k, j]
    for i in range(total - 1, -1, -1):
        value = work[i, total]
        for j in range(i + 1, total):
            value -= work[i, j] * x[j]
        x[i] = value / work[i, i]
    return determinant


@njit(**OPTIONS)
def solve_complementary(
    matrix: FloatArray, right: FloatArray, active: BoolArray, work: FloatArray, x: FloatArray
) -> bool:
    """Solves x >= 0, right - matrix x <= 0, one of both zero in each row.

    Active sets as in the primal-dual method (Hintermueller, Ito, Kunisch 2003); where they come round in a circle,
    projected Gauss-Seidel.

    Args:
        matrix: Shape (t, t), positive diagonal.
        right: Shape (t,).
        active: The rows with x > 0 to start from, shape (t,); written.
        work: Shape (t, t + 1); used up.
        x: Shape (t,); written.

    Returns:
        Whether the solution was found.
    """
    total = right.shape[0]
    for _ in range(2 * total + 6):
        if solve_active(matrix, right, active, work, x) == 0.0:
            return False
        changed = False
        for i in range(total):
            rest = right[i]
            if not active[i]:
                for j in range(total):
                    rest -= matrix[i, j] * x[j]
            keeps = x[i] > 0.0 if active[i] else rest > 0.0
            changed = changed or keeps != active[i]
            active[i] = keeps
        if not changed:
            return True
    for i in range(total):
        x[i] = max(x[i], 0.0)
    for _ in range(PASSES):
        for i in range(total):
            rest = right[i]
            for j in range(total):
                rest -= matrix[i, j] * x[j]
            x[i] = max(0.0, x[i] + rest / matrix[i, i])
    for i in range(total):
        active[i] = x[i] > 0.0
    return True


@njit(**OPTIONS)
def negative_pivots(matrix: FloatArray, active: BoolArray, work: FloatArray) -> int:
    """Returns the number of negative eigenvalues of the symmetric part of the active rows and columns."""
    total = matrix.shape[0]
    count = 0
    for i in range(total):
        for j in range(total):
            value = 0.5 * (matrix[i, j] + matrix[j, i])
            work[i, j] = value if active[i] and active[j] else (1.0 if i == j else 0.0)
    for k in range(total):
        if work[k, k] < 0.0:
            count += 1
        if work[k, k] == 0.0:
            continue
        for i in range(k + 1, total):
            factor = work[i, k] / work[k, k]
            for j in range(k, total):
                work[i, j] -= factor * work[k, j]
    return count
