"""The schema of arrays: names, types, shapes, ranges and sizes, declared once and checked before memory is taken."""

from __future__ import annotations

import math
import tokenize
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tdcr_planner.archive import Archive, open_archive
from tdcr_planner.errors import FormatError, nearest_name

Array = NDArray[Any]
Sizes = dict[str, int]
Kind = Literal["float64", "float32", "integer", "boolean", "text"]

_TYPES: dict[str, tuple[str, ...]] = {
    "float64": ("<f8",),
    "float32": ("<f4",),
    "integer": ("<i4", "<i8"),
    "boolean": ("|b1",),
}
# NumPy's own headers take 128 bytes; its parser is asked for no more than it takes by default.
_LONGEST_HEADER = 10_000
_ENDING = ".npy"
_LAST_CHARACTER = 0x10FFFF
_SURROGATES = (0xD800, 0xDFFF)


@dataclass(frozen=True)
class ArraySpec:
    """What one array must be.

    Attributes:
        kind: Type of the entries; "integer" has 32 or 64 bits, "text" is one string.
        shape: Length of each axis: a number, or a name whose length is the same wherever it stands.
        low: Smallest entry, None for any.
        high: Largest entry, None for any.
        may_be_nan: Whether NaN stands for what is not known; infinity never may.
        required: Whether the array must be there.
    """

    kind: Kind
    shape: tuple[int | str, ...] = ()
    low: float | None = None
    high: float | None = None
    may_be_nan: bool = False
    required: bool = True


@dataclass(frozen=True)
class ArraySchema:
    """What the arrays of one kind of file must be.

    Attributes:
        kind: What the file is, for messages.
        arrays: The arrays by name; others are refused.
        most: Largest length of each named axis that the caller does not know.
        most_bytes: Largest size of all arrays together: what a laptop can hold twice.
    """

    kind: str
    arrays: Mapping[str, ArraySpec]
    most: Mapping[str, int]
    most_bytes: int = 2**32


def read_arrays(
    path: str | Path,
    schema: ArraySchema,
    sizes: Mapping[str, int] | None = None,
    content: bytes | None = None,
) -> tuple[dict[str, Array], Sizes]:
    """Returns the arrays of an NPZ file and the lengths of their named axes.

    Every header is checked against the schema before any array is allocated. Nothing in the file is executed: arrays of
    objects are refused by their type.

    Args:
        path: The file.
        schema: What it must hold.
        sizes: Lengths of named axes that are known already.
        content: The NPZ's bytes, where it is part of another file; None reads the file.

    Raises:
        FormatError: The file is missing, damaged or not what the schema says; names array, expected and found.
    """
    found: Sizes = dict(sizes or {})
    largest = sum(_most_bytes(spec, {**schema.most, **found}) for spec in schema.arrays.values())
    with open_archive(path, schema.kind, min(largest, schema.most_bytes), content) as archive:
        records = {name.removesuffix(_ENDING): name for name in archive.names}
        check_names(path, schema, [name for name, record in records.items() if record.endswith(_ENDING)])
        headers = {name: _read_header(archive, name) for name in schema.arrays if name in records}
        for name, header in headers.items():
            _check_type(path, name, header.dtype, schema.arrays[name])
            _check_shape(path, name, header.shape, schema, found)
        arrays = {name: _read_array(archive, name, header) for name, header in headers.items()}
    for name, array in arrays.items():
        check_values(path, name, array, schema.arrays[name])
    return arrays, found


def check_arrays(
    path: str | Path, schema: ArraySchema, arrays: Mapping[str, Array], sizes: Mapping[str, int] | None = None
) -> Sizes:
    """Checks arrays that are in memory against a schema; returns the lengths of their named axes.

    Args:
        path: The file that they come from.
        schema: What they must be.
        arrays: The arrays by name.
        sizes: Lengths of named axes that are known already.

    Raises:
        FormatError: As `read_arrays`.
    """
    found: Sizes = dict(sizes or {})
    check_names(path, schema, list(arrays))
    for name, array in arrays.items():
        spec = schema.arrays[name]
        _check_type(path, name, array.dtype, spec)
        _check_shape(path, name, array.shape, schema, found)
        check_values(path, name, array, spec)
    return found


def check_names(path: str | Path, schema: ArraySchema, names: Sequence[str]) -> None:
    """Raises FormatError where a required array is missing or one is not in the schema."""
    for name in names:
        if name not in schema.arrays:
            raise FormatError(path, f"no array of a {schema.kind}; {nearest_name(name, schema.arrays)}", name)
    for name, spec in schema.arrays.items():
        if spec.required and name not in names:
            raise FormatError(path, f"is damaged or no {schema.kind}: the array is missing", name)


def check_values(path: str | Path, name: str, array: Array, spec: ArraySpec) -> None:
    """Raises FormatError where an entry is not finite or out of range; names its index."""
    if spec.kind == "text":
        # NumPy does not look at what it makes a string of.
        codes = array.reshape(1).view("<u4")
        if ((codes > _LAST_CHARACTER) | ((codes >= _SURROGATES[0]) & (codes <= _SURROGATES[1]))).any():
            raise FormatError(path, "is damaged: its text has codes that are no characters", name)
    if spec.kind in ("text", "boolean"):
        return
    wrong = ~np.isfinite(array)
    expected = "finite numbers"
    if spec.may_be_nan:
        wrong &= ~np.isnan(array)
        expected = "finite numbers or NaN"
    if not wrong.any():
        # NaN compares as false: what is not known is in every range.
        for limit, beyond, word in ((spec.low, np.less, "at least"), (spec.high, np.greater, "at most")):
            if limit is not None and not wrong.any():
                wrong, expected = beyond(array, limit), f"numbers of {word} {limit:g}"
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise FormatError(path, f"expected {expected}, got {array[index]} at index {index}", name)


@dataclass(frozen=True)
class _Header:
    """What an NPY record says of its array before its numbers."""

    shape: tuple[int, ...]
    column_major: bool
    dtype: np.dtype[Any]
    length: int


def _read_header(archive: Archive, name: str) -> _Header:
    with archive.open(name + _ENDING) as stream, _header_faults_named(archive.path, name):
        version = npy.read_magic(stream)
        if version == (1, 0):
            shape, column_major, dtype = npy.read_array_header_1_0(stream, max_header_size=_LONGEST_HEADER)
        elif version == (2, 0):
            shape, column_major, dtype = npy.read_array_header_2_0(stream, max_header_size=_LONGEST_HEADER)
        else:
            raise FormatError(archive.path, f"expected NPY version 1 or 2, got {version}", name)
        return _Header(shape, column_major, dtype, stream.tell())


@contextmanager
def _header_faults_named(path: Path, name: str) -> Iterator[None]:
    """Turns what NumPy's parser raises, and what it warns of in headers of other programs, into a FormatError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    except (SyntaxError, tokenize.TokenError, TypeError, MemoryError, Warning) as error:
        raise FormatError(path, f"is damaged: its header cannot be read ({type(error).__name__})", name) from error


def _check_type(path: str | Path, name: str, dtype: np.dtype[Any], spec: ArraySpec) -> None:
    text = dtype.str.startswith("<U") and dtype.itemsize > 0
    fits = text if spec.kind == "text" else dtype.str in _TYPES[spec.kind]
    if not fits:
        raise FormatError(path, f"expected an array of type {spec.kind}, got {dtype}", name)


def _check_shape(path: str | Path, name: str, shape: tuple[int, ...], schema: ArraySchema, found: Sizes) -> None:
    spec = schema.arrays[name]
    known = tuple(found.get(axis, axis) if isinstance(axis, str) else axis for axis in spec.shape)
    fits = len(shape) == len(known)
    for axis, length in zip(known, shape, strict=False):
        fits &= 0 <= length <= schema.most[axis] if isinstance(axis, str) else axis == length
    if not fits:
        free = [f"{axis} at most {schema.most[axis]:,}" for axis in known if isinstance(axis, str)]
        bounds = f" ({', '.join(free)})" if free else ""
        words = ", ".join(str(axis) for axis in known)
        raise FormatError(path, f"expected shape ({words}){bounds}, got {shape}", name)
    found.update({axis: length for axis, length in zip(spec.shape, shape, strict=True) if isinstance(axis, str)})


def _read_array(archive: Archive, name: str, header: _Header) -> Array:
    record = name + _ENDING
    expected = math.prod(header.shape) * header.dtype.itemsize
    held = archive.size(record) - header.length
    if held != expected:
        raise FormatError(archive.path, f"is damaged: expected {expected:,} bytes of numbers, got {held:,}", name)
    content = bytearray(archive.read(record)[header.length :])
    order: Literal["C", "F"] = "F" if header.column_major else "C"
    return np.ndarray(header.shape, header.dtype, buffer=content, order=order)


def _most_bytes(spec: ArraySpec, sizes: Mapping[str, int]) -> int:
    """Returns the bytes that an array may take at most, header included."""
    if spec.kind == "text":
        return _LONGEST_HEADER + 4 * sizes["text"]
    entry = {"boolean": 1, "float32": 4}.get(spec.kind, 8)
    return _LONGEST_HEADER + entry * math.prod(sizes[axis] if isinstance(axis, str) else axis for axis in spec.shape)
