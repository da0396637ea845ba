"""Exact distances between a solid (capsule or cylinder) and triangles, compiled."""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.body import towards_rim
from tdcr_planner.collision.tree import STACK_SIZE, triangle_square_distance
from tdcr_planner.compiled import njit

# The derivative's root is bracketed to this share of an edge, far below what the squared distance can resolve.
EDGE_TOLERANCE = 1e-13
# Share by which a distance must be smaller to be looked for.
EQUAL = 1e-9


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
    px, py, pz = a[0] - centre[0], a[1] - centre[1], a[2] - centre[2]
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    z0 = px * axis[0] + py * axis[1] + pz * axis[2]
    dz = ex * axis[0] + ey * axis[1] + ez * axis[2]
    px, py, pz = px - z0 * axis[0], py - z0 * axis[1], pz - z0 * axis[2]
    ex, ey, ez = ex - dz * axis[0], ey - dz * axis[1], ez - dz * axis[2]
    cc = px * px + py * py + pz * pz
    bb = px * ex + py * ey + pz * ez
    aa = ex * ex + ey * ey + ez * ez
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


@njit(cache=True, nogil=True, inline="always")
def _normal(triangle):  # type: ignore[no-untyped-def]
    """Returns the normal of a triangle, as long as twice its area, and the square of that length."""
    ux, uy, uz = triangle[1, 0] - triangle[0, 0], triangle[1, 1] - triangle[0, 1], triangle[1, 2] - triangle[0, 2]
    vx, vy, vz = triangle[2, 0] - triangle[0, 0], triangle[2, 1] - triangle[0, 1], triangle[2, 2] - triangle[0, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return nx, ny, nz, nx * nx + ny * ny + nz * nz


@njit(cache=True, nogil=True)
def _inside_triangle(px, py, pz, triangle, nx, ny, nz, square):  # type: ignore[no-untyped-def]
    """Returns whether the foot of p on the triangle's plane (normal n, not unit) lies in the triangle."""
    ux, uy, uz = triangle[1, 0] - triangle[0, 0], triangle[1, 1] - triangle[0, 1], triangle[1, 2] - triangle[0, 2]
    vx, vy, vz = triangle[2, 0] - triangle[0, 0], triangle[2, 1] - triangle[0, 1], triangle[2, 2] - triangle[0, 2]
    wx, wy, wz = px - triangle[0, 0], py - triangle[0, 1], pz - triangle[0, 2]
    beta = (wy * vz - wz * vy) * nx + (wz * vx - wx * vz) * ny + (wx * vy - wy * vx) * nz
    gamma = (uy * wz - uz * wy) * nx + (uz * wx - ux * wz) * ny + (ux * wy - uy * wx) * nz
    return beta >= 0.0 and gamma >= 0.0 and beta + gamma <= square


@njit(cache=True, nogil=True)
def cylinder_triangle_distance(triangle, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns the distance of a triangle, shape (3, 3), from a solid cylinder, m; 0 where they meet.

    Either an edge is nearest, or an inner point of the triangle is; then the direction between the two bodies is the
    triangle's normal and the cylinder's part is its extreme point along it.
    """
    best = np.inf
    for k in range(3):
        value = segment_cylinder_distance(triangle[k], triangle[(k + 1) % 3], centre, axis, half, radius)
        best = min(best, value)
        if best <= 0.0:
            return 0.0
    nx, ny, nz, square = _normal(triangle)
    if square <= 0.0:
        return best
    size = math.sqrt(square)
    along = (axis[0] * nx + axis[1] * ny + axis[2] * nz) / size
    end = math.copysign(half, along)
    rim = towards_rim(axis, nx / size, ny / size, nz / size, along)
    ax, ay, az = end * axis[0] + radius * rim[0], end * axis[1] + radius * rim[1], end * axis[2] + radius * rim[2]
    gx, gy, gz = centre[0] - triangle[0, 0], centre[1] - triangle[0, 1], centre[2] - triangle[0, 2]
    middle = (gx * nx + gy * ny + gz * nz) / size
    reach = (ax * nx + ay * ny + az * nz) / size
    # Towards the plane where it passes the cylinder by; onto the plane where it cuts it: no edge meets the cylinder, so
    # the cut lies wholly inside or wholly outside the triangle and one point of it decides.
    share = -math.copysign(1.0, middle) if abs(middle) > reach else (-middle / reach if reach > 0.0 else 0.0)
    px, py, pz = centre[0] + share * ax, centre[1] + share * ay, centre[2] + share * az
    if _inside_triangle(px, py, pz, triangle, nx, ny, nz, square):
        return min(best, max(0.0, abs(middle) - reach))
    return best


@njit(cache=True, nogil=True)
def _segments_square(px, py, pz, dx, dy, dz, corner, other):  # type: ignore[no-untyped-def]
    """Squared distance of the segments p + s d and from corner to other (Ericson 2005, section 5.1.9)."""
    ex, ey, ez = other[0] - corner[0], other[1] - corner[1], other[2] - corner[2]
    rx, ry, rz = px - corner[0], py - corner[1], pz - corner[2]
    a = dx * dx + dy * dy + dz * dz
    e = ex * ex + ey * ey + ez * ez
    f = ex * rx + ey * ry + ez * rz
    c = dx * rx + dy * ry + dz * rz
    b = dx * ex + dy * ey + dz * ez
    s, t = 0.0, 0.0
    if a > 0.0:
        bottom = a * e - b * b
        if bottom > 0.0:
            s = min(1.0, max(0.0, (b * f - c * e) / bottom))
        if e > 0.0:
            t = (b * s + f) / e
        if t < 0.0 or e <= 0.0:
            t, s = 0.0, min(1.0, max(0.0, -c / a))
        elif t > 1.0:
            t, s = 1.0, min(1.0, max(0.0, (b - c) / a))
    elif e > 0.0:
        t = min(1.0, max(0.0, f / e))
    gx, gy, gz = rx + s * dx - t * ex, ry + s * dy - t * ey, rz + s * dz - t * ez
    return gx * gx + gy * gy + gz * gz


@njit(cache=True, nogil=True)
def capsule_triangle_distance(triangle, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns the distance of a triangle, shape (3, 3), from a solid capsule, m; 0 where they meet."""
    px, py, pz = centre[0] - half * axis[0], centre[1] - half * axis[1], centre[2] - half * axis[2]
    dx, dy, dz = 2.0 * half * axis[0], 2.0 * half * axis[1], 2.0 * half * axis[2]
    qx, qy, qz = px + dx, py + dy, pz + dz
    nx, ny, nz, square = _normal(triangle)
    if square > 0.0:
        corner = triangle[0]
        below = (px - corner[0]) * nx + (py - corner[1]) * ny + (pz - corner[2]) * nz
        above = (qx - corner[0]) * nx + (qy - corner[1]) * ny + (qz - corner[2]) * nz
        if below * above < 0.0:
            s = below / (below - above)
            if _inside_triangle(px + s * dx, py + s * dy, pz + s * dz, triangle, nx, ny, nz, square):
                return 0.0
    best = min(triangle_square_distance(px, py, pz, triangle), triangle_square_distance(qx, qy, qz, triangle))
    for k in range(3):
        best = min(best, _segments_square(px, py, pz, dx, dy, dz, triangle[k], triangle[(k + 1) % 3]))
    return max(0.0, math.sqrt(best) - radius)


@njit(cache=True, nogil=True)
def triangle_distance(triangle, round_ends, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns the distance of a triangle from a capsule (`round_ends`) or a cylinder, m; 0 where they meet."""
    if round_ends:
        return capsule_triangle_distance(triangle, centre, axis, half, radius)
    return cylinder_triangle_distance(triangle, centre, axis, half, radius)


@njit(cache=True, nogil=True)
def triangle_bound(triangle, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns a cheap lower bound on the distance of a triangle from a cylinder, m.

    The gaps between the two along the triangle's normal, along the axis, and from the axis towards the triangle.
    """
    nx, ny, nz, square = _normal(triangle)
    gx, gy, gz = triangle[0, 0] - centre[0], triangle[0, 1] - centre[1], triangle[0, 2] - centre[2]
    best = 0.0
    if square > 0.0:
        size = math.sqrt(square)
        along = (axis[0] * nx + axis[1] * ny + axis[2] * nz) / size
        reach = half * abs(along) + radius * math.sqrt(max(0.0, 1.0 - along * along))
        best = abs(gx * nx + gy * ny + gz * nz) / size - reach
    mx = (triangle[0, 0] + triangle[1, 0] + triangle[2, 0]) / 3.0 - centre[0]
    my = (triangle[0, 1] + triangle[1, 1] + triangle[2, 1]) / 3.0 - centre[1]
    mz = (triangle[0, 2] + triangle[1, 2] + triangle[2, 2]) / 3.0 - centre[2]
    along = mx * axis[0] + my * axis[1] + mz * axis[2]
    mx, my, mz = mx - along * axis[0], my - along * axis[1], mz - along * axis[2]
    out = math.sqrt(mx * mx + my * my + mz * mz)
    low, high, near = np.inf, -np.inf, np.inf
    for k in range(3):
        px, py, pz = triangle[k, 0] - centre[0], triangle[k, 1] - centre[1], triangle[k, 2] - centre[2]
        z = px * axis[0] + py * axis[1] + pz * axis[2]
        low, high = min(low, z), max(high, z)
        if out > 0.0:
            near = min(near, (px * mx + py * my + pz * mz) / out)
    over = max(0.0, low - half, -high - half)
    beside = max(0.0, near - radius) if out > 0.0 else 0.0
    return max(best, math.sqrt(over * over + beside * beside))


@njit(cache=True, nogil=True)
def node_bound(tree, node, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Returns a lower bound on the distance of a node's triangles from a cylinder, m.

    The gaps along the axis and from the axis towards the node's box are at right angles, so both count.
    """
    mx = 0.5 * (tree.lower[node, 0] + tree.upper[node, 0]) - centre[0]
    my = 0.5 * (tree.lower[node, 1] + tree.upper[node, 1]) - centre[1]
    mz = 0.5 * (tree.lower[node, 2] + tree.upper[node, 2]) - centre[2]
    ex = 0.5 * (tree.upper[node, 0] - tree.lower[node, 0])
    ey = 0.5 * (tree.upper[node, 1] - tree.lower[node, 1])
    ez = 0.5 * (tree.upper[node, 2] - tree.lower[node, 2])
    along = mx * axis[0] + my * axis[1] + mz * axis[2]
    over = abs(along) - (ex * abs(axis[0]) + ey * abs(axis[1]) + ez * abs(axis[2])) - half
    mx, my, mz = mx - along * axis[0], my - along * axis[1], mz - along * axis[2]
    out = math.sqrt(mx * mx + my * my + mz * mz)
    beside = 0.0
    if out > 0.0:
        beside = out - (ex * abs(mx) + ey * abs(my) + ez * abs(mz)) / out - radius
    over, beside = max(0.0, over), max(0.0, beside)
    return math.sqrt(over * over + beside * beside)


@njit(cache=True, nogil=True)
def solid_distance(tree, round_ends, centre, axis, half, radius, bound):  # type: ignore[no-untyped-def]
    """Returns the distance of a solid from a mesh where below `bound`, otherwise `bound`, m; 0 where they meet.

    It is right to a share of `EQUAL`: in a tube hundreds of triangles are as near as each other but for rounding.
    """
    # A capsule is judged as the cylinder around it until its triangles are measured.
    tall = half + radius if round_ends else half
    best = bound
    stack = np.empty(STACK_SIZE, np.int64)
    least = np.empty(STACK_SIZE)
    stack[0], least[0] = 0, node_bound(tree, 0, centre, axis, tall, radius)
    top = 1
    while top > 0 and best > 0.0:
        top -= 1
        enough = (1.0 - EQUAL) * best
        if least[top] >= enough:
            continue
        node = stack[top]
        start = tree.first[node]
        if tree.size[node] > 0:
            for f in range(start, start + tree.size[node]):
                if triangle_bound(tree.corners[f], centre, axis, tall, radius) >= enough:
                    continue
                best = min(best, triangle_distance(tree.corners[f], round_ends, centre, axis, half, radius))
                enough = (1.0 - EQUAL) * best
            continue
        left = node_bound(tree, start, centre, axis, tall, radius)
        right = node_bound(tree, start + 1, centre, axis, tall, radius)
        near, far = (start, start + 1) if left <= right else (start + 1, start)
        stack[top], least[top] = far, max(left, right)
        stack[top + 1], least[top + 1] = near, min(left, right)
        top += 2
    return max(0.0, best)
