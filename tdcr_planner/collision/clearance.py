"""The clearance of a body from one mesh, compiled: the exact distance where it is free, else an estimated depth."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tdcr_planner.collision.body import across, place_solid
from tdcr_planner.collision.containment import is_wrong, wrong_part
from tdcr_planner.collision.distance import solid_distance
from tdcr_planner.collision.tree import nearest_triangle

# What a touch without a measurable depth counts as, m: below zero, and far below any tolerance of a robot.
GRAZE = 1e-9
RING = 16


@njit(cache=True, nogil=True)
def body_clearance(wall, side, body, positions, rotations, bound):  # type: ignore[no-untyped-def]
    """Returns the clearance of one state's body from one mesh where it is below `bound`, otherwise `bound`, m.

    Args:
        wall: Tree of the triangles that the body must not touch.
        side: `Side` of the mesh.
        body: `BodyArrays`, with the margins that are to count.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).
        bound: What is known to be reached anyway, m.
    """
    total = len(body.kind)
    centre, axis = np.empty(3), np.empty(3)
    best = bound
    # Disks first: they are the widest solids, so the bound that they leave spares most of the others their search.
    for disks in range(2):
        for index in range(total):
            if (body.kind[index] == 0) != (disks == 0) or best <= 0.0:
                continue
            half = place_solid(body, index, positions, rotations, centre, axis)
            if half >= 0.0:
                best = solid_distance(wall, body.round_ends[index], centre, axis, half, body.radius[index], best)
    if best > 0.0 and wrong_part(side, body, positions, rotations) < 0:
        return best
    depth = GRAZE
    for index in range(total):
        half = place_solid(body, index, positions, rotations, centre, axis)
        if half >= 0.0:
            depth = max(depth, _solid_depth(wall, side, body, index, centre, axis, half, depth))
    return min(bound, -depth)


@njit(cache=True, nogil=True)
def _solid_depth(wall, side, body, index, centre, axis, half, known):  # type: ignore[no-untyped-def]
    """Returns the depth of one solid if it is above `known`: the largest over balls inscribed in it."""
    radius = body.radius[index]
    reach = half + radius if body.round_ends[index] else math.sqrt(half * half + radius * radius)
    if _ball_depth(wall, side, centre[0], centre[1], centre[2], reach) <= known:
        return known
    depth = known
    if body.round_ends[index] or half > radius:
        core = half if body.round_ends[index] else half - radius
        for k in range(5):
            shift = core * (0.5 * k - 1.0)
            depth = max(
                depth,
                _ball_depth(
                    wall, side, centre[0] + shift * axis[0], centre[1] + shift * axis[1],
                    centre[2] + shift * axis[2], radius,
                ),
            )  # fmt: skip
        return depth
    depth = max(depth, _ball_depth(wall, side, centre[0], centre[1], centre[2], half))
    first, second = across(axis)
    for k in range(RING):
        angle = 2.0 * math.pi * k / RING
        cosine, sine = math.cos(angle), math.sin(angle)
        rx = cosine * first[0] + sine * second[0]
        ry = cosine * first[1] + sine * second[1]
        rz = cosine * first[2] + sine * second[2]
        r = radius - half
        ball = _ball_depth(wall, side, centre[0] + r * rx, centre[1] + r * ry, centre[2] + r * rz, half)
        depth = max(depth, ball)
        for face in range(2):
            z = (2 * face - 1) * half
            px = centre[0] + radius * rx + z * axis[0]
            py = centre[1] + radius * ry + z * axis[1]
            pz = centre[2] + radius * rz + z * axis[2]
            depth = max(depth, _ball_depth(wall, side, px, py, pz, 0.0))
    return depth


@njit(cache=True, nogil=True)
def _ball_depth(wall, side, x, y, z, radius):  # type: ignore[no-untyped-def]
    """Returns how far a ball must move at least to be free of a mesh, m; below 0 when it is."""
    distance = math.sqrt(nearest_triangle(wall, x, y, z, np.inf)[0])
    return radius + distance if is_wrong(side, x, y, z) else radius - distance


@njit(cache=True, nogil=True)
def clearances(wall, side, body, positions, rotations, best):  # type: ignore[no-untyped-def]
    """Lowers `best`, shape (n,), m, to the clearance of each state from one mesh; see `body_clearance`."""
    for row in range(len(positions)):
        best[row] = body_clearance(wall, side, body, positions[row], rotations[row], best[row])
