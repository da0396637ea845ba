"""The point cloud formats that are read: PLY, PCD, XYZ, LAS, LAZ and E57."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.clouds.pcd import read_pcd
from tdcr_planner.collision.mesh_files.ply import read_ply_points
from tdcr_planner.collision.mesh_files.source import decode_text, read_bytes
from tdcr_planner.errors import FormatError, MissingLibraryError
from tdcr_planner.inputs import check_file

MOST_POINTS = 5_000_000
"""Of a cloud: its tree takes about 1 kB a point."""


@dataclass(frozen=True)
class CloudFormat:
    """A point cloud format: its name, the endings of its files' names, and what returns the points, shape (n, 3)."""

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path], FloatArray]


def read_cloud(path: Path) -> FloatArray:
    """Returns the points of a cloud, shape (n, 3), in the file's unit of length.

    Raises:
        FormatError: There is no such file, it is damaged, it holds no point, too many, or one that is not finite.
    """
    check_file(path)
    for candidate in FORMATS:
        if path.suffix.lower() in candidate.suffixes:
            points = np.ascontiguousarray(candidate.read(path), dtype=np.float64)
            break
    else:
        valid = ", ".join(suffix for candidate in FORMATS for suffix in candidate.suffixes)
        raise FormatError(path, f"cannot be read as a point cloud: unknown ending {path.suffix!r}; valid: {valid}")
    if not len(points):
        raise FormatError(path, "holds no points")
    if len(points) > MOST_POINTS:
        raise FormatError(path, f"holds {len(points)} points, at most {MOST_POINTS} are read; thin it out")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise FormatError(
            path, f"{len(bad)} points are not finite (the first: {points[bad[0]].tolist()}); delete them",
            f"point {bad[0] + 1}",
        )  # fmt: skip
    return points


def _read_xyz(path: Path) -> FloatArray:
    """Returns the first three numbers of each line; lines that begin with # or // and a line of names are passed."""
    rows: list[list[float]] = []
    for number, line in enumerate(decode_text(path, read_bytes(path)).splitlines(), 1):
        text = line.strip()
        if not text or text.startswith(("#", "//")):
            continue
        words = text.replace(",", " ").replace(";", " ").split()
        try:
            values = [float(word) for word in words[:3]]
        except ValueError as error:
            if not rows and number <= 2:  # a line of column names, or the number of points
                continue
            raise FormatError(path, f"expected three numbers, got {text[:40]!r}", f"line {number}") from error
        if len(values) < 3:
            if not rows and len(words) == 1:
                continue
            raise FormatError(path, f"expected three numbers, got {text[:40]!r}", f"line {number}")
        rows.append(values)
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _read_las(path: Path) -> FloatArray:
    try:
        import laspy
    except ImportError as error:
        raise _missing("laspy", path) from error
    try:
        content: Any = laspy.read(path)
        return np.asarray(content.xyz, dtype=np.float64)
    except Exception as error:  # laspy raises what numpy and its decompressor raise
        raise FormatError(path, f"cannot be read as LAS: {error}") from error


def _read_e57(path: Path) -> FloatArray:
    try:
        import pye57
    except ImportError as error:
        raise _missing("pye57", path) from error
    try:
        file: Any = pye57.E57(str(path))
        scans = [file.read_scan(index, ignore_missing_fields=True) for index in range(file.scan_count)]
        points = [np.stack([scan[f"cartesian{axis}"] for axis in "XYZ"], axis=1) for scan in scans]
        return np.concatenate(points) if points else np.empty((0, 3))
    except Exception as error:  # pye57 raises what its C++ library raises
        raise FormatError(path, f"cannot be read as E57: {error}") from error


def _missing(library: str, path: Path) -> MissingLibraryError:
    return MissingLibraryError(library, f"to read {path}", "all systems (pip install 'tdcr-planner[clouds]')")


FORMATS = (
    CloudFormat("PLY", (".ply",), read_ply_points),
    CloudFormat("PCD", (".pcd",), read_pcd),
    CloudFormat("XYZ", (".xyz", ".txt", ".pts", ".asc", ".csv"), _read_xyz),
    CloudFormat("LAS", (".las", ".laz"), _read_las),
    CloudFormat("E57", (".e57",), _read_e57),
)
