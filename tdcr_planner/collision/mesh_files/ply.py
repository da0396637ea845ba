"""PLY files, ASCII and binary in both byte orders: vertices, polygons and triangle strips.

The header declares every element; what follows must be exactly that, to the last byte.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.mesh_files.polygons import strip_faces, triangulate
from tdcr_planner.collision.mesh_files.source import (
    MeshFormat,
    RawMesh,
    as_indices,
    check_range,
    check_triangle_count,
    decode_text,
    parse_integer,
    parse_numbers,
    read_bytes,
)
from tdcr_planner.errors import FormatError

MAX_HEADER = 1 << 20

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_NO_GEOMETRY = frozenset(["material", "camera", "viewpoint"])
_INDEX_NAMES = ("vertex_indices", "vertex_index")
_END = re.compile(rb"^end_header[ \t]*(\r\n|\n|\r)", re.MULTILINE)


@dataclass(frozen=True)
class _Property:
    """A property: its type, and for a list that of its length."""

    name: str
    kind: str
    length_kind: str | None = None


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def smallest_row(self) -> int:
        """Bytes that a binary row takes at least."""
        return sum(np.dtype(item.length_kind or item.kind).itemsize for item in self.properties)


# Values of a scalar property, shape (n,); of a list, its lengths, shape (n,), and its values, one row after the other.
_Column = FloatArray | tuple[IntArray, FloatArray]


class _Body(Protocol):
    """What follows a header: rows of elements, then nothing."""

    def rows(self, element: _Element) -> dict[str, _Column]:
        """Returns the next element's columns by name."""

    def finish(self) -> None:
        """Raises FormatError where something is left."""


def _read(path: Path) -> RawMesh:
    data = read_bytes(path)
    order, elements, begin = _read_header(path, data)
    body: _Body = _Words(path, decode_text(path, data[begin:])) if order == "" else _Bytes(path, data, begin, order)
    vertices: FloatArray | None = None
    faces: list[dict[str, _Column]] = []
    for element in elements:
        if element.count and element.name not in ("vertex", "face", "tristrips") and element.name not in _NO_GEOMETRY:
            raise FormatError(
                path,
                f"holds an element {element.name!r} that is not read (vertex, face and tristrips are); "
                "delete it or export triangles",
                "header",
            )
        columns = body.rows(element)
        if element.name == "vertex":
            vertices = _positions(path, columns)
        elif element.name in ("face", "tristrips") and element.count:
            faces.append({element.name: _indices(path, element, columns)})
    body.finish()
    if vertices is None:
        raise FormatError(path, "has no element 'vertex'", "header")
    return RawMesh(vertices, _triangles(path, vertices, faces))


def read_ply_points(path: Path) -> FloatArray:
    """Returns the positions of a PLY file's element 'vertex', shape (n, 3); what else it holds is passed over.

    Raises:
        FormatError: The file is damaged or cut off, or has no vertices.
    """
    data = read_bytes(path)
    order, elements, begin = _read_header(path, data)
    body: _Body = _Words(path, decode_text(path, data[begin:])) if order == "" else _Bytes(path, data, begin, order)
    found = [_positions(path, body.rows(element)) for element in elements if element.name == "vertex"]
    if not found:
        raise FormatError(path, "has no element 'vertex'", "header")
    return found[0]


def _read_header(path: Path, data: bytes) -> tuple[str, list[_Element], int]:
    """Returns the byte order ("" for ASCII), the elements, and where their rows begin."""
    end = _END.search(data, 0, MAX_HEADER)
    if not re.match(rb"ply[ \t]*[\r\n]", data) or end is None:
        raise FormatError(path, "has no PLY header from 'ply' to 'end_header': cut off, damaged or no PLY file")
    begin = end.end()
    if end.group(1) == b"\r" and b"\r\n" in data[: end.start()]:
        raise FormatError(path, "ends its lines in two ways: damaged", "header")
    order: str | None = None
    elements: list[_Element] = []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, "1.0"] if name in _ORDERS and order is None:
                order = _ORDERS[name]
            case ["element", name, count] if all(name != element.name for element in elements):
                elements.append(_Element(name, parse_integer(path, count, "header")))
            case ["property", "list", length, kind, name] if elements and length in _TYPES and kind in _TYPES:
                _add(path, elements[-1], _Property(name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name] if elements and kind in _TYPES:
                _add(path, elements[-1], _Property(name, _TYPES[kind]))
            case _:
                raise FormatError(path, f"line {line[:60]!r} is not understood", "header")
    if order is None:
        raise FormatError(path, f"expected a line 'format' with one of {', '.join(_ORDERS)} and 1.0", "header")
    if any(element.count < 0 for element in elements):
        raise FormatError(path, "expected a count of 0 or more", "header")
    return order, elements, begin


def _add(path: Path, element: _Element, item: _Property) -> None:
    if any(item.name == other.name for other in element.properties):
        raise FormatError(path, f"names property {item.name!r} of element {element.name!r} twice", "header")
    element.properties.append(item)


def _cut(path: Path, element: _Element) -> FormatError:
    return FormatError(
        path, f"ends before the {element.count} rows of element {element.name!r} that its header declares: cut off"
    )


class _Words:
    """The rows of an ASCII file."""

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self._words = text.split()
        self._place = 0

    def rows(self, element: _Element) -> dict[str, _Column]:
        if element.count * len(element.properties) > len(self._words) - self._place:
            raise _cut(self._path, element)
        taken: dict[str, list[str]] = {item.name: [] for item in element.properties}
        lengths: dict[str, list[int]] = {item.name: [] for item in element.properties if item.length_kind}
        if not lengths:
            size = element.count * len(element.properties)
            words = self._words[self._place : self._place + size]
            self._place += size
            taken = {item.name: words[k :: len(element.properties)] for k, item in enumerate(element.properties)}
        else:
            for _ in range(element.count):
                for item in element.properties:
                    size = 1
                    if item.length_kind is not None:
                        size = self._length(element)
                        lengths[item.name].append(size)
                    taken[item.name] += self._next(size, element)
        columns: dict[str, _Column] = {}
        for name, words in taken.items():
            values = parse_numbers(self._path, words, f"element {element.name!r}, property {name!r}")
            columns[name] = (np.array(lengths[name], dtype=np.int64), values) if name in lengths else values
        return columns

    def _length(self, element: _Element) -> int:
        return parse_integer(self._path, self._next(1, element)[0], f"a list's length in element {element.name!r}")

    def _next(self, size: int, element: _Element) -> list[str]:
        words = self._words[self._place : self._place + size]
        if size < 0 or len(words) < size:
            raise _cut(self._path, element)
        self._place += size
        return words

    def finish(self) -> None:
        left = len(self._words) - self._place
        if left:
            raise FormatError(self._path, f"holds {left} values more than its header declares: damaged")


class _Bytes:
    """The rows of a binary file."""

    def __init__(self, path: Path, data: bytes, begin: int, order: str) -> None:
        self._path = path
        self._data = data
        self._place = begin
        self._order = order

    def rows(self, element: _Element) -> dict[str, _Column]:
        if element.count * element.smallest_row > len(self._data) - self._place:
            raise _cut(self._path, element)
        equal = self._equal_rows(element)
        return self._row_by_row(element) if equal is None else equal

    def _equal_rows(self, element: _Element) -> dict[str, _Column] | None:
        """Returns the columns where every row has lists as long as the first one's, or None."""
        place = self._place
        fields: list[tuple[str, np.dtype, tuple[int, ...]]] = []
        for index, item in enumerate(element.properties):
            kind, size = np.dtype(self._order + item.kind), 1
            if item.length_kind is not None:
                length_kind = np.dtype(self._order + item.length_kind)
                if element.count and place + length_kind.itemsize > len(self._data):
                    return None
                size = int(np.frombuffer(self._data, length_kind, 1, place)[0]) if element.count else 0
                fields.append((f"length{index}", length_kind, ()))
                place += length_kind.itemsize
                if not 0 <= size <= len(self._data):
                    return None
                fields.append((f"values{index}", kind, (size,)))
            else:
                fields.append((f"values{index}", kind, ()))
            place += size * kind.itemsize
            if place > len(self._data):
                return None
        record = np.dtype(fields)
        end = self._place + element.count * record.itemsize
        if end > len(self._data) or not element.properties:
            return None
        table = np.frombuffer(self._data, record, element.count, self._place)
        columns: dict[str, _Column] = {}
        for index, item in enumerate(element.properties):
            values = table[f"values{index}"].astype(np.float64)
            if item.length_kind is None:
                columns[item.name] = values
                continue
            lengths = table[f"length{index}"].astype(np.int64)
            if (lengths != values.shape[1]).any():
                return None
            columns[item.name] = (lengths, values.reshape(-1))
        self._place = end
        return columns

    def _row_by_row(self, element: _Element) -> dict[str, _Column]:
        kinds = [np.dtype(self._order + item.kind) for item in element.properties]
        length_kinds = [np.dtype(self._order + (item.length_kind or "i1")) for item in element.properties]
        pieces: list[list[FloatArray]] = [[] for _ in kinds]
        lengths: list[list[int]] = [[] for _ in kinds]
        for _ in range(element.count):
            for index, item in enumerate(element.properties):
                size = 1
                if item.length_kind is not None:
                    size = int(self._next(length_kinds[index], 1, element)[0])
                    lengths[index].append(size)
                pieces[index].append(self._next(kinds[index], size, element))
        columns: dict[str, _Column] = {}
        for index, item in enumerate(element.properties):
            values = np.concatenate([np.empty(0), *pieces[index]]).astype(np.float64)
            listed = item.length_kind is not None
            columns[item.name] = (np.array(lengths[index], dtype=np.int64), values) if listed else values
        return columns

    def _next(self, kind: np.dtype, size: int, element: _Element) -> FloatArray:
        end = self._place + size * kind.itemsize
        if size < 0 or end > len(self._data):
            raise _cut(self._path, element)
        values = np.frombuffer(self._data, kind, size, self._place)
        self._place = end
        return values

    def finish(self) -> None:
        left = len(self._data) - self._place
        if left and self._data[self._place :].strip():
            raise FormatError(self._path, f"holds {left} bytes more than its header declares: damaged")


def _positions(path: Path, columns: dict[str, _Column]) -> FloatArray:
    axes = [columns.get(name) for name in ("x", "y", "z")]
    found = [axis for axis in axes if isinstance(axis, np.ndarray)]
    if len(found) < 3:
        raise FormatError(path, "expected properties x, y and z of element 'vertex'", "header")
    return np.stack(found, axis=1)


def _indices(path: Path, element: _Element, columns: dict[str, _Column]) -> _Column:
    named = [name for name in _INDEX_NAMES if name in columns]
    lists = columns[named[0]] if len(named) == 1 else None
    if not isinstance(lists, tuple):
        raise FormatError(path, f"expected one list {' or '.join(_INDEX_NAMES)} of element {element.name!r}", "header")
    return lists


def _triangles(path: Path, vertices: FloatArray, faces: list[dict[str, _Column]]) -> IntArray:
    found = [np.empty((0, 3), dtype=np.int64)]
    for item in faces:
        for name, column in item.items():
            assert isinstance(column, tuple)  # `_indices` returns lists
            lengths, values = column
            if name == "face":
                found.append(triangulate(path, vertices, lengths, as_indices(path, values, "a face")))
            else:
                found += _strips(path, len(vertices), lengths, values)
    return np.concatenate(found)


def _strips(path: Path, vertices: int, lengths: IntArray, values: FloatArray) -> list[IntArray]:
    """Returns the triangles of strips; an index of -1 begins another strip."""
    check_triangle_count(path, len(values))
    found = []
    for row in np.split(values, np.cumsum(lengths)[:-1]):
        for strip in np.split(row, np.flatnonzero(row == -1.0)):
            indices = as_indices(path, strip[1:] if len(strip) and strip[0] == -1.0 else strip, "a triangle strip")
            check_range(path, indices, vertices, "a triangle strip")
            if 0 < len(indices) < 3:
                raise FormatError(path, f"expected three or more vertices, got {len(indices)}", "a triangle strip")
            if len(indices):
                found.append(strip_faces(indices))
    return found


PLY = MeshFormat("PLY", (".ply",), _read)
