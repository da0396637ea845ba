"""A point cloud as an obstacle: a small triangle at each point, off which the body stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.clouds.formats import read_cloud
from tdcr_planner.collision.meshes import LARGEST, METRES_PER_UNIT, SceneMesh
from tdcr_planner.errors import FormatError, UnknownNameError

TRIANGLE_IN_RADII = 1e-3
"""Circumradius of the triangle at a point; it counts in the distance that is kept."""

_CORNERS = np.array([[1.0, 0.0, 0.0], [-0.5, 0.75**0.5, 0.0], [-0.5, -(0.75**0.5), 0.0]])


def load_cloud(path: Path, unit: str, point_radius: float, name: str | None = None) -> SceneMesh:
    """Returns the obstacle that a point cloud makes.

    The distance to it is that to the nearest point, less at most `cloud_error(point_radius)` - point_radius.

    Args:
        path: The file.
        unit: Its unit of length: m, cm, mm or in.
        point_radius: Distance that is kept from each point, m; it decides only the size of the triangles.
        name: What to call it in messages; the file's name where it is None.

    Raises:
        FormatError: The file cannot be read, holds no point, or one that is not finite or beyond 1e9 m.
    """
    points = read_points(path, unit)
    vertices, faces = _triangles(points, TRIANGLE_IN_RADII * point_radius)
    return SceneMesh(name or path.name, vertices, faces, "obstacle", bounded=False, source=path, unit=unit)


def read_points(path: Path, unit: str) -> FloatArray:
    """Returns the points of a cloud, shape (n, 3), m, without those that stand twice in it."""
    if unit not in METRES_PER_UNIT:
        raise UnknownNameError("unit", str(unit), METRES_PER_UNIT, " for the cloud's unit of length")
    points = METRES_PER_UNIT[unit] * read_cloud(path)
    if np.abs(points).max() > LARGEST:
        far = int(np.abs(points).max(axis=1).argmax())
        raise FormatError(
            path, f"expected coordinates of up to {LARGEST:g} m, got {points[far].tolist()}", f"point {far + 1}"
        )
    return np.unique(points, axis=0)


def cloud_error(point_radius: float) -> float:
    """Returns what is added to the clearance so that each point keeps its radius free, m."""
    return point_radius * (1.0 + TRIANGLE_IN_RADII)


def _triangles(points: FloatArray, radius: float) -> tuple[FloatArray, IntArray]:
    vertices = (points[:, None] + radius * _CORNERS).reshape(-1, 3)
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)
