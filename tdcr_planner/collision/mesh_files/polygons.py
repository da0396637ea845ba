"""Triangles from polygons, strips and fans."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.mesh_files.source import check_range, check_triangle_count
from tdcr_planner.errors import FormatError

logger = logging.getLogger(__name__)

# Clipping ears takes quadratic time: this many corners take about a second.
MAX_CORNERS = 4000
# A polygon may leave its plane by this fraction of its size before a warning says that its diagonals were chosen here.
FLAT_FRACTION = 1e-2
# Doubles round a polygon's area at about 1e-16 of its squared size, a corner more or less.
AREA_ROUNDING = 1e-12


def triangulate(path: Path, vertices: FloatArray, counts: IntArray, corners: IntArray) -> IntArray:
    """Returns the triangles of polygons, in the polygons' order, shape (f, 3).

    Every corner is kept, those on a straight side too, so that neighbouring polygons stay joined.

    Args:
        path: The file, for messages.
        vertices: Shape (v, 3).
        counts: Number of corners of each polygon, shape (p,).
        corners: Vertex indices, polygon by polygon, shape (sum of counts,).

    Raises:
        FormatError: A vertex is not finite; a polygon has fewer than three corners, names a missing vertex or crosses
            itself.
    """
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise FormatError(path, f"is not finite: {vertices[bad[0]].tolist()}", f"vertex {bad[0]}")
    few = np.flatnonzero(counts < 3)
    if len(few):
        raise FormatError(
            path,
            f"expected three or more corners, got {counts[few[0]]}: points and lines have no surface; delete them",
            f"face {few[0] + 1}",
        )
    check_triangle_count(path, int(counts.sum()) - 2 * len(counts))
    start = np.cumsum(counts) - counts
    outside = np.flatnonzero((corners < 0) | (corners >= len(vertices)))
    if len(outside):
        face = int(np.searchsorted(start, outside[0], side="right"))
        check_range(path, corners[outside[:1]], len(vertices), f"face {face}")
    triangles, owners = [np.empty((0, 3), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    bent = 0.0
    for size in np.unique(counts).tolist():
        which = np.flatnonzero(counts == size)
        rings = corners[start[which, None] + np.arange(size)]
        local, leaves = _split(path, vertices, rings, which)
        bent = max(bent, leaves)
        triangles.append(np.take_along_axis(rings, local.reshape(len(which), -1), axis=1).reshape(-1, 3))
        owners.append(np.repeat(which, size - 2))
    if bent > FLAT_FRACTION:
        logger.warning(
            "%s: holds polygons that leave their plane by up to %.0f %% of their size; the file does not say along "
            "which diagonals they fold, so export triangles to be sure of the surface",
            path, 100.0 * bent,
        )  # fmt: skip
    order = np.argsort(np.concatenate(owners), kind="stable")
    return np.concatenate(triangles)[order]


def _split(path: Path, vertices: FloatArray, rings: IntArray, faces: IntArray) -> tuple[IntArray, float]:
    """Returns the triangles of polygons of one size as places in the polygon, and how far they leave their planes.

    Args:
        path: The file, for messages.
        vertices: Shape (v, 3).
        rings: Shape (g, n).
        faces: The polygons' numbers, for messages, shape (g,).

    Returns:
        Shape (g, n - 2, 3), and the largest distance of a corner from the polygon's plane as a fraction of its size.
    """
    size = rings.shape[1]
    fan = np.stack([np.zeros(size - 2, dtype=np.int64), np.arange(1, size - 1), np.arange(2, size)], axis=1)
    local = np.broadcast_to(fan, (len(rings), size - 2, 3)).copy()
    if size == 3:
        return local, 0.0
    points = vertices[rings] - vertices[rings[:, :1]]
    crosses = np.cross(points[:, 1:-1], points[:, 2:])
    area = crosses.sum(axis=1)
    length = np.linalg.norm(area, axis=1)
    extent = np.linalg.norm(points, axis=2).max(axis=1)
    normal = area / np.where(length > 0.0, length, 1.0)[:, None]
    leaves = np.abs(np.einsum("gni,gi->gn", points, normal)).max(axis=1) / np.where(extent > 0.0, extent, 1.0)
    whole = _fans(points, crosses, normal, extent)
    for index in np.flatnonzero(~whole).tolist():
        found = None
        if size <= MAX_CORNERS and length[index] > AREA_ROUNDING * extent[index] ** 2:
            found = _clip_ears(_flatten(points[index], normal[index]))
        if found is None:
            raise FormatError(
                path,
                f"a polygon of {size} corners crosses itself or has more than {MAX_CORNERS} corners; export triangles",
                f"face {faces[index] + 1}",
            )
        local[index] = found
    return local, float(leaves.max(initial=0.0))


def _fans(points: FloatArray, crosses: FloatArray, normal: FloatArray, extent: FloatArray) -> BoolArray:
    """Returns which polygons the fan from their first corner fills without overlap, shape (g,).

    It does so when all its triangles turn the same way and by less than a full turn together.
    """
    signed = np.einsum("gni,gi->gn", crosses, normal)
    dots = np.einsum("gni,gni->gn", points[:, 1:-1], points[:, 2:])
    slack = AREA_ROUNDING * extent**2
    same_way = (signed >= -slack[:, None]).all(axis=1)
    # What turns the other way within the normal's plane must be flat in space, too.
    filled = np.linalg.norm(crosses, axis=2).sum(axis=1) <= 2.0 * signed.sum(axis=1) + slack
    turn = np.arctan2(np.maximum(signed, 0.0), dots).sum(axis=1)
    return np.asarray(same_way & filled & (turn < 2.0 * np.pi))


def _flatten(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Returns points, shape (n, 3), in axes of their plane so that they go round counter-clockwise, shape (n, 2)."""
    axis = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    axis /= np.linalg.norm(axis) or 1.0
    return np.stack([points @ axis, points @ np.cross(normal, axis)], axis=1)


def _cross(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def _clip_ears(points: FloatArray) -> IntArray | None:
    """Returns triangles that fill a polygon, shape (n - 2, 3), or None where it crosses itself (Meisters 1975).

    Corners of zero area, on straight sides, are clipped last, so no ear spans one of them.

    Args:
        points: The corners, counter-clockwise, shape (n, 2).
    """
    slack = AREA_ROUNDING * float(np.abs(points).max(initial=0.0)) ** 2
    total = float(_cross(points, np.roll(points, -1, axis=0)).sum())
    ring = np.arange(len(points))
    triangles: list[IntArray] = []
    while len(ring) > 3:
        before, after = points[np.roll(ring, 1)], points[np.roll(ring, -1)]
        here = points[ring]
        area = _cross(here - before, after - before)
        order = np.concatenate([np.flatnonzero(area > slack), np.flatnonzero(np.abs(area) <= slack)])
        place = next((k for k in order.tolist() if area[k] <= slack or _is_ear(points, ring, k)), None)
        if place is None:
            return None
        triangles.append(ring[[place - 1, place, (place + 1) % len(ring)]])
        ring = np.delete(ring, place)
    triangles.append(ring)
    found = np.stack(triangles)
    a, b, c = points[found[:, 0]], points[found[:, 1]], points[found[:, 2]]
    filled = float(np.abs(_cross(b - a, c - a)).sum())
    return found if abs(filled - total) <= 1e-9 * abs(total) + len(points) * slack else None


def _is_ear(points: FloatArray, ring: IntArray, place: int) -> bool:
    """Returns whether no other corner lies in or on the triangle that a corner makes with its neighbours."""
    own = [ring[place - 1], ring[place], ring[(place + 1) % len(ring)]]
    a, b, c = points[own]
    others = points[ring[~np.isin(ring, own)]]
    apart = ~((others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1))
    within = (
        (_cross(b - a, others - a) >= 0.0) & (_cross(c - b, others - b) >= 0.0) & (_cross(a - c, others - c) >= 0.0)
    )
    return not bool((within & apart).any())


def strip_faces(indices: IntArray) -> IntArray:
    """Returns the triangles of a strip, all turned alike, shape (n - 2, 3)."""
    faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    faces[1::2] = faces[1::2][:, [1, 0, 2]]
    return faces


def fan_faces(indices: IntArray) -> IntArray:
    """Returns the triangles of a fan about its first vertex, shape (n - 2, 3)."""
    return np.stack([np.broadcast_to(indices[0], len(indices) - 2), indices[1:-1], indices[2:]], axis=1)
