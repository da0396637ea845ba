"""Types of the robot file's fields: pairs of numbers, and numbers that stand for one or for each tendon."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator

from tdcr_planner.files import NotNegative, Positive


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _twice(value: Any) -> Any:
    return (value, value) if _is_number(value) else value


def _as_list(value: Any) -> Any:
    return (value,) if _is_number(value) else value


def _as_list_of_pairs(value: Any) -> Any:
    if isinstance(value, list | tuple) and len(value) == 2 and all(_is_number(item) for item in value):
        return (value,)
    return value


BothAxes = Annotated[tuple[Positive, Positive], BeforeValidator(_twice)]
"""About (or along) the body's x and y axis; one number stands for both."""

PositivePerTendon = Annotated[tuple[Positive, ...], BeforeValidator(_as_list)]
"""A number a tendon; one number stands for all."""

NotNegativePerTendon = Annotated[tuple[NotNegative, ...], BeforeValidator(_as_list)]
"""A number of 0 or more a tendon; one number stands for all."""

RangePerTendon = Annotated[tuple[tuple[float, float], ...], BeforeValidator(_as_list_of_pairs)]
"""A pair [lowest, highest] a tendon; one pair stands for all."""

Stretches = tuple[tuple[NotNegative, Positive], ...]
"""Pairs [start, end] of arc lengths, m."""
