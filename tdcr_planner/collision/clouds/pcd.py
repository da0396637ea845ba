"""PCD files (Point Cloud Library, version 0.7), ASCII and binary."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.mesh_files.source import read_bytes
from tdcr_planner.errors import FormatError

_MOST_HEADER = 65536
_KINDS = {"F": "f", "I": "i", "U": "u"}


def read_pcd(path: Path) -> FloatArray:
    """Returns the points of a PCD file, shape (n, 3), in its unit of length.

    Raises:
        FormatError: The file is damaged, cut off or compressed, or has no fields x, y and z.
    """
    data = read_bytes(path)
    header, begin = _read_header(path, data)
    names = header.get("FIELDS", [])
    if not {"x", "y", "z"} <= set(names):
        raise FormatError(path, f"expected the fields x, y and z, got {' '.join(names) or 'none'}", "FIELDS")
    counts = _integers(path, header, "COUNT", len(names)) if "COUNT" in header else [1] * len(names)
    points = _integers(path, header, "POINTS", 1)[0]
    kind = " ".join(header.get("DATA", []))
    if kind == "ascii":
        return _read_ascii(path, data[begin:], names, counts, points)
    if kind == "binary":
        return _read_binary(path, data[begin:], header, names, counts, points)
    raise FormatError(path, f"expected ascii or binary data, got {kind!r}; convert it with pcl_convert_pcd", "DATA")


def _read_header(path: Path, data: bytes) -> tuple[dict[str, list[str]], int]:
    """Returns the words of each line of the header, and where the points begin."""
    header: dict[str, list[str]] = {}
    begin = 0
    while "DATA" not in header:
        end = data.find(b"\n", begin, begin + _MOST_HEADER)
        if end < 0:
            raise FormatError(path, "has no PCD header from VERSION to DATA: cut off, damaged or no PCD file")
        words = data[begin:end].decode("latin-1").split()
        begin = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    return header, begin


def _integers(path: Path, header: dict[str, list[str]], key: str, count: int) -> list[int]:
    words = header.get(key, [])
    if len(words) != count or not all(word.isdigit() and len(word) < 10 for word in words):
        raise FormatError(path, f"expected {count} whole numbers, got {' '.join(words)[:40] or 'none'!r}", key)
    return [int(word) for word in words]


def _read_ascii(path: Path, data: bytes, names: list[str], counts: list[int], points: int) -> FloatArray:
    lines = [line.split() for line in data.decode("latin-1").splitlines() if line.strip()]
    if len(lines) != points:
        raise FormatError(path, f"declares {points} points and holds {len(lines)}: cut off or damaged")
    starts = np.concatenate([[0], np.cumsum(counts)])
    columns = [int(starts[names.index(axis)]) for axis in "xyz"]
    rows = []
    for number, words in enumerate(lines, 1):
        if len(words) != starts[-1]:
            raise FormatError(path, f"expected {starts[-1]} numbers, got {len(words)}", f"point {number}")
        try:
            rows.append([float(words[column]) for column in columns])
        except ValueError as error:
            raise FormatError(path, f"expected numbers, got {' '.join(words)[:40]!r}", f"point {number}") from error
    return np.array(rows).reshape(-1, 3)


def _read_binary(
    path: Path, data: bytes, header: dict[str, list[str]], names: list[str], counts: list[int], points: int
) -> FloatArray:
    sizes = _integers(path, header, "SIZE", len(names))
    kinds = header.get("TYPE", [])
    if len(kinds) != len(names) or not set(kinds) <= set(_KINDS):
        raise FormatError(path, f"expected {len(names)} types of F, I and U, got {' '.join(kinds)[:40]!r}", "TYPE")
    try:
        # Fields may share a name ("_" pads), so each is told by its place.
        row = np.dtype(
            [
                (str(index), f"<{_KINDS[kind]}{size}", (count,))
                for index, (kind, size, count) in enumerate(zip(kinds, sizes, counts, strict=True))
            ]
        )
    except TypeError as error:
        raise FormatError(path, f"has fields that no number has: {error}", "SIZE") from error
    if len(data) != points * row.itemsize:
        raise FormatError(
            path, f"declares {points * row.itemsize} bytes of points and holds {len(data)}: cut off or damaged"
        )
    table = np.frombuffer(data, dtype=row, count=points)
    return np.stack([table[str(names.index(axis))][:, 0].astype(np.float64) for axis in "xyz"], axis=1)
