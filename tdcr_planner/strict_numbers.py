"""Numbers in files: what counts as one, and how a message shows what does not."""

from __future__ import annotations

import math
import reprlib
from typing import Any, cast

from pydantic_core import CoreSchema, core_schema

LARGEST_NUMBER = 1e30
"""Of any number in a file: fourth powers of it, as of a radius in a stiffness, are still finite."""


def describe_value(value: object) -> str:
    """Returns what a message shows of a value: its form in Python, cut where it is long."""
    short = reprlib.Repr()
    short.maxlist = short.maxtuple = short.maxdict = 8
    short.maxstring = short.maxother = 120
    short.maxlevel = 2
    try:
        return short.repr(value)
    except ValueError:  # Python writes no number of more than 4300 digits
        return "a number of thousands of digits"


def _check_number(value: Any) -> Any:
    if isinstance(value, bool | str):
        raise ValueError(f"input should be a valid number, got {describe_value(value)}")
    if isinstance(value, int | float) and LARGEST_NUMBER < abs(value) < math.inf:
        raise ValueError(f"expected a number of at most {LARGEST_NUMBER:g} in size, got {describe_value(value)}")
    return value


def with_strict_numbers(schema: Any) -> Any:
    """Returns a core schema of pydantic whose numbers, wherever they stand in it, pass `_check_number` first."""
    if isinstance(schema, list | tuple):
        return type(schema)(with_strict_numbers(item) for item in schema)
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "function-before" and schema["function"].get("function") is _check_number:
        return schema
    if schema.get("type") in ("int", "float"):
        return core_schema.no_info_before_validator_function(_check_number, cast(CoreSchema, schema))
    if schema.get("type") == "bool":
        return {**schema, "strict": True}
    return {key: with_strict_numbers(value) for key, value in schema.items()}
