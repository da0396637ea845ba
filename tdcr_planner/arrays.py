"""Checks that turn what a caller passes into float64 arrays of the shape a function needs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tdcr_planner.errors import InputError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


def check_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Returns a value as a finite, C-contiguous float64 array of the given shape that can be written to.

    To compiled code an array that is read-only has another type, for which it would be compiled once more.

    Args:
        name: The argument's name, for the message.
        value: Anything numpy can read as numbers.
        shape: The expected shape; None where any length is allowed.

    Raises:
        InputError: The value is not numeric, has another shape, or holds NaN or infinity.
    """
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(name, "numbers", f"{type(value).__name__} ({error})") from error
    if np.ndim(value) == 0:
        array = array.reshape(())
    fits = array.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("n" if want is None else str(want) for want in shape)
        raise InputError(name, f"shape ({wanted})", f"shape {array.shape}")
    finite = np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise InputError(name, "finite numbers", f"{array[index]} at index {index}")
    return array if array.flags.writeable else array.copy()


def check_batch(name: str, value: ArrayLike | None, count: int, width: int) -> FloatArray:
    """Returns a vector or a batch of vectors as shape (count, width); None as zeros.

    Args:
        name: The argument's name, for the message.
        value: Shape (width,) to be used for every case, (count, width), or None.
        count: Number of cases n.
        width: Length of each vector.
    """
    if value is None:
        return np.zeros((count, width))
    if np.ndim(value) == 1:
        return np.tile(check_array(name, value, (width,)), (count, 1))
    return check_array(name, value, (count, width))


def check_positive(name: str, value: float) -> float:
    """Returns a number that is finite and greater than zero, or raises InputError."""
    number = float(check_array(name, value, ()))
    if number <= 0.0:
        raise InputError(name, "a number greater than 0", number)
    return number
