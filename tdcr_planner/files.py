"""Reading TOML and JSON against a schema, hashing files, and writing outputs whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema

from tdcr_planner.errors import FormatError, nearest_name
from tdcr_planner.json_text import parse_json
from tdcr_planner.strict_numbers import describe_value, with_strict_numbers


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


def read_text(path: str | Path) -> str:
    """Returns a file's text, or raises FormatError saying why it cannot be read."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise FormatError(path, "no such file") from error
    except IsADirectoryError as error:
        raise FormatError(path, "is a folder, expected a file") from error
    except UnicodeDecodeError as error:
        raise FormatError(path, "is not a text file") from error
    except OSError as error:
        raise FormatError(path, f"cannot be read: {error.strerror}") from error


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
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise FormatError(path, f"cannot be read: {error.strerror}") from error


def sha256_of_json(content: Any) -> str:
    """Returns the SHA-256 of a value's canonical JSON form as hex digits."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


@contextmanager
def write_file_whole(path: str | Path) -> Iterator[Path]:
    """Yields a temporary path beside the target; on success it replaces the target, on error nothing changes.

    Raises:
        FormatError: The folder cannot be made or written, or the disk is full.
    """
    target = Path(path)
    staging = _make_staging(target.parent)
    try:
        with _full_disk_named(target):
            temporary = staging / target.name
            yield temporary
            os.replace(temporary, target)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


@contextmanager
def write_folder_whole(folder: str | Path, last: str = "result.json") -> Iterator[Path]:
    """Yields an empty staging folder whose files are moved into the target folder together on success.

    On an exception (Ctrl-C included) the target stays as it was. Every file is moved complete; the one named `last`
    comes last, so that whoever finds it finds the others too.

    Args:
        folder: The target folder, made when it is missing.
        last: Name of the file that says the set is complete.

    Raises:
        FormatError: The folder cannot be made or written, or the disk is full.
    """
    target = Path(folder)
    staging = _make_staging(target)
    try:
        with _full_disk_named(target):
            yield staging
            names = sorted((item.name for item in staging.iterdir()), key=lambda name: (name == last, name))
            for name in names:
                os.replace(staging / name, target / name)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def check_folder(folder: str | Path) -> None:
    """Raises FormatError unless a folder can be written or made: what is computed for it would be lost.

    Nothing is made or changed.
    """
    target = Path(folder).absolute()
    nearest = next(place for place in (target, *target.parents) if place.exists())
    if not nearest.is_dir():
        raise FormatError(folder, f"cannot be written: {nearest} is no folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise FormatError(folder, f"cannot be written: no permission in {nearest}")


def _make_staging(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=".tdcr-writing-", dir=folder))
    except OSError as error:
        raise FormatError(folder, f"cannot be written: {error.strerror}") from error


@contextmanager
def _full_disk_named(target: Path) -> Iterator[None]:
    """Turns what only a disk without room raises into an error that names the target."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise FormatError(target, f"cannot be written: {error.strerror}") from error
        raise
