"""Wavefront OBJ files: vertices and polygons; curves, lines and points are refused.

Material libraries are not opened: they hold no geometry.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tdcr_planner.collision.mesh_files.polygons import triangulate
from tdcr_planner.collision.mesh_files.source import MeshFormat, RawMesh, decode_text, parse_numbers, read_bytes
from tdcr_planner.errors import FormatError

# Keywords that change no geometry: names, groups, shading, materials.
_IGNORED = frozenset({
    "vn", "vt", "g", "o", "s", "mg", "usemtl", "mtllib", "usemap", "maplib", "bevel", "c_interp", "d_interp", "lod",
    "shadow_obj", "trace_obj", "ctech", "stech",
})  # fmt: skip
_LINES = {"l": "a line", "p": "points"}
_FREE_FORM = frozenset({
    "vp", "cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim", "hole", "scrv", "sp", "end", "con",
    "bzp", "bsp", "cdc", "cdp", "res",
})  # fmt: skip
_OTHER_FILES = frozenset(["call", "csh"])
_CORNER = re.compile(r"([-+]?[0-9]{1,18})(?:/[-+]?[0-9]*){0,2}")


def _read(path: Path) -> RawMesh:
    words: list[str] = []
    counts: list[int] = []
    corners: list[int] = []
    for number, keyword, values in _statements(decode_text(path, read_bytes(path))):
        if keyword == "v":
            words += _position(path, values, number)
        elif keyword in ("f", "fo"):
            counts.append(len(values))
            corners += _corners(path, values, len(words) // 3, number)
        elif keyword not in _IGNORED:
            raise FormatError(path, _refusal(keyword), f"line {number}")
    vertices = parse_numbers(path, words, "a vertex").reshape(-1, 3)
    faces = triangulate(path, vertices, np.array(counts, dtype=np.int64), np.array(corners, dtype=np.int64))
    return RawMesh(vertices, faces)


def _statements(text: str) -> Iterator[tuple[int, str, list[str]]]:
    """Yields each statement's line, keyword and values; a backslash at a line's end continues it."""
    held: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        content = line.split("#", 1)[0].rstrip()
        if content.endswith("\\"):
            held += content[:-1].split()
            continue
        words = held + content.split()
        held = []
        if words:
            yield number, words[0], words[1:]
    if held:
        yield number, held[0], held[1:]


def _position(path: Path, values: list[str], number: int) -> list[str]:
    """Returns the three coordinates of a vertex; a weight of 1 and a colour may follow them."""
    if len(values) == 4:
        weight = parse_numbers(path, values[3:], f"line {number}")
        if weight[0] != 1.0:
            raise FormatError(path, f"has a vertex of weight {values[3]}; export it without weights", f"line {number}")
    elif len(values) not in (3, 6, 7):
        raise FormatError(path, f"expected three coordinates of a vertex, got {len(values)} values", f"line {number}")
    return values[:3]


def _corners(path: Path, values: list[str], vertices: int, number: int) -> list[int]:
    """Returns a polygon's vertex indices, from 0; negative ones count back from the vertices read so far."""
    found = []
    for value in values:
        corner = _CORNER.fullmatch(value)
        index = 0 if corner is None else int(corner[1])
        if index == 0 or index < -vertices:
            expected = f"a vertex from 1, or from -{vertices} to -1 back from this line" if vertices else "vertices"
            raise FormatError(path, f"expected {expected}, got {value[:40]!r}", f"line {number}")
        found.append(index - 1 if index > 0 else vertices + index)
    return found


def _refusal(keyword: str) -> str:
    if keyword in _LINES:
        return f"holds {_LINES[keyword]} ({keyword!r}), which have no surface; delete them or export triangles"
    if keyword in _FREE_FORM:
        return f"holds a free-form curve or surface ({keyword!r}), which is not read; export triangles"
    if keyword in _OTHER_FILES:
        return f"runs or includes another file ({keyword!r}), which is not done; export one file of triangles"
    return f"unknown keyword {keyword[:40]!r}: damaged or no OBJ file"


OBJ = MeshFormat("OBJ", (".obj",), _read)
