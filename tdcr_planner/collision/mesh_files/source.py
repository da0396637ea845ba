"""What the readers of all mesh formats share: a file's bytes and text, numbers in text, and what a format is."""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tdcr_planner import inputs
from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.errors import FormatError

# Bounds on what is held in memory at once: a mesh of this many triangles takes about 10 GB with its tree.
MAX_BYTES = 2 * 1024**3
MAX_TRIANGLES = 20_000_000

_MARKS = (  # the longer marks first: that of UTF-16 begins that of UTF-32
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_INTEGER = re.compile(r"[-+]?[0-9]{1,18}")


class RawMesh(NamedTuple):
    """The triangles of a file, in the file's unit of length, as they stand in it.

    Attributes:
        vertices: Shape (v, 3).
        faces: Shape (f, 3), vertex indices, each within the vertices.
        unit: The unit of length that the file declares, in the words of its format; None where it declares none.
    """

    vertices: FloatArray
    faces: IntArray
    unit: str | None = None


@dataclass(frozen=True)
class MeshFormat:
    """A mesh format.

    Attributes:
        name: What to call it in messages.
        suffixes: Endings of its files' names, in lower case, each with its dot.
        read: Returns the triangles of a file; raises FormatError for all that it does not understand.
        parts: Returns the files that a file's geometry lies in, itself first.
        surface_error: Largest distance of the triangles from the surface that they stand for, m; 0 where the file
            holds triangles.
        in_metres: Whether the file states its unit, and the triangles are in metres.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path], RawMesh]
    parts: Callable[[Path], tuple[Path, ...]] = lambda path: (path,)
    surface_error: float = 0.0
    in_metres: bool = False


def check_file(path: Path) -> None:
    """Raises FormatError unless a path names a regular file of bounded size."""
    inputs.check_file(path)
    _check_size(path, path.stat().st_size)


def read_bytes(path: Path) -> bytes:
    """Returns the content of a regular file of bounded size, or raises FormatError."""
    with inputs.open_file(path) as stream:
        _check_size(path, os.fstat(stream.fileno()).st_size)
        return stream.read()


def _check_size(path: Path, size: int) -> None:
    if size > MAX_BYTES:
        raise FormatError(path, f"holds {size} bytes, at most {MAX_BYTES} are read; reduce the mesh")


def decode_text(path: Path, data: bytes) -> str:
    """Returns a file's text: UTF-8, UTF-16 or UTF-32 by its byte order mark, else UTF-8 or one byte a character."""
    try:
        for mark, encoding in _MARKS:
            if data.startswith(mark):
                return data[len(mark) :].decode(encoding)
    except UnicodeDecodeError as error:
        raise FormatError(path, f"begins as {encoding} text and does not go on so: cut off or damaged") from error
    if b"\0" in data:
        raise FormatError(
            path, "expected text, got binary data (or UTF-16 without a byte order mark); save it as UTF-8"
        )
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")  # names and comments alone hold other characters


def line_of(text: str, position: int) -> str:
    """Returns "line 7" for a position in a text."""
    return f"line {text.count(chr(10), 0, position) + 1}"


def parse_numbers(path: Path, tokens: Sequence[str], place: str) -> FloatArray:
    """Returns words as numbers, shape (n,), or raises FormatError naming the first that is none."""
    try:
        if any("_" in token for token in tokens):  # which Python takes for a separator of digits
            raise ValueError
        return np.array(tokens, dtype=np.float64)
    except ValueError as error:
        raise FormatError(path, f"expected a number, got {_first_wrong(tokens)!r}", place) from error


def _first_wrong(tokens: Sequence[str]) -> str:
    for token in tokens:
        try:
            if "_" in token:
                return token
            float(token)
        except ValueError:
            return token
    return ""


def parse_integer(path: Path, token: str, place: str) -> int:
    """Returns a word as an integer, or raises FormatError."""
    if not _INTEGER.fullmatch(token):
        raise FormatError(path, f"expected an integer, got {token[:40]!r}", place)
    return int(token)


def as_indices(path: Path, values: FloatArray | IntArray, place: str) -> IntArray:
    """Returns numbers as vertex indices, or raises FormatError where one is no integer of 0 or more."""
    wrong = np.flatnonzero(~((values >= 0) & (values < 2**53) & (values == np.floor(values))))
    if len(wrong):
        raise FormatError(path, f"expected vertex indices, got {values[wrong[0]]:g}", place)
    return values.astype(np.int64)


def check_range(path: Path, indices: IntArray, vertices: int, place: str) -> None:
    """Raises FormatError where an index names no vertex."""
    if indices.size and (indices.min() < 0 or indices.max() >= vertices):
        wrong = indices.max() if indices.max() >= vertices else indices.min()
        raise FormatError(path, f"names vertex {wrong}, but there are {vertices} vertices, counted from 0", place)


def check_triangle_count(path: Path, triangles: int) -> None:
    """Raises FormatError where a file makes more triangles than are held in memory."""
    if triangles > MAX_TRIANGLES:
        raise FormatError(path, f"makes {triangles} triangles, at most {MAX_TRIANGLES} are read; reduce the mesh")
