"""The triangle tree: exact distance from a point to a triangle mesh and its generalized winding number, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.compiled import njit

LEAF_SIZE = 4
# A node farther away than this many of its radii enters the winding number as one dipole; see `winding_number`.
DIPOLE_RANGE = 3.0
# The tree is halved at the median, so a stack this deep holds a traversal of more than 2**60 triangles.
STACK_SIZE = 128


class TriangleTree(NamedTuple):
    """A bounding volume hierarchy over triangles; node 0 is the root, children stand next to each other.

    Attributes:
        corners: Triangle corners in tree order, shape (f, 3, 3), m.
        order: Index of each triangle of `corners` in the mesh, shape (f,).
        lower: Lower corner of each node's box, shape (k, 3), m.
        upper: Upper corner of each node's box, shape (k, 3), m.
        first: Shape (k,); the left child of an inner node, the first triangle of a leaf.
        size: Shape (k,); the number of triangles of a leaf, 0 for an inner node.
        dipole: Sum of area times normal over the node's triangles, shape (k, 3), m^2.
        centre: Area-weighted centre of the node's triangles, shape (k, 3), m.
        radius: Largest distance of a corner from that centre, shape (k,), m.
    """

    corners: FloatArray
    order: IntArray
    lower: FloatArray
    upper: FloatArray
    first: IntArray
    size: IntArray
    dipole: FloatArray
    centre: FloatArray
    radius: FloatArray


def build_tree(vertices: FloatArray, faces: IntArray) -> TriangleTree:
    """Returns the tree of a mesh.

    Args:
        vertices: Shape (v, 3), m.
        faces: Shape (f, 3), one or more rows.
    """
    return TriangleTree(*_build(np.ascontiguousarray(vertices[faces], dtype=np.float64)))


@njit(cache=True, nogil=True)
def _select(keys, items, low, high, nth):  # type: ignore[no-untyped-def]
    """Orders items[low:high] so that items[nth] has the key it would have if they were sorted (Hoare's quickselect)."""
    high -= 1
    while low < high:
        pivot = keys[items[(low + high) // 2]]
        i, j = low, high
        while i <= j:
            while keys[items[i]] < pivot:
                i += 1
            while keys[items[j]] > pivot:
                j -= 1
            if i <= j:
                items[i], items[j] = items[j], items[i]
                i += 1
                j -= 1
        if nth <= j:
            high = j
        elif nth >= i:
            low = i
        else:
            return


@njit(cache=True, nogil=True)
def _build(corners):  # type: ignore[no-untyped-def]
    total = len(corners)
    centroids = np.empty((3, total))
    for f in range(total):
        for a in range(3):
            centroids[a, f] = (corners[f, 0, a] + corners[f, 1, a] + corners[f, 2, a]) / 3.0
    order = np.arange(total)
    size = 2 * total + 1
    lower = np.empty((size, 3))
    upper = np.empty((size, 3))
    first = np.zeros(size, np.int64)
    count = np.zeros(size, np.int64)
    dipole = np.zeros((size, 3))
    centre = np.zeros((size, 3))
    radius = np.zeros(size)
    stack = np.zeros((STACK_SIZE, 3), np.int64)
    stack[0, 1], stack[0, 2] = 0, total
    top, used = 1, 1
    while top > 0:
        top -= 1
        node, low, high = stack[top, 0], stack[top, 1], stack[top, 2]
        _summarise(corners, order, low, high, node, lower, upper, dipole, centre, radius)
        if high - low <= LEAF_SIZE:
            first[node], count[node] = low, high - low
            continue
        least = np.full(3, np.inf)
        most = np.full(3, -np.inf)
        for i in range(low, high):
            for a in range(3):
                value = centroids[a, order[i]]
                least[a] = min(least[a], value)
                most[a] = max(most[a], value)
        middle = (low + high) // 2
        _select(centroids[np.argmax(most - least)], order, low, high, middle)
        first[node] = used
        stack[top, 0], stack[top, 1], stack[top, 2] = used, low, middle
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = used + 1, middle, high
        top += 2
        used += 2
    return (
        corners[order],
        order,
        lower[:used].copy(),
        upper[:used].copy(),
        first[:used].copy(),
        count[:used].copy(),
        dipole[:used].copy(),
        centre[:used].copy(),
        radius[:used].copy(),
    )


@njit(cache=True, nogil=True)
def _summarise(corners, order, low, high, node, lower, upper, dipole, centre, radius):  # type: ignore[no-untyped-def]
    """Writes box, dipole, centre and radius of the triangles order[low:high] into a node."""
    lower[node] = np.inf
    upper[node] = -np.inf
    weight = 0.0
    for i in range(low, high):
        triangle = corners[order[i]]
        ux, uy, uz = triangle[1, 0] - triangle[0, 0], triangle[1, 1] - triangle[0, 1], triangle[1, 2] - triangle[0, 2]
        vx, vy, vz = triangle[2, 0] - triangle[0, 0], triangle[2, 1] - triangle[0, 1], triangle[2, 2] - triangle[0, 2]
        nx, ny, nz = 0.5 * (uy * vz - uz * vy), 0.5 * (uz * vx - ux * vz), 0.5 * (ux * vy - uy * vx)
        area = math.sqrt(nx * nx + ny * ny + nz * nz)
        weight += area
        dipole[node, 0] += nx
        dipole[node, 1] += ny
        dipole[node, 2] += nz
        for a in range(3):
            centre[node, a] += area * (triangle[0, a] + triangle[1, a] + triangle[2, a]) / 3.0
            for c in range(3):
                lower[node, a] = min(lower[node, a], triangle[c, a])
                upper[node, a] = max(upper[node, a], triangle[c, a])
    for a in range(3):
        centre[node, a] = centre[node, a] / weight if weight > 0.0 else 0.5 * (lower[node, a] + upper[node, a])
    farthest = 0.0
    for i in range(low, high):
        for c in range(3):
            square = 0.0
            for a in range(3):
                square += (corners[order[i], c, a] - centre[node, a]) ** 2
            farthest = max(farthest, square)
    radius[node] = math.sqrt(farthest)


@njit(cache=True, nogil=True, inline="always")
def _segment_square(px, py, pz, a, b):  # type: ignore[no-untyped-def]
    """Squared distance of point p from the segment a b, either of which may be the other."""
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    dx, dy, dz = px - a[0], py - a[1], pz - a[2]
    length = ex * ex + ey * ey + ez * ez
    t = (dx * ex + dy * ey + dz * ez) / length if length > 0.0 else 0.0
    t = min(1.0, max(0.0, t))
    dx -= t * ex
    dy -= t * ey
    dz -= t * ez
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def triangle_square_distance(px, py, pz, triangle):  # type: ignore[no-untyped-def]
    """Squared distance of point p from a triangle, shape (3, 3); a degenerate triangle counts as its edges.

    The foot on the triangle's plane decides when it lies inside all three edges; otherwise the nearest edge does.
    """
    a, b, c = triangle[0], triangle[1], triangle[2]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = px - a[0], py - a[1], pz - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    if square > 0.0:
        # Barycentric coordinates of the foot, times the squared normal (Ericson 2005, section 3.4).
        beta = (wy * vz - wz * vy) * nx + (wz * vx - wx * vz) * ny + (wx * vy - wy * vx) * nz
        gamma = (uy * wz - uz * wy) * nx + (uz * wx - ux * wz) * ny + (ux * wy - uy * wx) * nz
        if beta >= 0.0 and gamma >= 0.0 and beta + gamma <= square:
            height = wx * nx + wy * ny + wz * nz
            return height * height / square
    return min(_segment_square(px, py, pz, a, b), _segment_square(px, py, pz, b, c), _segment_square(px, py, pz, c, a))


@njit(cache=True, nogil=True, inline="always")
def box_square_distance(px, py, pz, lower, upper):  # type: ignore[no-untyped-def]
    """Squared distance of point p from an axis-aligned box, 0 inside."""
    dx = max(lower[0] - px, 0.0, px - upper[0])
    dy = max(lower[1] - py, 0.0, py - upper[1])
    dz = max(lower[2] - pz, 0.0, pz - upper[2])
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def nearest_triangle(tree, px, py, pz, bound):  # type: ignore[no-untyped-def]
    """Returns the squared distance to the nearest triangle within the distance `bound`, and its place in tree order.

    Where no triangle lies within the bound the place is -1 and the square that of the bound.
    """
    best = bound * bound
    found = -1
    stack = np.empty(STACK_SIZE, np.int64)
    square = np.empty(STACK_SIZE)
    stack[0], square[0] = 0, box_square_distance(px, py, pz, tree.lower[0], tree.upper[0])
    top = 1
    while top > 0:
        top -= 1
        if square[top] > best:
            continue
        node = stack[top]
        start = tree.first[node]
        if tree.size[node] > 0:
            for f in range(start, start + tree.size[node]):
                value = triangle_square_distance(px, py, pz, tree.corners[f])
                if value <= best:
                    best, found = value, f
            continue
        left = box_square_distance(px, py, pz, tree.lower[start], tree.upper[start])
        right = box_square_distance(px, py, pz, tree.lower[start + 1], tree.upper[start + 1])
        near, far = (start, start + 1) if left <= right else (start + 1, start)
        stack[top], square[top] = far, max(left, right)
        stack[top + 1], square[top + 1] = near, min(left, right)
        top += 2
    return best, found


@njit(cache=True, nogil=True)
def _solid_angle(px, py, pz, triangle):  # type: ignore[no-untyped-def]
    """Signed solid angle of a triangle seen from p (Van Oosterom and Strackee 1983, eq. 8)."""
    ax, ay, az = triangle[0, 0] - px, triangle[0, 1] - py, triangle[0, 2] - pz
    bx, by, bz = triangle[1, 0] - px, triangle[1, 1] - py, triangle[1, 2] - pz
    cx, cy, cz = triangle[2, 0] - px, triangle[2, 1] - py, triangle[2, 2] - pz
    la = math.sqrt(ax * ax + ay * ay + az * az)
    lb = math.sqrt(bx * bx + by * by + bz * bz)
    lc = math.sqrt(cx * cx + cy * cy + cz * cz)
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab = ax * bx + ay * by + az * bz
    bc = bx * cx + by * cy + bz * cz
    ca = cx * ax + cy * ay + cz * az
    return 2.0 * math.atan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)


@njit(cache=True, nogil=True)
def _winding(tree, px, py, pz, dipole_range):  # type: ignore[no-untyped-def]
    total = 0.0
    stack = np.empty(STACK_SIZE, np.int64)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        dx = tree.centre[node, 0] - px
        dy = tree.centre[node, 1] - py
        dz = tree.centre[node, 2] - pz
        square = dx * dx + dy * dy + dz * dz
        reach = dipole_range * tree.radius[node]
        if square > reach * reach and dipole_range < np.inf:
            moment = dx * tree.dipole[node, 0] + dy * tree.dipole[node, 1] + dz * tree.dipole[node, 2]
            total += moment / (square * math.sqrt(square))
            continue
        start = tree.first[node]
        if tree.size[node] > 0:
            for f in range(start, start + tree.size[node]):
                total += _solid_angle(px, py, pz, tree.corners[f])
            continue
        stack[top], stack[top + 1] = start, start + 1
        top += 2
    return total / (4.0 * math.pi)


@njit(cache=True, nogil=True)
def winding_number(tree, px, py, pz):  # type: ignore[no-untyped-def]
    """Returns the winding number of a closed mesh about p (Jacobson et al. 2013), an integer off the surface.

    Far nodes are summed as dipoles (Barill et al. 2018). Since the true value is an integer, an approximate one
    that is not clearly near an integer is computed again without the approximation.
    """
    value = _winding(tree, px, py, pz, DIPOLE_RANGE)
    nearest = np.floor(value + 0.5)
    if abs(value - nearest) > 0.15:
        nearest = np.floor(_winding(tree, px, py, pz, np.inf) + 0.5)
    return nearest


@njit(cache=True, nogil=True)
def nearest_distances(tree, points):  # type: ignore[no-untyped-def]
    """Returns the distance of each point, shape (n, 3), m, from the mesh, m, and its triangle, each shape (n,)."""
    distances = np.empty(len(points))
    triangles = np.empty(len(points), np.int64)
    for i in range(len(points)):
        square, found = nearest_triangle(tree, points[i, 0], points[i, 1], points[i, 2], np.inf)
        distances[i] = math.sqrt(square)
        triangles[i] = tree.order[found]
    return distances, triangles


@njit(cache=True, nogil=True)
def winding_numbers(tree, points):  # type: ignore[no-untyped-def]
    """Returns the winding number about each point, shape (n, 3), m, as shape (n,)."""
    values = np.empty(len(points))
    for i in range(len(points)):
        values[i] = winding_number(tree, points[i, 0], points[i, 1], points[i, 2])
    return values
