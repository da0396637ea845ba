"""Faults of a robot file that concern several keys: collected, each with its place, and raised together."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

Place = tuple[int | str, ...]


class Faults:
    """Collects faults as pydantic's own validation does, so that a message can name the key of each."""

    def __init__(self) -> None:
        self._found: list[InitErrorDetails] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def add(self, place: Place, problem: str, value: Any = None) -> None:
        """Notes a fault.

        Args:
            place: The key, from the file's top, with lists counted from 0.
            problem: What is wrong, what came and what would be valid.
            value: What came.
        """
        kind = PydanticCustomError("value_error", "{problem}", {"problem": problem})
        self._found.append(InitErrorDetails(type=kind, loc=place, input=value))

    def raise_if_any(self, title: str) -> None:
        """Raises pydantic's ValidationError with all faults; nothing where there is none."""
        if self._found:
            raise ValidationError.from_exception_data(title, self._found)


def name_of(place: Place) -> str:
    """Returns a place as messages write it, lists counted from 1: ("tendons", 0, "radius_m") as tendons[1].radius_m."""
    text = ""
    for item in place:
        text += f"[{item + 1}]" if isinstance(item, int) else (f".{item}" if text else item)
    return text
