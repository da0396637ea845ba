"""The clearance of a body from one mesh, compiled: the exact distance where it is free, else an estimated depth."""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.body import across, part_ball, place_solid
from tdcr_planner.collision.containment import is_wrong, wrong_part
from tdcr_planner.collision.distance import solid_distance, triangle_distance
from tdcr_planner.collision.field import bounds_at
from tdcr_planner.collision.tree import nearest_triangle
from tdcr_planner.compiled import njit

# What a touch without a measurable depth counts as, m: below zero, and far below any tolerance of a robot.
GRAZE = 1e-9
RING = 16


@njit(cache=True, nogil=True)
def body_clearance(field, wall, side, body, positions, rotations, bound):  # type: ignore[no-untyped-def]
    """Returns the clearance of one state's body from one mesh where it is below `bound`, otherwise `bound`, m.

    Args:
        field: The mesh's `Field`; a coarse one only makes the search longer.
        wall: Tree of the triangles that the body must not touch.
        side: `Side` of the mesh.
        body: `BodyArrays`, with the margins that are to count.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).
        bound: What is known to be reached anyway, m.
    """
    best = _free_distance(field, wall, body, positions, rotations, bound)
    if best > 0.0 and wrong_part(side, body, positions, rotations) < 0:
        return best
    centre, axis = np.empty(3), np.empty(3)
    depth = GRAZE
    for index in range(len(body.kind)):
        half = place_solid(body, index, positions, rotations, centre, axis)
        if half >= 0.0:
            depth = max(depth, _solid_depth(wall, side, body, index, centre, axis, half, depth))
    return min(bound, -depth)


@njit(cache=True, nogil=True)
def _free_distance(field, wall, body, positions, rotations, bound):  # type: ignore[no-untyped-def]
    """Returns the distance of one state's body from the walls where below `bound`, otherwise `bound`; 0 if they meet.

    A part is no nearer than the ball about it. Parts are taken in the order of that lower bound, first from the field,
    then from the exact distance of the ball's middle, so few solids are measured themselves.
    """
    parts = len(body.part_first) - 1
    centre, axis = np.empty(3), np.empty(3)
    reach, least, most = np.empty(parts), np.empty(parts), np.empty(parts)
    best = bound
    for part in range(parts):
        reach[part] = part_ball(body, part, positions, rotations, centre)
        least[part], most[part] = -np.inf, np.inf
        if reach[part] >= 0.0:
            lower, upper, _ = bounds_at(field, centre[0], centre[1], centre[2], np.inf)
            least[part], most[part] = lower - reach[part], upper
            # The ball's middle belongs to the part, so the part is no farther than it.
            best = min(best, upper)
    measured = False
    for part in np.argsort(least):
        if least[part] >= best:
            break
        first = body.part_first[part]
        # Where the field says that the middle's distance rules nothing out, it is asked for a first bound alone.
        if reach[part] >= 0.0 and not (measured and most[part] - reach[part] < best):
            part_ball(body, part, positions, rotations, centre)
            bound = min(most[part], best + reach[part]) * (1.0 + 1e-12)
            square, found = nearest_triangle(wall, centre[0], centre[1], centre[2], bound)
            if math.sqrt(square) - reach[part] >= best:
                continue
            if found >= 0:
                # The triangle nearest to the middle is near the solid too: a good bound to start the search with.
                half = place_solid(body, first, positions, rotations, centre, axis)
                radius, round_ends = body.radius[first], body.round_ends[first]
                best = min(best, triangle_distance(wall.corners[found], round_ends, centre, axis, half, radius))
        for index in range(first, body.part_first[part + 1]):
            half = place_solid(body, index, positions, rotations, centre, axis)
            if half >= 0.0:
                best = solid_distance(wall, body.round_ends[index], centre, axis, half, body.radius[index], best)
        measured = True
    return best


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
def clearances(field, wall, side, body, positions, rotations, best):  # type: ignore[no-untyped-def]
    """Lowers `best`, shape (n,), m, to the clearance of each state from one mesh; see `body_clearance`."""
    for row in range(len(positions)):
        best[row] = body_clearance(field, wall, side, body, positions[row], rotations[row], best[row])
