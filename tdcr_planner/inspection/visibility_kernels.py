"""Visibility, compiled: which surface points a camera sees, past the scene's triangles and the robot's own solids."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.body import place_solid
from tdcr_planner.collision.tree import STACK_SIZE
from tdcr_planner.compiled import njit

# A line of sight ends this far before the point, so that the surface that holds the point does not hide it.
SURFACE_M = 1e-5
# A solid that the camera stands in, or on up to this, carries the camera and hides nothing.
CARRIER_M = 1e-6
# What keeps a point from being seen, as bits.
TOO_NEAR, TOO_FAR, OUTSIDE_PICTURE, GRAZING, OCCLUDED = 1, 2, 4, 8, 16


class Lens(NamedTuple):
    """A camera for compiled code; see `camera.Camera`."""

    position: FloatArray
    axes: FloatArray
    tangent_x: float
    tangent_y: float
    rectangular: bool
    near: float
    far: float
    cosine: float


class Clusters(NamedTuple):
    """Surface points in groups of neighbours, each in a ball.

    Attributes:
        points: Shape (p, 3), m, world frame.
        normals: Unit normals on the visible side, shape (p, 3).
        two_sided: 1 where both sides may be seen, shape (p,).
        first: First point of each group, the last entry p, shape (g + 1,).
        centres: Shape (g, 3), m.
        radii: Shape (g,), m.
    """

    points: FloatArray
    normals: FloatArray
    two_sided: IntArray
    first: IntArray
    centres: FloatArray
    radii: FloatArray


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


@njit(cache=False, nogil=True)
def _gather_solids(lens, body, positions, rotations, centre, frame, solids, centres, axes, halves):  # type: ignore[no-untyped-def]
    """Places the robot's solids that reach into a camera's picture; returns their number.

    A solid that holds the camera's centre carries it and is left out.
    """
    count = 0
    limit = math.sqrt(lens.tangent_x**2 + lens.tangent_y**2) if lens.rectangular else lens.tangent_x
    # Distance from a cone's surface is at least (r cos - z sin) of the half angle.
    cosine = 1.0 / math.sqrt(1.0 + limit * limit)
    sine = limit * cosine
    for i in range(len(body.kind)):
        half = place_solid(body, i, positions, rotations, centres[count], axes[count])
        if half < 0.0:
            continue
        ball = math.sqrt(half * half + body.radius[i] ** 2) + (body.radius[i] if body.round_ends[i] else 0.0)
        x, y, z = centres[count, 0] - centre[0], centres[count, 1] - centre[1], centres[count, 2] - centre[2]
        ahead = x * frame[0, 2] + y * frame[1, 2] + z * frame[2, 2]
        aside = math.sqrt(max(0.0, x * x + y * y + z * z - ahead * ahead))
        if aside * cosine - ahead * sine > ball or ahead < -ball or ahead > lens.far + ball:
            continue
        along = -(x * axes[count, 0] + y * axes[count, 1] + z * axes[count, 2])
        off = math.sqrt(max(0.0, x * x + y * y + z * z - along * along))
        beyond = abs(along) - half
        if body.round_ends[i]:
            inside = math.sqrt(max(beyond, 0.0) ** 2 + off * off) <= body.radius[i] + CARRIER_M
        else:
            inside = beyond <= CARRIER_M and off <= body.radius[i] + CARRIER_M
        if inside:
            continue
        solids[count], halves[count] = i, half
        count += 1
    return count


@njit(cache=False, nogil=True)
def _faults(lens, clusters, p, frame, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Returns what but occlusion keeps point p from being seen, as bits, its distance and its cosine of incidence."""
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    faults = 0
    if distance < lens.near:
        faults |= TOO_NEAR
    if distance > lens.far:
        faults |= TOO_FAR
    x = dx * frame[0, 0] + dy * frame[1, 0] + dz * frame[2, 0]
    y = dx * frame[0, 1] + dy * frame[1, 1] + dz * frame[2, 1]
    z = dx * frame[0, 2] + dy * frame[1, 2] + dz * frame[2, 2]
    if lens.rectangular:
        outside = z <= 0.0 or abs(x) > lens.tangent_x * z or abs(y) > lens.tangent_y * z
    else:
        outside = z <= 0.0 or x * x + y * y > (lens.tangent_x * z) ** 2
    if outside:
        faults |= OUTSIDE_PICTURE
    lean = -(dx * clusters.normals[p, 0] + dy * clusters.normals[p, 1] + dz * clusters.normals[p, 2])
    if clusters.two_sided[p]:
        lean = abs(lean)
    cosine = lean / distance if distance > 0.0 else 0.0
    if cosine < lens.cosine or cosine <= 0.0:
        faults |= GRAZING
    return faults, distance, cosine


@njit(cache=False, nogil=True)
def _place_camera(lens, position, rotation, centre, frame):  # type: ignore[no-untyped-def]
    """Writes the camera's centre, shape (3,), and world_from_camera, shape (3, 3), for a pose of the last disk."""
    for a in range(3):
        centre[a] = position[a]
        for b in range(3):
            centre[a] += rotation[a, b] * lens.position[b]
            frame[a, b] = 0.0
            for c in range(3):
                frame[a, b] += rotation[a, c] * lens.axes[c, b]


@njit(cache=False, nogil=True)
def _out_of_view(lens, clusters, group, centre, frame):  # type: ignore[no-untyped-def]
    """Returns whether a group of points lies out of range or outside of the cone about the picture."""
    limit = math.sqrt(lens.tangent_x**2 + lens.tangent_y**2) if lens.rectangular else lens.tangent_x
    cosine = 1.0 / math.sqrt(1.0 + limit * limit)
    radius = clusters.radii[group]
    x = clusters.centres[group, 0] - centre[0]
    y = clusters.centres[group, 1] - centre[1]
    z = clusters.centres[group, 2] - centre[2]
    square = x * x + y * y + z * z
    if square > (lens.far + radius) ** 2:
        return True
    ahead = x * frame[0, 2] + y * frame[1, 2] + z * frame[2, 2]
    aside = math.sqrt(max(0.0, square - ahead * ahead))
    return aside * cosine - ahead * limit * cosine > radius or ahead < -radius


@njit(cache=True, nogil=True)
def see(lens, clusters, tree, body, positions, rotations, seen, how):  # type: ignore[no-untyped-def]
    """Writes which points are seen from which states, and how where that is wanted.

    Args:
        lens: `Lens`.
        clusters: `Clusters`.
        tree: `TriangleTree` of everything that hides.
        body: `BodyArrays`.
        positions: Disk centres, shape (n, d, 3), m, world frame.
        rotations: world_from_disk, shape (n, d, 3, 3).
        seen: Where to write, shape (n, p).
        how: Where to write distance (m) and cosine of incidence of each point that is seen, shape (n, p, 2); shape
            (0, 0, 2) where they are not wanted.
    """
    total, last = len(body.kind), positions.shape[1] - 1
    solids, halves = np.empty(total, np.int64), np.empty(total)
    middles, axes = np.empty((total, 3)), np.empty((total, 3))
    centre, frame, way = np.empty(3), np.empty((3, 3)), np.empty(3)
    for i in range(len(positions)):
        _place_camera(lens, positions[i, last], rotations[i, last], centre, frame)
        known = -1
        for g in range(len(clusters.radii)):
            if _out_of_view(lens, clusters, g, centre, frame):
                continue
            for p in range(clusters.first[g], clusters.first[g + 1]):
                dx = clusters.points[p, 0] - centre[0]
                dy = clusters.points[p, 1] - centre[1]
                dz = clusters.points[p, 2] - centre[2]
                faults, distance, cosine = _faults(lens, clusters, p, frame, dx, dy, dz)
                if faults:
                    continue
                if known < 0:
                    known = _gather_solids(
                        lens, body, positions[i], rotations[i], centre, frame, solids, middles, axes, halves
                    )
                share = max(0.0, 1.0 - SURFACE_M / distance)
                way[0], way[1], way[2] = share * dx, share * dy, share * dz
                hidden = False
                for s in range(known):
                    solid = solids[s]
                    ends = body.round_ends[solid]
                    if solid_hides(middles[s], axes[s], body.radius[solid], halves[s], ends, centre, way):
                        hidden = True
                        break
                if hidden or segment_hits(tree, centre[0], centre[1], centre[2], way[0], way[1], way[2]):
                    continue
                seen[i, p] = True
                if len(how):
                    how[i, p, 0], how[i, p, 1] = distance, cosine


@njit(cache=True, nogil=True)
def nearest_miss(lens, clusters, tree, positions, rotations, which, found):  # type: ignore[no-untyped-def]
    """Adds to each point what single fault, or none, kept it from being seen in some state, as bits.

    Bit b of found[p] is set where a state misses the point for fault b alone; bit 5 where nothing but the robot, which
    is not tested, may hide it.

    Args:
        lens: `Lens`.
        clusters: `Clusters`.
        tree: `TriangleTree` of everything that hides.
        positions: Disk centres, shape (n, d, 3), m, world frame; the last disk's are used.
        rotations: world_from_disk, shape (n, d, 3, 3).
        which: Numbers of the points, shape (q,).
        found: Where to add, shape (q,).
    """
    last = positions.shape[1] - 1
    centre, frame = np.empty(3), np.empty((3, 3))
    for i in range(len(positions)):
        _place_camera(lens, positions[i, last], rotations[i, last], centre, frame)
        for q in range(len(which)):
            p = which[q]
            dx, dy, dz = (
                clusters.points[p, 0] - centre[0],
                clusters.points[p, 1] - centre[1],
                clusters.points[p, 2] - centre[2],
            )
            faults, distance, _ = _faults(lens, clusters, p, frame, dx, dy, dz)
            if faults & (faults - 1) or (faults and found[q] & faults):
                continue
            share = max(0.0, 1.0 - SURFACE_M / distance) if distance > 0.0 else 0.0
            if segment_hits(tree, centre[0], centre[1], centre[2], share * dx, share * dy, share * dz):
                faults = faults | OCCLUDED
            if faults == 0:
                found[q] |= 32
            elif faults & (faults - 1) == 0:
                found[q] |= faults
