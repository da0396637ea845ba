"""Vectors on the command line: numbers separated by commas."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.bounds import LOAD
from tdcr_planner.errors import InputError


def parse_vector(name: str, text: str, length: int) -> FloatArray:
    """Returns the numbers of a text such as "0,0,-9.81".

    Args:
        name: The option's name, for the message.
        text: Numbers separated by commas.
        length: How many there must be.

    Raises:
        InputError: Another count, something that is no number, or a number that is not finite or far too large.
    """
    expected = f"{length} numbers separated by commas"
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise InputError(name, expected, repr(text)) from error
    if values.size != length or not np.isfinite(values).all():
        raise InputError(name, expected, repr(text))
    for value in values.tolist():
        LOAD.check(name, value)
    return values
