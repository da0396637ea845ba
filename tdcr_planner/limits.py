"""Limits that hold to rounding: a value within rounding of the end of its range counts as that end."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray

ROUNDING = 1e-9
"""Relative to the size of a range. Changing units, sums and decimal text lose some 1e-15; no drive resolves 1e-9."""


def at_most(values: ArrayLike, limits: ArrayLike) -> BoolArray:
    """Returns where sizes keep a limit, to rounding of the range from 0 to the limit.

    Args:
        values: Sizes, shape (..., m).
        limits: Limits of 0 or more in the same unit, a shape that broadcasts; infinite for none.

    Returns:
        The broadcast shape; false for NaN.
    """
    return np.asarray(np.asarray(values, dtype=np.float64) <= np.multiply(limits, 1.0 + ROUNDING), dtype=np.bool_)


def snap(values: ArrayLike, low: ArrayLike, high: ArrayLike) -> FloatArray:
    """Returns values with those within rounding of an end of their range moved onto it; all others as they are.

    Args:
        values: Shape (..., m).
        low: Lower ends, a shape that broadcasts.
        high: Upper ends.
    """
    array, lower, upper = (np.asarray(item, dtype=np.float64) for item in (values, low, high))
    slack = ROUNDING * (upper - lower)
    near = (array >= lower - slack) & (array <= upper + slack)
    return np.where(near, np.clip(array, lower, upper), array)
