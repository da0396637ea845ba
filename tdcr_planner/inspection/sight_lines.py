"""Lines of sight, compiled: whether a segment crosses a triangle of a tree, or meets a solid of the robot."""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.tree import STACK_SIZE
from tdcr_planner.compiled import njit


@njit(cache=False, nogil=True)
def segment_hits(tree, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Returns whether a segment from o, of direction and length d, crosses a triangle of a tree."""
    stack = np.empty(STACK_SIZE, np.int64)
    ix = 1.0 / dx if dx != 0.0 else math.copysign(1e300, dx)
    iy = 1.0 / dy if dy != 0.0 else math.copysign(1e300, dy)
    iz = 1.0 / dz if dz != 0.0 else math.copysign(1e300, dz)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        a, b = (tree.lower[node, 0] - ox) * ix, (tree.upper[node, 0] - ox) * ix
        low, high = min(a, b), max(a, b)
        a, b = (tree.lower[node, 1] - oy) * iy, (tree.upper[node, 1] - oy) * iy
        low, high = max(low, min(a, b)), min(high, max(a, b))
        a, b = (tree.lower[node, 2] - oz) * iz, (tree.upper[node, 2] - oz) * iz
        low, high = max(low, min(a, b)), min(high, max(a, b))
        # A little wider than exact, so that rounding opens no gap between two boxes.
        if low > high + 1e-12 or high < -1e-12 or low > 1.0 + 1e-12:
            continue
        start = tree.first[node]
        if tree.size[node] == 0:
            stack[top], stack[top + 1] = start, start + 1
            top += 2
            continue
        for f in range(start, start + tree.size[node]):
            if _crosses(tree.corners[f], ox, oy, oz, dx, dy, dz):
                return True
    return False


@njit(cache=False, nogil=True)
def _crosses(triangle, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Returns whether the segment from o to o + d crosses a triangle (Moeller and Trumbore 1997), edges included."""
    ux, uy, uz = triangle[1, 0] - triangle[0, 0], triangle[1, 1] - triangle[0, 1], triangle[1, 2] - triangle[0, 2]
    vx, vy, vz = triangle[2, 0] - triangle[0, 0], triangle[2, 1] - triangle[0, 1], triangle[2, 2] - triangle[0, 2]
    px, py, pz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
    volume = ux * px + uy * py + uz * pz
    if volume == 0.0:
        return False
    inverse = 1.0 / volume
    sx, sy, sz = ox - triangle[0, 0], oy - triangle[0, 1], oz - triangle[0, 2]
    beta = (sx * px + sy * py + sz * pz) * inverse
    if beta < 0.0 or beta > 1.0:
        return False
    qx, qy, qz = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
    gamma = (dx * qx + dy * qy + dz * qz) * inverse
    if gamma < 0.0 or beta + gamma > 1.0:
        return False
    along = (vx * qx + vy * qy + vz * qz) * inverse
    return along >= 0.0 and along <= 1.0


@njit(cache=False, nogil=True)
def solid_hides(centre, axis, radius, half, round_ends, start, way):  # type: ignore[no-untyped-def]
    """Returns whether a segment meets a solid: a cylinder, or a capsule about its core.

    Args:
        centre: Shape (3,), m.
        axis: Unit axis, shape (3,).
        radius: m.
        half: Half length of the cylinder, or of the capsule's core, m.
        round_ends: Whether it is a capsule.
        start: Where the segment starts, shape (3,), m.
        way: From there to its end, shape (3,), m.
    """
    dx, dy, dz = way[0], way[1], way[2]
    sx, sy, sz = start[0] - centre[0], start[1] - centre[1], start[2] - centre[2]
    s, d = sx * axis[0] + sy * axis[1] + sz * axis[2], dx * axis[0] + dy * axis[1] + dz * axis[2]
    rx, ry, rz = sx - s * axis[0], sy - s * axis[1], sz - s * axis[2]
    ex, ey, ez = dx - d * axis[0], dy - d * axis[1], dz - d * axis[2]
    a, b = ex * ex + ey * ey + ez * ez, rx * ex + ry * ey + rz * ez
    c = rx * rx + ry * ry + rz * rz - radius * radius
    low, high = 0.0, 1.0
    if a > 1e-24:
        square = b * b - a * c
        if square < 0.0:
            return False
        root = math.sqrt(square)
        low, high = max(low, (-b - root) / a), min(high, (-b + root) / a)
    elif c > 0.0:
        return False
    # Between the planes of the ends.
    first, last = low, high
    if abs(d) > 1e-12:
        t0, t1 = (-half - s) / d, (half - s) / d
        first, last = max(first, min(t0, t1)), min(last, max(t0, t1))
    elif abs(s) > half:
        last = -1.0
    if first <= last:
        return True
    if not round_ends:
        return False
    for sign in (-1.0, 1.0):
        gx, gy, gz = sx - sign * half * axis[0], sy - sign * half * axis[1], sz - sign * half * axis[2]
        qa = dx * dx + dy * dy + dz * dz
        qb = gx * dx + gy * dy + gz * dz
        qc = gx * gx + gy * gy + gz * gz - radius * radius
        square = qb * qb - qa * qc
        if square >= 0.0:
            root = math.sqrt(square)
            if (-qb - root) / qa <= 1.0 and (-qb + root) / qa >= 0.0:
                return True
    return False
