"""STL files, binary and ASCII.

A binary file states its number of triangles, which must be what its size holds. An ASCII file is read by its grammar:
solids of facets of three vertices, each solid ended by its `endsolid`, and nothing else.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tdcr_planner.collision.mesh_files.source import (
    MeshFormat,
    RawMesh,
    check_triangle_count,
    decode_text,
    line_of,
    parse_numbers,
    read_bytes,
)
from tdcr_planner.errors import FormatError

_HEADER = 84
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

_SPACE = re.compile(r"\s*")
_SOLID = re.compile(r"solid(?![^\s])[^\r\n]*", re.IGNORECASE)
_END = re.compile(r"end\s?solid(?![^\s])[^\r\n]*", re.IGNORECASE)
_VERTEX = r"\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)"
_FACET = re.compile(
    rf"facet\s+normal\s+\S+\s+\S+\s+\S+\s+outer\s+loop{_VERTEX * 3}\s+end\s?loop\s+end\s?facet(?!\S)", re.IGNORECASE
)
# A facet in the line of a solid's name would be taken for a part of the name.
_HIDDEN = re.compile(r"\b(facet\s+normal|vertex\s)", re.IGNORECASE)


def _read(path: Path) -> RawMesh:
    data = read_bytes(path)
    if len(data) >= _HEADER and len(data) == _HEADER + _RECORD.itemsize * _declared(data):
        check_triangle_count(path, _declared(data))
        corners = np.frombuffer(data, dtype=_RECORD, offset=_HEADER)["corners"]
        return _from_corners(corners.reshape(-1, 3).astype(np.float64))
    if not _is_text(data):
        if len(data) < _HEADER:
            raise FormatError(path, f"is cut off: a binary STL file has {_HEADER} bytes or more, this has {len(data)}")
        expected = _HEADER + _RECORD.itemsize * _declared(data)
        raise FormatError(
            path,
            f"declares {_declared(data)} triangles, which take {expected} bytes, but holds {len(data)}: cut off, "
            "damaged or no STL file; export it again",
        )
    return _from_corners(_read_text(path, decode_text(path, data)))


def _declared(data: bytes) -> int:
    return int.from_bytes(data[_HEADER - 4 : _HEADER], "little")


def _is_text(data: bytes) -> bool:
    begin = data[:256].lstrip(b"\xef\xbb\xbf\xff\xfe\0 \t\r\n").replace(b"\0", b"")
    return begin[:5].lower() == b"solid"


def _from_corners(corners: np.ndarray) -> RawMesh:
    return RawMesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3))


def _read_text(path: Path, text: str) -> np.ndarray:
    """Returns the facets' corners, shape (3 f, 3)."""
    words: list[str] = []
    position, open_solid = _skip(text, 0), False
    while position < len(text):
        facet = _FACET.match(text, position) if open_solid else None
        if facet is not None:
            words.extend(facet.groups())
            position = _skip(text, facet.end())
            continue
        mark = (_END if open_solid else _SOLID).match(text, position)
        if mark is None or _HIDDEN.search(mark.group()):
            expected = "a facet of three vertices or 'endsolid'" if open_solid else "'solid'"
            got = text[position : position + 40].split("\n")[0].strip()
            raise FormatError(path, f"expected {expected}, got {got!r}: damaged or cut off", line_of(text, position))
        open_solid = not open_solid
        position = _skip(text, mark.end())
    if open_solid:
        raise FormatError(path, "ends inside a solid, without its 'endsolid': cut off; export it again")
    check_triangle_count(path, len(words) // 9)
    return parse_numbers(path, words, "a vertex").reshape(-1, 3)


def _skip(text: str, position: int) -> int:
    found = _SPACE.match(text, position)
    return position if found is None else found.end()


STL = MeshFormat("STL", (".stl",), _read)
