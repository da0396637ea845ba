"""Which parts of the body could touch each other: the pairs that count, and those that a state brings near."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.body import RobotBody
from tdcr_planner.compiled import njit


class SelfPairs(NamedTuple):
    """The pairs of parts that count as self-collision, for compiled code.

    Attributes:
        reach: Distance from disk k within which disk k and gap k lie, shape (d,), m; entry 0 is the shaft's radius.
        reach_below: The largest of these over disks 1 to k, shape (d,), m.
        apart: Shape (d,); disk j with j <= apart[k] is far enough along the body from disk k to be asked about, -1
            for none.
        shaft: Shape (d,); 1 where disk k and gap k are asked about against the shaft.
        spacing: Largest distance between neighbouring disks, m.
        radius: Radius of a ball about each part of the unloaded robot, shape (q,), m.
        allowed: Shape (q, q); true for pairs of parts that are asked about.
        shaft_start: The point that the shaft comes from, shape (3,), m, world frame.
    """

    reach: FloatArray
    reach_below: FloatArray
    apart: IntArray
    shaft: IntArray
    spacing: float
    radius: FloatArray
    allowed: BoolArray
    shaft_start: FloatArray


def make_self_pairs(body: RobotBody) -> SelfPairs:
    """Returns the pairs of a body that count as self-collision.

    A body bent into a half circle keeps parts that lie s apart along it at least 2 s / pi apart in space. So only pairs
    are asked about whose s is above pi / 2 times the sum of their radii: a straight body, or one that bends smoothly by
    up to half a turn over that length, can never be refused, and what is refused has truly come back to itself.
    """
    robot, arrays = body.robot, body.arrays
    count = robot.disk_count
    spacing = np.diff(robot.arc_lengths)
    radius = np.zeros(len(body.part_names))
    for part in range(len(radius)):
        first, last = arrays.part_first[part], arrays.part_first[part + 1]
        station = int(arrays.station[first])
        chord = float(spacing[station - 1]) if part % 2 == 1 and station > 0 else 0.0
        across = np.linalg.norm(arrays.offset[first:last], axis=1) + arrays.radius[first:last]
        along = (
            arrays.half[first:last]
            + 0.5 * chord
            + np.where(arrays.round_ends[first:last] > 0, arrays.radius[first:last], 0.0)
        )
        radius[part] = float(np.hypot(across, along).max())
    arcs = np.maximum(arrays.part_arc, 0.0)
    is_shaft = arrays.part_arc < 0.0
    radius[is_shaft] = arrays.radius[-1]
    allowed = np.abs(arcs[:, None] - arcs[None, :]) > 0.5 * math.pi * (radius[:, None] + radius[None, :])
    allowed[np.ix_(is_shaft, is_shaft)] = False
    disk_part = np.array([2 * (count - 1 - k) for k in range(1, count)])
    reach = np.zeros(count)
    # Gap k ends at disk k; it stretches little, and a tenth covers the chord between holes on a bend's outer side.
    reach[1:] = np.maximum(radius[disk_part], radius[disk_part + 1] + 0.55 * spacing)
    reach_below = np.concatenate([[0.0], np.maximum.accumulate(reach[1:])])
    apart = np.full(count, -1, dtype=np.int64)
    shaft = np.zeros(count, dtype=np.int64)
    for k in range(1, count):
        own = [disk_part[k - 1], disk_part[k - 1] + 1]
        for j in range(1, k):
            others = [disk_part[j - 1], disk_part[j - 1] + 1]
            if allowed[np.ix_(own, others)].any():
                apart[k] = j
        if is_shaft.any():
            reach[0] = arrays.radius[-1]
            shaft[k] = int(allowed[own, -1].any())
    return SelfPairs(reach, reach_below, apart, shaft, float(spacing.max()), radius, allowed, arrays.shaft_start)


@njit(cache=True, nogil=True)
def near_pairs(pairs, positions, apart, found):  # type: ignore[no-untyped-def]
    """Writes pairs (k, j) of disks whose neighbourhoods may be nearer than `apart`; j = 0 stands for the shaft.

    From disk j on, the distance to disk k shrinks by no more than one spacing a disk, so disks are skipped that cannot
    have come near yet.

    Args:
        pairs: `SelfPairs`.
        positions: Disk centres, shape (d, 3), m.
        apart: Distance of interest, m; 0 for touching.
        found: Where to write, shape (any, 2); pairs beyond its length are counted only.

    Returns:
        The number of pairs.
    """
    total = 0
    spacing = 1e-9
    count = len(positions)
    for k in range(1, count):
        spacing = max(spacing, _distance(positions[k], positions[k - 1]))
    # Reaches are those of the unloaded robot: poses that stand farther apart reach farther.
    stretch = 2.0 * max(0.0, spacing - pairs.spacing) + apart
    for k in range(1, count):
        j = pairs.apart[k]
        while j >= 1:
            gap = _distance(positions[k], positions[j]) - pairs.reach[k] - stretch
            if gap <= pairs.reach[j] and _parts_near(pairs, positions, k, j, stretch):
                if total < len(found):
                    found[total, 0], found[total, 1] = k, j
                total += 1
            j -= max(1, int((gap - pairs.reach_below[j]) / spacing))
        near = pairs.reach[k] + pairs.reach[0] + stretch
        if pairs.shaft[k] and _shaft_distance(pairs.shaft_start, positions, k) <= near:
            if total < len(found):
                found[total, 0], found[total, 1] = k, 0
            total += 1
    return total


@njit(cache=True, nogil=True)
def _parts_near(pairs, positions, k, j, stretch):  # type: ignore[no-untyped-def]
    """Returns whether the balls about two parts that are asked about, one of disk k and one of disk j, overlap."""
    last = len(positions) - 1
    for i in range(2):
        for h in range(2):
            one, other = 2 * (last - k) + i, 2 * (last - j) + h
            if not pairs.allowed[one, other]:
                continue
            square = 0.0
            for a in range(3):
                # Part 0 of a disk is the disk itself, part 1 the gap before it.
                p = positions[k, a] if i == 0 else 0.5 * (positions[k, a] + positions[k - 1, a])
                q = positions[j, a] if h == 0 else 0.5 * (positions[j, a] + positions[j - 1, a])
                square += (p - q) ** 2
            # A tenth more, since a gap's tendons stand out farther on the outer side of a bend.
            if math.sqrt(square) <= 1.1 * (pairs.radius[one] + pairs.radius[other]) + stretch:
                return True
    return False


@njit(cache=True, nogil=True, inline="always")
def _distance(p, q):  # type: ignore[no-untyped-def]
    return math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@njit(cache=True, nogil=True)
def _shaft_distance(start, positions, k):  # type: ignore[no-untyped-def]
    """Returns the distance of disk k's centre from the shaft's axis, m."""
    square, along = 0.0, 0.0
    for a in range(3):
        edge = positions[0, a] - start[a]
        square += edge * edge
        along += edge * (positions[k, a] - start[a])
    t = min(1.0, max(0.0, along / square)) if square > 0.0 else 0.0
    total = 0.0
    for a in range(3):
        total += (positions[k, a] - start[a] - t * (positions[0, a] - start[a])) ** 2
    return math.sqrt(total)
