"""Reading TOML and JSON against a schema, and hashing files; opening and writing them is in `inputs` and `outputs`."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema

from tdcr_planner.errors import FormatError, nearest_name
from tdcr_planner.inputs import check_file, check_name, find_named_file, open_file, read_bytes, read_text, real_path
from tdcr_planner.json_text import parse_json
from tdcr_planner.outputs import check_file_target, check_folder, is_private, write_file_whole, write_folder_whole
from tdcr_planner.strict_numbers import describe_value, with_strict_numbers

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


class FileModel(BaseModel):
    """Base of every table read from a file: unknown keys are errors, values cannot change.

    Numbers are finite and at most LARGEST_NUMBER in size. A number is a number: neither true or false nor text.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Returns pydantic's schema, with its numbers as strict as this class says."""
        schema: CoreSchema = with_strict_numbers(handler(source))
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
        fields = _fields_by_key(current)
        if item in fields:
            current = _inner_model(fields[item].annotation)
    return list(_fields_by_key(current)) if hasattr(current, "model_fields") else []


def _fields_by_key(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


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
