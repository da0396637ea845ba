"""Exact distances between a solid (capsule or cylinder) and triangles, compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tdcr_planner.collision.tree import STACK_SIZE, box_square_distance, triangle_square_distance

# The derivative's root is bracketed to this share of an edge, far below what the squared distance can resolve.
EDGE_TOLERANCE = 1e-13


@njit(cache=True, nogil=True)
def point_cylinder_distance(x, y, z, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns the distance of a point from a solid cylinder, m; 0 inside."""
    dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
    along = dx * axis[0] + dy * axis[1] + dz * axis[2]
    across = math.sqrt(max(0.0, dx * dx + dy * dy + dz * dz - along * along))
    over, out = max(0.0, abs(along) - half), max(0.0, across - radius)
    return math.sqrt(over * over + out * out)


@njit(cache=True, nogil=True)
def segment_cylinder_distance(a, b, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns the distance of the segment a b from a solid cylinder, m; 0 where they meet.

    The squared distance from a convex set is convex and differentiable along a line, so its minimum is where the
    derivative changes sign; that place is bracketed and closed in by the Illinois variant of regula falsi.
    """
    z0, dz, cc, bb, aa = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        z0 += (a[i] - centre[i]) * axis[i]
        dz += (b[i] - a[i]) * axis[i]
    for i in range(3):
        start = a[i] - centre[i] - z0 * axis[i]
        edge = b[i] - a[i] - dz * axis[i]
        cc += start * start
        bb += start * edge
        aa += edge * edge
    low, high = 0.0, 1.0
    slope_low = _slope(low, z0, dz, aa, bb, cc, half, radius)
    if slope_low >= 0.0:
        return _from_axis(low, z0, dz, aa, bb, cc, half, radius)
    slope_high = _slope(high, z0, dz, aa, bb, cc, half, radius)
    if slope_high <= 0.0:
        return _from_axis(high, z0, dz, aa, bb, cc, half, radius)
    side = 0
    middle = 0.5
    for step in range(100):
        if high - low <= EDGE_TOLERANCE:
            break
        middle = (low * slope_high - high * slope_low) / (slope_high - slope_low)
        if step % 8 == 7 or not low < middle < high:
            middle = 0.5 * (low + high)
        slope = _slope(middle, z0, dz, aa, bb, cc, half, radius)
        if slope == 0.0:
            break
        if slope > 0.0:
            high, slope_high = middle, slope
            if side == 1:
                slope_low *= 0.5
            side = 1
        else:
            low, slope_low = middle, slope
            if side == -1:
                slope_high *= 0.5
            side = -1
    return _from_axis(middle, z0, dz, aa, bb, cc, half, radius)


@njit(cache=True, nogil=True, inline="always")
def _from_axis(t, z0, dz, aa, bb, cc, half, radius):  # type: ignore[no-untyped-def]
    across = math.sqrt(max(0.0, aa * t * t + 2.0 * bb * t + cc))
    over, out = max(0.0, abs(z0 + t * dz) - half), max(0.0, across - radius)
    return math.sqrt(over * over + out * out)


@njit(cache=True, nogil=True, inline="always")
def _slope(t, z0, dz, aa, bb, cc, half, radius):  # type: ignore[no-untyped-def]
    """Half the derivative of the squared distance along the segment."""
    z = z0 + t * dz
    across = math.sqrt(max(0.0, aa * t * t + 2.0 * bb * t + cc))
    value = 0.0
    if across > radius:
        value += (across - radius) * (aa * t + bb) / across
    if z > half:
        value += (z - half) * dz
    elif z < -half:
        value += (z + half) * dz
    return value


@njit(cache=True, nogil=True)
def _inside_triangle(p, triangle, n, square):  # type: ignore[no-untyped-def]
    """Returns whether the foot of p on the triangle's plane (normal n, not unit) lies in the triangle."""
    u, v, w = triangle[1] - triangle[0], triangle[2] - triangle[0], p - triangle[0]
    beta = np.dot(np.cross(w, v), n)
    gamma = np.dot(np.cross(u, w), n)
    return beta >= 0.0 and gamma >= 0.0 and beta + gamma <= square


@njit(cache=True, nogil=True)
def cylinder_triangle_distance(triangle, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns the distance of a triangle, shape (3, 3), from a solid cylinder, m; 0 where they meet.

    Either an edge is nearest, or an inner point of the triangle is; then the direction between the two bodies is the
    triangle's normal and the cylinder's part is its extreme point along it.
    """
    best = np.inf
    for k in range(3):
        best = min(best, segment_cylinder_distance(triangle[k], triangle[(k + 1) % 3], centre, axis, half, radius))
        if best <= 0.0:
            return 0.0
    n = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    square = np.dot(n, n)
    if square <= 0.0:
        return best
    size = math.sqrt(square)
    along = np.dot(axis, n) / size
    across = math.sqrt(max(0.0, 1.0 - along * along))
    arm = np.empty(3)
    for i in range(3):
        arm[i] = math.copysign(half, along) * axis[i]
        if across > 1e-12:
            arm[i] += radius * (n[i] / size - along * axis[i]) / across
    middle = np.dot(centre - triangle[0], n) / size
    reach = np.dot(arm, n) / size
    if abs(middle) > reach:
        extreme = centre - math.copysign(1.0, middle) * arm
        if _inside_triangle(extreme, triangle, n, square):
            return min(best, abs(middle) - reach)
        return best
    # The plane cuts the cylinder: no edge meets it, so the cut lies wholly inside or wholly outside the triangle.
    share = -middle / reach if reach > 0.0 else 0.0
    return 0.0 if _inside_triangle(centre + share * arm, triangle, n, square) else best


@njit(cache=True, nogil=True)
def _segments_square(p, d, q, e):  # type: ignore[no-untyped-def]
    """Squared distance of the segments p + s d and q + t e (Ericson 2005, section 5.1.9)."""
    r = p - q
    a, ee, f = np.dot(d, d), np.dot(e, e), np.dot(e, r)
    if a <= 0.0 and ee <= 0.0:
        return np.dot(r, r)
    c = np.dot(d, r)
    if a <= 0.0:
        s, t = 0.0, min(1.0, max(0.0, f / ee))
    elif ee <= 0.0:
        s, t = min(1.0, max(0.0, -c / a)), 0.0
    else:
        b = np.dot(d, e)
        bottom = a * ee - b * b
        s = min(1.0, max(0.0, (b * f - c * ee) / bottom)) if bottom > 0.0 else 0.0
        t = (b * s + f) / ee
        if t < 0.0:
            s, t = min(1.0, max(0.0, -c / a)), 0.0
        elif t > 1.0:
            s, t = min(1.0, max(0.0, (b - c) / a)), 1.0
    gap = r + s * d - t * e
    return np.dot(gap, gap)


@njit(cache=True, nogil=True)
def capsule_triangle_distance(triangle, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns the distance of a triangle, shape (3, 3), from a solid capsule, m; 0 where they meet."""
    start, edge = centre - half * axis, 2.0 * half * axis
    finish = start + edge
    n = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    square = np.dot(n, n)
    if square > 0.0:
        below, above = np.dot(start - triangle[0], n), np.dot(finish - triangle[0], n)
        if below * above < 0.0 and _inside_triangle(start + edge * (below / (below - above)), triangle, n, square):
            return 0.0
    best = min(
        triangle_square_distance(start[0], start[1], start[2], triangle),
        triangle_square_distance(finish[0], finish[1], finish[2], triangle),
    )
    for k in range(3):
        corner = triangle[k]
        best = min(best, _segments_square(start, edge, corner, triangle[(k + 1) % 3] - corner))
    return max(0.0, math.sqrt(best) - radius)


@njit(cache=True, nogil=True)
def _node_bound(tree, node, round_ends, centre, axis, half, radius, cover):  # type: ignore[no-untyped-def]
    """Returns a lower bound on the distance of a solid from a node's triangles, m."""
    x, y, z = tree.centre[node, 0], tree.centre[node, 1], tree.centre[node, 2]
    if round_ends:
        ball = point_cylinder_distance(x, y, z, centre, axis, half, 0.0) - radius
    else:
        ball = point_cylinder_distance(x, y, z, centre, axis, half, radius)
    box = math.sqrt(box_square_distance(centre[0], centre[1], centre[2], tree.lower[node], tree.upper[node]))
    return max(ball - tree.radius[node], box - cover)


@njit(cache=True, nogil=True)
def solid_distance(tree, round_ends, centre, axis, half, radius, bound):  # type: ignore[no-untyped-def]
    """Returns the distance of a solid from a mesh where below `bound`, otherwise `bound`, m; 0 where they meet."""
    cover = half + radius if round_ends else math.sqrt(half * half + radius * radius)
    best = bound
    stack = np.empty(STACK_SIZE, np.int64)
    least = np.empty(STACK_SIZE)
    stack[0], least[0] = 0, _node_bound(tree, 0, round_ends, centre, axis, half, radius, cover)
    top = 1
    while top > 0 and best > 0.0:
        top -= 1
        if least[top] >= best:
            continue
        node = stack[top]
        start = tree.first[node]
        if tree.size[node] > 0:
            for f in range(start, start + tree.size[node]):
                if round_ends:
                    value = capsule_triangle_distance(tree.corners[f], centre, axis, half, radius)
                else:
                    value = cylinder_triangle_distance(tree.corners[f], centre, axis, half, radius)
                best = min(best, value)
            continue
        left = _node_bound(tree, start, round_ends, centre, axis, half, radius, cover)
        right = _node_bound(tree, start + 1, round_ends, centre, axis, half, radius, cover)
        near, far = (start, start + 1) if left <= right else (start + 1, start)
        stack[top], least[top] = far, max(left, right)
        stack[top + 1], least[top + 1] = near, min(left, right)
        top += 2
    return max(0.0, best)
