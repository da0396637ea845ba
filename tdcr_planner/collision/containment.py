"""Which side of a mesh the body is on, for bodies that touch none of its surface."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.body import place_solid, towards_rim
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.tree import TriangleTree, winding_number
from tdcr_planner.compiled import njit


class Side(NamedTuple):
    """What decides the right side of a mesh, for compiled code.

    Attributes:
        tree: The closed surface.
        bounded: Whether there is an inside at all.
        keep_inside: True for a cavity.
        has_entry: Whether points behind a plane are exempt.
        entry_point: Shape (3,), m.
        entry_normal: Shape (3,), unit, pointing into the cavity.
    """

    tree: TriangleTree
    bounded: bool
    keep_inside: bool
    has_entry: bool
    entry_point: FloatArray
    entry_normal: FloatArray


def make_side(mesh: SceneMesh) -> Side:
    """Returns what decides the right side of a mesh."""
    entry = mesh.entry
    return Side(
        tree=mesh.closed_tree if mesh.bounded else mesh.wall_tree,
        bounded=mesh.bounded,
        keep_inside=mesh.keeps_inside,
        has_entry=entry is not None,
        entry_point=np.zeros(3) if entry is None else entry.point,
        entry_normal=np.zeros(3) if entry is None else entry.normal,
    )


@njit(cache=True, nogil=True)
def entry_depth(side, x, y, z):  # type: ignore[no-untyped-def]
    """Returns how far a point lies in front of the entry plane, m; infinity without one."""
    if not side.has_entry:
        return np.inf
    p, n = side.entry_point, side.entry_normal
    return (x - p[0]) * n[0] + (y - p[1]) * n[1] + (z - p[2]) * n[2]


@njit(cache=True, nogil=True)
def is_wrong(side, x, y, z):  # type: ignore[no-untyped-def]
    """Returns whether a point is where the body must not be: in an obstacle, or outside a cavity before its entry."""
    if not side.bounded:
        return False
    if side.keep_inside:
        return entry_depth(side, x, y, z) > 0.0 and winding_number(side.tree, x, y, z) == 0.0
    return winding_number(side.tree, x, y, z) != 0.0


@njit(cache=True, nogil=True)
def deepest_point(body, index, centre, axis, half, normal, point):  # type: ignore[no-untyped-def]
    """Writes the point of a solid that lies farthest along a unit normal."""
    along = axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2]
    shift = math.copysign(half, along)
    radius = body.radius[index]
    if body.round_ends[index]:
        for a in range(3):
            point[a] = centre[a] + shift * axis[a] + radius * normal[a]
        return
    rim = towards_rim(axis, normal[0], normal[1], normal[2], along)
    for a in range(3):
        point[a] = centre[a] + shift * axis[a] + radius * rim[a]


@njit(cache=True, nogil=True)
def wrong_part(side, body, positions, rotations):  # type: ignore[no-untyped-def]
    """Returns the first part (tip first) on the wrong side of a mesh that no part touches, or -1.

    A part that touches no surface lies wholly on one side, and parts that share a point lie on the same one. So one
    point decides for a whole obstacle, and for a cavity one for each run of parts that is connected in front of the
    entry plane: what a convex part has in front of the plane is convex too, hence in one piece.
    """
    if not side.bounded:
        return -1
    parts = len(body.part_first) - 1
    last = len(positions) - 1
    if not side.keep_inside:
        return 0 if is_wrong(side, positions[last, 0], positions[last, 1], positions[last, 2]) else -1
    centre, axis, point = np.empty(3), np.empty(3), np.empty(3)
    # Whether the disk centre that this part shares with the one before is in front of the plane and known to be inside.
    joined = False
    for part in range(parts):
        disk_known = joined
        for index in range(body.part_first[part], body.part_first[part + 1]):
            half = place_solid(body, index, positions, rotations, centre, axis)
            if half < 0.0:
                continue
            kind, k = body.kind[index], body.station[index]
            if kind == 2:
                if disk_known and _hole_in_front(side, body, index, positions, rotations):
                    continue
            elif joined:
                if kind == 1 or kind == 3:
                    p = positions[k - 1]
                    joined = entry_depth(side, p[0], p[1], p[2]) > 0.0
                continue
            if side.has_entry:
                deepest_point(body, index, centre, axis, half, side.entry_normal, point)
            else:
                for a in range(3):
                    point[a] = centre[a]
            if is_wrong(side, point[0], point[1], point[2]):
                return part
            if kind != 2:
                p = positions[k - 1] if (kind == 1 or kind == 3) else positions[k]
                joined = entry_depth(side, p[0], p[1], p[2]) > 0.0
    return -1


@njit(cache=True, nogil=True)
def _hole_in_front(side, body, index, positions, rotations):  # type: ignore[no-untyped-def]
    """Returns whether the point where a tendon passes its gap's outer disk lies in front of the entry plane."""
    k = body.station[index]
    hole = np.empty(3)
    for a in range(3):
        hole[a] = positions[k, a]
        for b in range(2):
            hole[a] += rotations[k, a, b] * body.offset[index, b]
    return entry_depth(side, hole[0], hole[1], hole[2]) > 0.0
