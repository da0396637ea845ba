"""Visibility, compiled: which surface points a camera sees, past the scene's triangles and the robot's own solids."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.body import place_solid
from tdcr_planner.compiled import njit
from tdcr_planner.inspection.sight_lines import segment_hits, solid_hides

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
