"""Reading TOML and JSON against a schema, and hashing files; opening and writing them is in `inputs` and `outputs`."""

from __future__ import annotations

import hashlib
import json
import math
import reprlib
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast, get_args

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema, core_schema

from tdcr_planner.errors import FormatError, nearest_name
from tdcr_planner.inputs import check_file, check_name, find_named_file, open_file, read_bytes, read_text, real_path
from tdcr_planner.outputs import check_file_target, check_folder, is_private, write_file_whole, write_folder_whole

__all__ = [
    "FileModel",
    "NotNegative",
    "Positive",
    "Vector3",
    "check_file",
    "check_file_target",
    "check_folder",
    "check_name",
    "find_named_file",
    "is_private",
    "open_file",
    "parse_table",
    "read_bytes",
    "read_json",
    "read_text",
    "read_toml",
    "real_path",
    "sha256_of_file",
    "sha256_of_json",
    "write_file_whole",
    "write_folder_whole",
]

LARGEST_NUMBER = 1e30
"""Of any number in a file: fourth powers of it, as of a radius in a stiffness, are still finite."""


def describe_value(value: object) -> str:
    """Returns what a message shows of a value: its form in Python, cut where it is long."""
    short = reprlib.Repr()
    short.maxlist = short.maxtuple = short.maxdict = 8
    short.maxstring = short.maxother = 120
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


def _with_strict_numbers(schema: Any) -> Any:
    """Returns a core schema of pydantic whose numbers, wherever they stand in it, pass `_check_number` first."""
    if isinstance(schema, list | tuple):
        return type(schema)(_with_strict_numbers(item) for item in schema)
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "function-before" and schema["function"].get("function") is _check_number:
        return schema
    if schema.get("type") in ("int", "float"):
        return core_schema.no_info_before_validator_function(_check_number, cast(CoreSchema, schema))
    if schema.get("type") == "bool":
        return {**schema, "strict": True}
    return {key: _with_strict_numbers(value) for key, value in schema.items()}


class FileModel(BaseModel):
    """Base of every table read from a file: unknown keys are errors, values cannot change.

    Numbers are finite and at most LARGEST_NUMBER in size. A number is a number: neither true or false nor text.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Returns pydantic's schema, with its numbers as strict as this class says."""
        schema: CoreSchema = _with_strict_numbers(handler(source))
        return schema


Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Count = Annotated[int, Field(ge=0)]
Vector3 = tuple[float, float, float]

Model = TypeVar("Model", bound=BaseModel)


# What TOML and JSON call the containers of Python that pydantic speaks of.
_CONTAINERS = {"tuple_type": "a list", "model_type": "a table of keys", "dict_type": "a table of keys"}


def read_toml(path: str | Path) -> dict[str, Any]:
    """Returns a TOML file's content as a dictionary."""
    try:
        return tomllib.loads(read_text(path))
    except (ValueError, RecursionError) as error:  # more digits than Python reads, or tables too deep
        raise FormatError(path, f"is not valid TOML: {error}") from error


def read_json(path: str | Path) -> dict[str, Any]:
    """Returns a JSON file's content, which must be an object."""
    return parse_json(read_text(path), path)


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


def parse_table(model: type[Model], content: Mapping[str, Any], path: str | Path) -> Model:
    """Returns a schema's object from a file's content.

    Args:
        model: The schema.
        content: What the file holds.
        path: The file, for messages.

    Raises:
        FormatError: Names every fault with its key, what came and what would be valid.
    """
    _check_format(model, content, path)
    try:
        return model.model_validate(dict(content))
    except ValidationError as error:
        faults = [_describe_fault(model, fault) for fault in _innermost(error.errors())]
        place = faults[0][0] if len(faults) == 1 else ""
        if place:
            raise FormatError(path, faults[0][1], place) from error
        raise FormatError(
            path, "; ".join(f"{key}: {problem}" if key else problem for key, problem in faults)
        ) from error


def _check_format(model: type[BaseModel], content: Mapping[str, Any], path: str | Path) -> None:
    """Refuses a file that says it is of another format, whose keys would all be wrong."""
    found = content.get("format")
    field = model.model_fields.get("format")
    known = () if field is None else get_args(field.annotation)
    if known and isinstance(found, str) and found not in known:
        raise FormatError(path, f"is a {found} file, expected {' or '.join(known)}", "format")


def _innermost(faults: Sequence[Any]) -> list[Any]:
    """Returns the faults but for those of a list or table that faults inside of it cause."""
    places = [fault["loc"] for fault in faults]
    return [
        fault
        for fault in faults
        if not any(len(place) > len(fault["loc"]) and place[: len(fault["loc"])] == fault["loc"] for place in places)
    ]


def _describe_fault(model: type[BaseModel], fault: Any) -> tuple[str, str]:
    location = fault["loc"]
    key = _format_location(location)
    if fault["type"] == "extra_forbidden":
        return key, f"unknown key; {nearest_name(str(location[-1]), _fields_at(model, location[:-1]))}"
    if fault["type"] == "missing":
        return key, "missing, and it is required"
    message = str(fault["msg"]).removeprefix("Value error, ")
    if fault["type"] == "value_error":
        return key, message
    if fault["type"] in _CONTAINERS:
        return key, f"expected {_CONTAINERS[fault['type']]}, got {describe_value(fault['input'])}"
    return key, f"{message[0].lower()}{message[1:]}, got {describe_value(fault['input'])}"


def _format_location(location: tuple[int | str, ...]) -> str:
    parts = ""
    for item in location:
        if isinstance(item, int):
            parts += f"[{item + 1}]"
        elif not str(item)[:1].isupper() and "[" not in str(item):
            parts += f".{item}" if parts else str(item)
    return parts


def _fields_at(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    current: Any = model
    for item in location:
        if isinstance(item, int) or not hasattr(current, "model_fields"):
            continue
        if item in current.model_fields:
            current = _inner_model(current.model_fields[item].annotation)
    return list(current.model_fields) if hasattr(current, "model_fields") else []


def _inner_model(annotation: Any) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in get_args(annotation):
        found = _inner_model(argument)
        if found is not None:
            return found
    return None


def sha256_of_file(path: str | Path) -> str:
    """Returns the SHA-256 of a file's bytes as hex digits."""
    with open_file(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def sha256_of_json(content: Any) -> str:
    """Returns the SHA-256 of a value's canonical JSON form as hex digits."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
