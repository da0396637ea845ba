"""The buffers and accessors of a glTF file: its bytes, wherever they lie, as checked arrays."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from pathlib import Path, PureWindowsPath
from typing import TypeVar
from urllib.parse import unquote, urlsplit

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.mesh_files.gltf_schema import Accessor, Document
from tdcr_planner.collision.mesh_files.source import MAX_BYTES, read_bytes
from tdcr_planner.errors import FormatError

# What vertices may be stored as: single precision, or whole numbers (KHR_mesh_quantization).
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_INDEX_COMPONENTS = (5121, 5123, 5125)
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
# The file's own extents are decimal text of single-precision numbers, which some programs round to six digits.
EXTENT_FRACTION = 1e-5

_Item = TypeVar("_Item")


def pick(path: Path, items: tuple[_Item, ...], index: int, what: str) -> _Item:
    """Returns an item of a list of the document, or raises FormatError where it has none of that number."""
    if index >= len(items):
        raise FormatError(path, f"names {what}[{index}], but there are {len(items)}", what)
    return items[index]


def buffer_file(path: Path, uri: str, place: str) -> Path:
    """Returns the file beside a glTF file that a buffer's address names; any other address is refused."""
    parts = urlsplit(uri)
    name = unquote(parts.path)
    windows = PureWindowsPath(name)
    unsafe = parts.scheme or parts.netloc or parts.query or parts.fragment or "\0" in name or "\\" in name
    if not name or unsafe or windows.drive or windows.root or ".." in windows.parts:
        raise FormatError(
            path,
            f"names {uri[:80]!r}; expected a file beside it: no URL, no absolute path and no '..'; put the file there, "
            "or export one .glb file",
            place,
        )
    file = path.parent / name
    try:
        inside = file.resolve().is_relative_to(path.parent.resolve())
    except (OSError, RuntimeError) as error:
        raise FormatError(path, f"names {uri[:80]!r}, which cannot be resolved: {error}", place) from error
    if not inside:
        raise FormatError(path, f"names {uri[:80]!r}, a link that leads out of its folder; put the file there", place)
    return file


class Buffers:
    """The arrays of a glTF document."""

    def __init__(self, path: Path, document: Document, binary: bytes | None) -> None:
        """Takes the document of a file and, for a GLB file, its binary chunk."""
        self._path = path
        self._document = document
        self._binary = binary
        self._read: dict[int, bytes] = {}
        total = sum(buffer.byteLength for buffer in document.buffers)
        if total > MAX_BYTES:
            raise FormatError(path, f"declares buffers of {total} bytes, at most {MAX_BYTES} are read", "buffers")

    def _buffer(self, index: int) -> bytes:
        if index not in self._read:
            self._read[index] = self._load(index)
        return self._read[index]

    def _load(self, index: int) -> bytes:
        buffer = pick(self._path, self._document.buffers, index, "buffers")
        place = f"buffers[{index}]"
        if buffer.uri is None:
            if index != 0 or self._binary is None:
                raise FormatError(self._path, "has no data: neither 'uri' nor the binary chunk of a GLB file", place)
            data = self._binary
        elif buffer.uri[:5].lower() == "data:":
            kind, comma, text = buffer.uri.partition(",")
            if not comma or not kind.lower().endswith(";base64"):
                raise FormatError(self._path, "expected data in base64", place)
            try:
                data = base64.b64decode(unquote(text), validate=True)
            except (binascii.Error, ValueError) as error:
                raise FormatError(self._path, f"is not valid base64: {error}", place) from error
        else:
            data = read_bytes(buffer_file(self._path, buffer.uri, place))
        if len(data) < buffer.byteLength:
            raise FormatError(
                self._path, f"declares {buffer.byteLength} bytes and holds {len(data)}: cut off or damaged", place
            )
        return data[: buffer.byteLength]

    def _array(self, view_index: int, offset: int, kind: str, count: int, width: int, place: str) -> np.ndarray:
        """Returns rows of a buffer view, shape (count, width)."""
        view = pick(self._path, self._document.bufferViews, view_index, "bufferViews")
        data = self._buffer(view.buffer)
        if view.byteOffset + view.byteLength > len(data):
            raise FormatError(
                self._path,
                f"takes bytes {view.byteOffset} to {view.byteOffset + view.byteLength} of a buffer of {len(data)}",
                f"bufferViews[{view_index}]",
            )
        if view.extensions:
            raise FormatError(self._path, _unread("extension", view.extensions), f"bufferViews[{view_index}]")
        item = np.dtype(kind).itemsize
        stride = view.byteStride or item * width
        if stride < item * width or offset + (count - 1) * stride + item * width > view.byteLength:
            raise FormatError(
                self._path,
                f"takes {count} elements of {item * width} bytes, every {stride} from byte {offset}, of a buffer view "
                f"of {view.byteLength} bytes",
                place,
            )
        return np.ndarray((count, width), kind, data, view.byteOffset + offset, (stride, item))

    def _elements(self, index: int, what: str, components: tuple[int, ...]) -> tuple[Accessor, np.ndarray]:
        """Returns an accessor and its elements as they are stored, sparse ones in their places, shape (n, width)."""
        accessor = pick(self._path, self._document.accessors, index, "accessors")
        place = f"accessors[{index}]"
        if accessor.componentType not in components or accessor.type not in _WIDTHS:
            raise FormatError(
                self._path,
                f"stores {what} as {accessor.type} of component type {accessor.componentType}; "
                f"valid component types: {', '.join(map(str, components))}",
                place,
            )
        if accessor.extensions:
            raise FormatError(self._path, _unread("extension", accessor.extensions), place)
        kind, width = _COMPONENTS[accessor.componentType], _WIDTHS[accessor.type]
        if accessor.bufferView is not None:
            values = self._array(accessor.bufferView, accessor.byteOffset, kind, accessor.count, width, place).copy()
        elif accessor.sparse is not None and accessor.count * width * np.dtype(kind).itemsize <= MAX_BYTES:
            values = np.zeros((accessor.count, width), kind)
        else:
            raise FormatError(
                self._path, f"stores {what} without data: compressed, or damaged; export it uncompressed", place
            )
        if accessor.sparse is not None:
            self._replace(accessor, values, place)
        return accessor, values

    def _replace(self, accessor: Accessor, values: np.ndarray, place: str) -> None:
        sparse = accessor.sparse
        assert sparse is not None  # the caller has looked
        where, new = sparse.indices, sparse.values
        if where.componentType not in _INDEX_COMPONENTS:
            raise FormatError(self._path, f"has sparse indices of component type {where.componentType}", place)
        kind = _COMPONENTS[where.componentType]
        rows = self._array(where.bufferView, where.byteOffset, kind, sparse.count, 1, place)[:, 0].astype(np.int64)
        if rows[-1] >= accessor.count or (np.diff(rows) <= 0).any():
            raise FormatError(self._path, f"expected sparse indices that rise and stay below {accessor.count}", place)
        values[rows] = self._array(
            new.bufferView, new.byteOffset, values.dtype.str, sparse.count, values.shape[1], place
        )

    def positions(self, index: int) -> FloatArray:
        """Returns the vertices of an accessor, shape (n, 3), checked against the extents that it declares."""
        accessor, stored = self._elements(index, "vertices", (5120, 5121, 5122, 5123, 5126))
        place = f"accessors[{index}]"
        if accessor.type != "VEC3":
            raise FormatError(self._path, f"expected vertices as VEC3, got {accessor.type}", place)
        values = stored.astype(np.float64)
        self._compare(values.min(axis=0), accessor.min, "min", values, place)
        self._compare(values.max(axis=0), accessor.max, "max", values, place)
        if accessor.normalized:
            if accessor.componentType == 5126:
                raise FormatError(self._path, "calls single-precision vertices normalized", place)
            values = np.maximum(values / np.iinfo(stored.dtype).max, -1.0)
        return values

    def _compare(
        self, found: FloatArray, declared: tuple[float, ...] | None, name: str, values: FloatArray, place: str
    ) -> None:
        if declared is None:
            return
        slack = EXTENT_FRACTION * float(np.abs(values).max())
        if len(declared) != 3 or not (np.abs(found - np.array(declared)) <= slack).all():
            raise FormatError(
                self._path,
                f"declares vertices with {name} {list(declared)} and holds {found.tolist()}: damaged",
                place,
            )

    def indices(self, index: int, vertices: int) -> IntArray:
        """Returns the vertex indices of an accessor, shape (n,), each below the number of vertices."""
        accessor, stored = self._elements(index, "indices", _INDEX_COMPONENTS)
        place = f"accessors[{index}]"
        if accessor.type != "SCALAR" or accessor.normalized:
            raise FormatError(self._path, f"expected indices as SCALAR, not normalized, got {accessor.type}", place)
        values = stored[:, 0].astype(np.int64)
        if values.max() >= vertices:
            raise FormatError(self._path, f"names vertex {values.max()}, but there are {vertices} vertices", place)
        extremes: tuple[tuple[str, tuple[float, ...] | None, Callable[[IntArray], np.int64]], ...] = (
            ("min", accessor.min, np.min),
            ("max", accessor.max, np.max),
        )
        for name, declared, extreme in extremes:
            if declared is not None and tuple(declared) != (float(extreme(values)),):
                raise FormatError(
                    self._path,
                    f"declares indices with {name} {list(declared)} and holds {extreme(values)}: damaged",
                    place,
                )
        return values


def _unread(what: str, names: dict[str, object]) -> str:
    return f"needs the {what} {', '.join(sorted(names))}, which is not decoded; export plain triangles without it"
