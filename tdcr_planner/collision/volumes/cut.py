"""Cutting a surface open by a plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.errors import FormatError

_ON_PLANE = 1e-9
"""Vertices this near to a plane, in fractions of the surface's size, lie on it: no sliver is left beside it."""


def cut_surface(
    path: Path, vertices: FloatArray, faces: IntArray, point: FloatArray, normal: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Returns the part of a surface in front of a plane, with an open, straight rim where the plane cuts it.

    Args:
        path: The file of the surface, for messages.
        vertices: Shape (v, 3), m.
        faces: Shape (f, 3).
        point: A point of the plane, shape (3,), m.
        normal: Direction to the side that stays, shape (3,), any length above 0.

    Raises:
        FormatError: The plane leaves nothing of the surface.
    """
    depths = (vertices - point) @ (normal / np.linalg.norm(normal))
    depths[np.abs(depths) < _ON_PLANE * np.ptp(vertices, axis=0).max()] = 0.0
    front = depths > 0.0
    if not front.any():
        raise FormatError(path, "the whole surface lies behind the plane; its normal must point to what stays", "cut")
    sides = np.sign(depths)[faces]
    whole = (sides >= 0).all(axis=1) & (sides > 0).any(axis=1)
    cut = (sides > 0).any(axis=1) & (sides < 0).any(axis=1)
    points = [vertices]
    pieces = [faces[whole]]
    made: dict[tuple[int, int], int] = {}
    count = len(vertices)

    def crossing(inner: int, outer: int) -> int:
        """Returns the vertex where an edge passes the plane; both triangles at the edge get the same one."""
        nonlocal count
        key = (min(inner, outer), max(inner, outer))
        if key not in made:
            low, high = key
            fraction = depths[low] / (depths[low] - depths[high])
            points.append((vertices[low] + fraction * (vertices[high] - vertices[low]))[None])
            made[key] = count
            count += 1
        return made[key]

    for face in faces[cut].tolist():
        corners: list[int] = []
        for here, there in zip(face, face[1:] + face[:1], strict=True):
            if depths[here] >= 0.0:
                corners.append(here)
            if depths[here] * depths[there] < 0.0:
                corners.append(crossing(here, there))
        pieces.append(np.array([[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]))
    return np.concatenate(points), np.concatenate(pieces).astype(np.int64)
