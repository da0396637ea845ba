"""JSON text as an object: what is nested too deeply, named twice or no finite number is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from tdcr_planner.errors import FormatError


def parse_json(text: str | bytes, path: str | Path, place: str = "") -> dict[str, Any]:
    """Returns the object that a JSON text holds.

    Args:
        text: The text.
        path: The file that it comes from, for messages.
        place: Where in the file it stands.

    Raises:
        FormatError: It is no JSON, no object, nested too deeply, names a key twice, holds a number beyond floats or
            half of a character.
    """
    try:
        content = json.loads(
            text, object_pairs_hook=_once_each, parse_float=_finite_float, parse_constant=_refuse_constant
        )
        if ("\\u" if isinstance(text, str) else b"\\u") in text:  # type: ignore[operator]
            # JSON can spell halves of characters, which no text file can hold.
            json.dumps(content, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        raise FormatError(path, f"is not valid JSON: {error}", place) from error
    if not isinstance(content, dict):
        raise FormatError(path, f"expected a JSON object, got {type(content).__name__}", place)
    return content


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"key {next(name for name in names if names.count(name) > 1)!r} stands there twice")
    return content


def _finite_float(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is beyond the numbers that are read")
    return number


def _refuse_constant(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")
