"""Swept parts: whether the hull of a part's places in two states keeps a distance from the walls.

What pushes through a hole moves along its own axis, so that all it passes is hardly wider than itself, however far it
goes. One cylinder about both places then proves a motion that is many times longer than the room beside the body.
"""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.body import towards_rim
from tdcr_planner.collision.containment import is_wrong
from tdcr_planner.collision.distance import cylinder_triangle_distance, node_bound, triangle_bound
from tdcr_planner.collision.field import bounds_at, front
from tdcr_planner.collision.tree import STACK_SIZE
from tdcr_planner.compiled import njit

TURNS = 4  # of the power iteration that finds the direction along which four points spread most


@njit(cache=True, nogil=True)
def closer_than(tree, centre, axis, half, radius, distance):  # type: ignore[no-untyped-def]
    """Returns whether a triangle is nearer to a cylinder than a distance above 0, m."""
    stack = np.empty(STACK_SIZE, np.int64)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if node_bound(tree, node, centre, axis, half, radius) >= distance:
            continue
        start = tree.first[node]
        if tree.size[node] == 0:
            stack[top], stack[top + 1] = start, start + 1
            top += 2
            continue
        for f in range(start, start + tree.size[node]):
            if triangle_bound(tree.corners[f], centre, axis, half, radius) >= distance:
                continue
            if cylinder_triangle_distance(tree.corners[f], centre, axis, half, radius) < distance:
                return True
    return False


@njit(cache=True, nogil=True)
def _core(body, part, positions, rotations, low, high, axis):  # type: ignore[no-untyped-def]
    """Writes the ends and the direction of a part's axis in one state; returns its radius and its roundness, m.

    All of the part is within the radius of the axis, measured at right angles to it, and no farther than the roundness
    beyond the planes at right angles to it through the ends.
    """
    first = body.part_first[part]
    k, kind = body.station[first], body.kind[first]
    if kind == 0:
        half = body.half[first]
        for a in range(3):
            axis[a] = rotations[k, a, 2]
            low[a], high[a] = positions[k, a] - half * axis[a], positions[k, a] + half * axis[a]
        return body.radius[first], 0.0
    square, below, above = 0.0, 0.0, 0.0
    for a in range(3):
        axis[a] = positions[k, a] - positions[k - 1, a]
        square += axis[a] * axis[a]
        below += axis[a] * rotations[k - 1, a, 2]
        above += axis[a] * rotations[k, a, 2]
    length = math.sqrt(square)
    for a in range(3):
        axis[a] /= max(length, 1e-12)
    extra = body.half[first] if kind == 3 else 0.0
    for a in range(3):
        low[a], high[a] = positions[k - 1, a] - extra * axis[a], positions[k, a] + extra * axis[a]
    if kind == 3:
        return body.radius[first], 0.0
    # A tendon's hole at offset c of a disk that leans by an angle b is c sin b off the disk's plane along the chord.
    cosine = max(0.0, min(below, above)) / max(length, 1e-12)
    lean = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    c = body.part_offset[part]
    return c + body.part_radius[part], c * lean + body.part_radius[part]


@njit(cache=True, nogil=True)
def _spread_most(points, axis):  # type: ignore[no-untyped-def]
    """Turns a unit axis, shape (3,), to where four points, shape (4, 3), spread most about their mean."""
    found = np.empty(3)
    for _ in range(TURNS):
        found[:] = 0.0
        for p in range(4):
            along = 0.0
            for a in range(3):
                along += (points[p, a] - points[4, a]) * axis[a]
            for a in range(3):
                found[a] += along * (points[p, a] - points[4, a])
        length = math.sqrt(found[0] ** 2 + found[1] ** 2 + found[2] ** 2)
        if length <= 0.0:
            return
        for a in range(3):
            axis[a] = found[a] / length


@njit(cache=True, nogil=True)
def swept_free(field, wall, side, body, part, kept, positions, rotations, i, j, work):  # type: ignore[no-untyped-def]
    """Returns whether a cylinder about a part's places in two states keeps a distance from the walls.

    Between the states the points of the part lie between their two places, but for what they stray from straight
    lines, which `kept` must contain. A cylinder that holds both places is convex, so it holds what is between them.
    What the grown cylinder has in front of the entry plane is in one piece, so one point decides about its side;
    without such a plane the part's own places do, which are free.

    Args:
        field: The mesh's `Field`.
        wall: Tree of the triangles that the body must not touch.
        side: `Side` of the mesh.
        body: `BodyArrays` without margins.
        part: The part, not the shaft; both states must be free.
        kept: Distance that must be kept, m.
        positions: Disk centres of the states, shape (n, d, 3), m, world frame.
        rotations: world_from_disk, shape (n, d, 3, 3).
        i: The one state.
        j: The other.
        work: Written, shape (8, 3).
    """
    points, axis, here, there, centre = work[:5], work[5], work[6], work[7], work[4]
    radius, round_here = _core(body, part, positions[i], rotations[i], points[0], points[1], here)
    radius_there, round_there = _core(body, part, positions[j], rotations[j], points[2], points[3], there)
    radius = max(radius, radius_there)
    for a in range(3):
        axis[a] = here[a] + there[a]
        centre[a] = 0.25 * (points[0, a] + points[1, a] + points[2, a] + points[3, a])
    size = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    if size < 1.0:
        return False
    for a in range(3):
        axis[a] /= size
    _spread_most(points, axis)
    low, high, off = np.inf, -np.inf, 0.0
    for p in range(4):
        lean, own_round = (here, round_here) if p < 2 else (there, round_there)
        along, square, cosine = 0.0, 0.0, 0.0
        for a in range(3):
            e = points[p, a] - centre[a]
            along += e * axis[a]
            square += e * e
            cosine += lean[a] * axis[a]
        reach = radius * math.sqrt(max(0.0, 1.0 - cosine * cosine)) + own_round
        low, high = min(low, along - reach), max(high, along + reach)
        off = max(off, math.sqrt(max(0.0, square - along * along)) + own_round * math.sqrt(max(0.0, 1.0 - cosine**2)))
    half, wide = 0.5 * (high - low), radius + off
    for a in range(3):
        centre[a] += 0.5 * (low + high) * axis[a]
    if closer_than(wall, centre, axis, half, wide, kept):
        return False
    if field.rules[1] == 0 or field.rules[2] == 0:
        return True
    return _front_right(field, side, centre, axis, half, wide, kept)


@njit(cache=True, nogil=True)
def _front_right(field, side, centre, axis, half, radius, kept):  # type: ignore[no-untyped-def]
    """Returns whether what a grown cylinder that meets no wall has in front of the entry plane is on the right side."""
    px, py, pz = field.plane[3], field.plane[4], field.plane[5]
    along = axis[0] * px + axis[1] * py + axis[2] * pz
    shift = math.copysign(half, along)
    rim = towards_rim(axis, px, py, pz, along)
    x = centre[0] + shift * axis[0] + radius * rim[0]
    y = centre[1] + shift * axis[1] + radius * rim[1]
    z = centre[2] + shift * axis[2] + radius * rim[2]
    behind = -front(field, x, y, z)
    if behind >= kept:
        return True
    if behind >= 0.0:
        ahead = behind * (1.0 + 1e-9) + 1e-12
        x, y, z = x + ahead * px, y + ahead * py, z + ahead * pz
    _, _, known = bounds_at(field, x, y, z, 0.0)
    if known == 0:
        return not is_wrong(side, x, y, z)
    return known > 0
