"""OFF files in ASCII: vertices and polygons (Geomview's object file format).

Values may be wrapped over lines at will; only a face's colour ends with its line.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.mesh_files.polygons import triangulate
from tdcr_planner.collision.mesh_files.source import (
    MeshFormat,
    RawMesh,
    decode_text,
    parse_integer,
    parse_numbers,
    read_bytes,
)
from tdcr_planner.errors import FormatError

_HEADER = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF")
# Values of a vertex behind its position: normals, texture coordinates; a colour has three or four.
_NORMAL, _TEXTURE, _COLOUR = 3, 2, (3, 4)
_FACE_COLOURS = (0, 1, 3, 4)


class _Values:
    """The words of a file with the number of the line that each stands in."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.words: list[str] = []
        self.lines: list[int] = []
        self.place = 0
        for number, line in enumerate(text.splitlines(), 1):
            words = line.split("#", 1)[0].split()
            self.words += words
            self.lines += [number] * len(words)

    @property
    def where(self) -> str:
        """The line that is read, for messages."""
        return f"line {self.lines[min(self.place, len(self.lines) - 1)]}" if self.lines else ""

    def take(self, count: int, what: str) -> list[str]:
        """Returns the next words."""
        if count < 0 or count > len(self.words) - self.place:
            raise FormatError(self.path, f"ends inside {what}: cut off or damaged", self.where)
        found = self.words[self.place : self.place + count]
        self.place += count
        return found

    def left_in_line(self) -> int:
        """Returns how many words follow in the line of the last word that was taken."""
        line, end = self.lines[self.place - 1], self.place
        while end < len(self.words) and self.lines[end] == line:
            end += 1
        return end - self.place


def _read(path: Path) -> RawMesh:
    values = _Values(path, decode_text(path, read_bytes(path)))
    keyword = values.take(1, "the header")[0] if values.words else ""
    header = _HEADER.fullmatch(keyword)
    if header is None:
        raise FormatError(path, f"expected 'OFF' as its first word, got {keyword[:40]!r}: damaged or no OFF file")
    if header[4] or header[5] or values.words[1:2] == ["BINARY"]:
        raise FormatError(
            path, "is an OFF file of four or n dimensions or a binary one, which is not read; export it as ASCII OFF"
        )
    counts = [parse_integer(path, word, values.where) for word in values.take(3, "the header")]
    vertices, faces = counts[0], counts[1]
    if vertices < 0 or faces < 0 or 3 * vertices + 4 * faces > len(values.words):
        raise FormatError(path, f"declares {vertices} vertices and {faces} faces and holds fewer: cut off or damaged")
    extra = (_TEXTURE if header[1] else 0) + (_NORMAL if header[3] else 0)
    points = _vertices(values, vertices, [3 + extra + colour for colour in (_COLOUR if header[2] else (0,))])
    sizes, corners = _faces(values, faces)
    if values.place < len(values.words):
        left = len(values.words) - values.place
        raise FormatError(path, f"holds {left} values more than its header declares: damaged", values.where)
    return RawMesh(points, triangulate(path, points, sizes, corners))


def _vertices(values: _Values, count: int, widths: list[int]) -> FloatArray:
    """Returns the vertices; widths are the numbers of values that a vertex may have."""
    lines = values.lines[values.place :]
    width = next((width for width in widths if _one_a_line(lines, count, width)), widths[0])
    if len(widths) > 1 and not _one_a_line(lines, count, width):
        raise FormatError(values.path, f"expected a vertex of {widths} values in each line", values.where)
    place = values.where
    words = values.take(count * width, "the vertices")
    return parse_numbers(values.path, words, f"the vertices, from {place} on").reshape(count, width)[:, :3]


def _one_a_line(lines: list[int], count: int, width: int) -> bool:
    """Returns whether as many lines as vertices follow, each of that many values."""
    taken = np.array(lines[: count * width + 1])
    if len(taken) < count * width:
        return False
    rows = taken[: count * width].reshape(count, width)
    whole = bool((rows == rows[:, :1]).all()) and bool((np.diff(rows[:, 0]) > 0).all())
    return whole and (count == 0 or len(taken) == count * width or bool(taken[-1] != rows[-1, 0]))


def _faces(values: _Values, count: int) -> tuple[IntArray, IntArray]:
    """Returns the faces' sizes and corners: word by word or, if words are left, with colours at line ends."""
    begin = values.place
    coloured = False
    try:
        found = _walk(values, count, coloured)
    except FormatError:
        coloured = True
    if coloured or values.place < len(values.words):
        values.place = begin
        found = _walk(values, count, coloured=True)
    sizes, corners = found
    return np.array(sizes, dtype=np.int64), np.array(corners, dtype=np.int64)


def _walk(values: _Values, count: int, coloured: bool) -> tuple[list[int], list[int]]:
    sizes, corners = [], []
    for _ in range(count):
        size = parse_integer(values.path, values.take(1, "the faces")[0], values.where)
        corners += [parse_integer(values.path, word, values.where) for word in values.take(size, "a face")]
        sizes.append(size)
        if coloured:
            colour = values.left_in_line()
            if colour not in _FACE_COLOURS:
                raise FormatError(
                    values.path, f"expected a line's end or a colour behind a face, got {colour} values", values.where
                )
            parse_numbers(values.path, values.take(colour, "a colour"), values.where)
    return sizes, corners


OFF = MeshFormat("OFF", (".off",), _read)
