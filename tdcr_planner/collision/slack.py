"""Slack: how much more than the required distance the parts of the body keep from the walls, in and between states."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.collision.body import part_ball, place_solid
from tdcr_planner.collision.containment import deepest_point, is_wrong
from tdcr_planner.collision.distance import solid_distance
from tdcr_planner.collision.field import bounds_at, front
from tdcr_planner.collision.first_look import SPARE
from tdcr_planner.collision.first_ways import SLICES, look_at_ways
from tdcr_planner.collision.swept import swept_free
from tdcr_planner.collision.tree import nearest_triangle
from tdcr_planner.compiled import njit

# Points along a ball's way at which its distance is looked up before the way counts as not proved.
LOOKUPS = 48


@dataclass
class SlackRecord:
    """What has been found of the slack of n states.

    Attributes:
        slack: Lower bounds, a table a mesh, shape (meshes, n, q), m, for the q parts of the body.
        exact: Which of them are the slack itself, shape (meshes, n, q).
        apart: Lower bounds on the slack between parts of the body that may touch each other, shape (n,), m.
        apart_exact: Which of them are the slack itself, shape (n,).
    """

    slack: FloatArray
    exact: BoolArray
    apart: FloatArray
    apart_exact: BoolArray

    @classmethod
    def empty(cls, meshes: int, states: int, parts: int) -> SlackRecord:
        """Returns a record of states of which nothing is known but that they are free."""
        shape = (meshes, states, parts)
        return cls(np.zeros(shape), np.zeros(shape, dtype=np.bool_), np.zeros(states), np.zeros(states, dtype=np.bool_))

    def extended(self, states: int) -> SlackRecord:
        """Returns the record with more states at its end."""
        more = SlackRecord.empty(len(self.slack), states, self.slack.shape[2])
        return SlackRecord(
            np.concatenate([self.slack, more.slack], axis=1),
            np.concatenate([self.exact, more.exact], axis=1),
            np.concatenate([self.apart, more.apart]),
            np.concatenate([self.apart_exact, more.apart_exact]),
        )


@njit(cache=True, nogil=True)
def slice_ball(body, part, positions, rotations, slices, index, centre):  # type: ignore[no-untyped-def]
    """Writes the middle of a slice of a part and returns the radius of a ball about it that holds the slice, m.

    A disk is one slice; a gap is cut across its chord into `slices` of one length. The middle is a fixed combination
    of disk centres.

    Args:
        body: `BodyArrays`.
        part: A disk or a gap.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).
        slices: How many slices a gap has.
        index: Which of them.
        centre: Where to write, shape (3,).
    """
    if slices == 1:
        return part_ball(body, part, positions, rotations, centre)
    first = body.part_first[part]
    k = body.station[first]
    along = (index + 0.5) / slices
    square, low, high = 0.0, 0.0, 0.0
    for a in range(3):
        edge = positions[k, a] - positions[k - 1, a]
        centre[a] = positions[k - 1, a] + along * edge
        square += edge * edge
        low += edge * rotations[k - 1, a, 2]
        high += edge * rotations[k, a, 2]
    length = math.sqrt(square)
    half = 0.5 * length / slices
    if body.kind[first] == 3:
        return math.sqrt((half + body.half[first]) ** 2 + body.radius[first] ** 2)
    # As in `part_ball`: a point of a tendon is off the chord by c at most, along it by c times the lean's sine.
    cosine = max(0.0, min(low, high))
    lean = math.sqrt(max(0.0, square - cosine * cosine)) / max(length, 1e-12)
    c = body.part_offset[part]
    return math.sqrt(half * half + c * c + 2.0 * half * lean * c) + body.part_radius[part]


@njit(cache=True, nogil=True)
def _free_radius(field, wall, side, x, y, z, least, enough, exactly):  # type: ignore[no-untyped-def]
    """Returns a radius of a ball about a point that meets no wall and nothing on the wrong side, m; negative for none.

    The point must be on the right side where it lies in front of the entry plane.

    Args:
        field: The mesh's `Field`.
        wall: Tree of the triangles that the body must not touch.
        side: `Side` of the mesh.
        x: The point, m, world frame.
        y: The point.
        z: The point.
        least: A radius below this is of no use, m.
        enough: A radius above this need not be improved, m.
        exactly: Whether to measure the distance where the field's bound is below `least`.
    """
    radius, upper, _ = bounds_at(field, x, y, z, enough)
    if radius < least and upper >= least and exactly:
        radius = math.sqrt(nearest_triangle(wall, x, y, z, enough)[0])
    depth = front(field, x, y, z)
    if depth > 0.0 or -depth >= radius or _foot_right(field, side, x, y, z, -depth):
        return radius
    return -depth


@njit(cache=True, nogil=True)
def _foot_right(field, side, x, y, z, behind):  # type: ignore[no-untyped-def]
    """Returns whether the point of the entry plane's front nearest to a point behind it is on the right side.

    What a ball about the point that meets no wall has in front of the plane is in one piece, so that this decides.
    """
    ahead = behind * (1.0 + 1e-9) + 1e-12
    x, y, z = x + ahead * field.plane[3], y + ahead * field.plane[4], z + ahead * field.plane[5]
    _, _, known = bounds_at(field, x, y, z, 0.0)
    if known == 0:
        return not is_wrong(side, x, y, z)
    return known > 0


@njit(cache=True, nogil=True)
def _way_free(field, wall, side, start, end, radius, ends, frees):  # type: ignore[no-untyped-def]
    """Returns whether a ball that moves straight from start to end, both shape (3,), meets nothing on its way.

    With d the distance from any closed set, d(x)^2 - |x|^2 is concave (it is the least of linear functions), so on a
    way of length l between two points whose distances are a and b, d^2 >= (1 - t) a^2 + t b^2 - t (1 - t) l^2. The way
    is halved where that is below radius^2. Where the way lies in front of the entry plane, so does one of its ends,
    which is on the right side.
    """
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    whole = math.sqrt(dx * dx + dy * dy + dz * dz)
    enough = math.sqrt(radius * radius + 0.25 * whole * whole)
    for place in range(2):
        ends[0, place] = float(place)
        frees[0, place] = _free_radius(
            field, wall, side, start[0] + place * dx, start[1] + place * dy, start[2] + place * dz,
            radius, enough, True,
        )  # fmt: skip
        if frees[0, place] < radius:
            return False
    top, used = 1, 2
    while top > 0:
        top -= 1
        low, high, a, b = ends[top, 0], ends[top, 1], frees[top, 0], frees[top, 1]
        square = ((high - low) * whole) ** 2
        a2, b2 = a * a, b * b
        t = 0.5 if square == 0.0 else min(1.0, max(0.0, 0.5 - 0.5 * (b2 - a2) / square))
        if (1.0 - t) * a2 + t * b2 - t * (1.0 - t) * square >= radius * radius:
            continue
        if used >= LOOKUPS or top + 2 > len(ends):
            return False
        used += 1
        middle = 0.5 * (low + high)
        free = _free_radius(
            field, wall, side, start[0] + middle * dx, start[1] + middle * dy, start[2] + middle * dz,
            radius, math.sqrt(radius * radius + square / 16.0), True,
        )  # fmt: skip
        if free < radius:
            return False
        ends[top, 0], ends[top, 1], frees[top, 0], frees[top, 1] = low, middle, a, free
        ends[top + 1, 0], ends[top + 1, 1], frees[top + 1, 0], frees[top + 1, 1] = middle, high, free, b
        top += 2
    return True


@njit(cache=True, nogil=True)
def _part_way_free(field, wall, side, body, part, kept, positions, rotations, i, j, start, end, ends, frees):  # type: ignore[no-untyped-def]  # fmt: skip
    """Returns whether balls about a part, grown by `kept`, are shown to meet nothing on the straight way from i to j.

    A point of the part is a fixed combination of disk points, so that between the states it is in the ball about the
    combination of the two middles with the larger radius, but for what the points stray from straight lines, which
    `kept` must contain.
    """
    slices = SLICES if body.kind[body.part_first[part]] != 0 else 1
    for index in range(slices):
        radius = slice_ball(body, part, positions[i], rotations[i], slices, index, start)
        radius = max(radius, slice_ball(body, part, positions[j], rotations[j], slices, index, end)) + kept
        if not _way_free(field, wall, side, start, end, radius, ends, frees):
            return False
    return True


@njit(cache=True, nogil=True)
def exact_slack(field, wall, side, body, part, required, positions, rotations, bound):  # type: ignore[no-untyped-def]
    """Returns a part's slack from its distance to the triangles where below `bound`, otherwise `bound`, m; 0 at least.

    Args:
        field: The mesh's `Field`.
        wall: Tree of the triangles that the body must not touch.
        side: `Side` of the mesh.
        body: `BodyArrays` without margins.
        part: The part; the state must be free.
        required: Distance that the part must keep, m.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).
        bound: What is enough to know, m.
    """
    best, kept = bound, required + SPARE
    centre, axis, point = np.empty(3), np.empty(3), np.empty(3)
    for index in range(body.part_first[part], body.part_first[part + 1]):
        half = place_solid(body, index, positions, rotations, centre, axis)
        if half < 0.0:
            continue
        distance = solid_distance(wall, body.round_ends[index], centre, axis, half, body.radius[index], best + kept)
        best = min(best, distance - kept)
        if best > 0.0 and field.rules[1] == 1 and field.rules[2] == 1:
            # A solid that reaches over the entry plane has a point in front, on the right side. Of one behind it, grown
            # by what it keeps, what lies in front is in one piece and meets no wall, so one point decides.
            deepest_point(body, index, centre, axis, half, field.plane[3:], point)
            behind = -front(field, point[0], point[1], point[2])
            if 0.0 < behind < best + kept and not _foot_right(field, side, point[0], point[1], point[2], behind):
                best = min(best, behind - kept)
        if best <= 0.0:
            return 0.0
    return best


@njit(cache=True, nogil=True)
def _disks_of(body, part):  # type: ignore[no-untyped-def]
    """Returns the first and the last disk that a part hangs on; -1 for the shaft.

    The shaft only slides along its own axis: on the way between two states it lies within the longer one of the two.
    """
    first = body.part_first[part]
    k = body.station[first]
    if body.kind[first] == 4:
        return -1, -1
    return (k, k) if body.kind[first] == 0 else (k - 1, k)


@njit(cache=True, nogil=True)
def _slacks_suffice(field, wall, side, body, part, required, positions, rotations, i, j, need, slack, exact):  # type: ignore[no-untyped-def]  # fmt: skip
    """Returns whether a part's slacks in two states add up to `need`, m, measuring them only as far as that takes."""
    for attempt in range(3):
        here, there = (j, i) if attempt == 1 else (i, j)
        if slack[i, part] + slack[j, part] >= need:
            return True
        if exact[here, part]:
            continue
        bound = max(0.5 * need, need - slack[there, part]) if attempt == 0 else need - slack[there, part]
        # The sum of a rounded difference and its part may fall short of the whole by one unit in the last place.
        bound += 1e-9 * need
        found = exact_slack(field, wall, side, body, part, required, positions[here], rotations[here], bound)
        slack[here, part] = max(slack[here, part], found)
        exact[here, part] = found < bound
    return slack[i, part] + slack[j, part] >= need


@njit(cache=True, nogil=True)
def prove_intervals(  # type: ignore[no-untyped-def]
    field,
    wall,
    side,
    body,
    required,
    positions,
    rotations,
    order,
    motion,
    stray,
    exact_below,
    slack,
    exact,
    room,
    moved,
):
    """Finds the intervals between neighbouring free states in which a part may come nearer to a mesh than it must.

    A part is shown to be free in one of three ways. Balls about it are free all along the straight way, with what its
    points stray from straight lines added to the distance that they must keep. Or a cylinder that holds its places in
    both states keeps that distance (`swept`). Or, with a and b its slacks in the two
    states and L the most that a point of it moves, a + b >= L: a point that has moved by p from its place in the first
    state is at most L - p from its place in the second, so that its slack is at least
    max(a - p, b - L + p) >= (a + b - L) / 2 (Schwarzer, Saha and Latombe 2005).

    Args:
        field: The mesh's `Field`.
        wall: Tree of the triangles that the body must not touch.
        side: `Side` of the mesh.
        body: `BodyArrays` without margins.
        required: Distance that each part must keep, shape (q,), m.
        positions: Disk centres of the states, shape (n, d, 3), m, world frame.
        rotations: world_from_disk, shape (n, d, 3, 3).
        order: Indices that put the states in order, shape (n,).
        motion: How far the points of each disk move in each interval of the ordered states, shape (n - 1, d), m.
        stray: How far they stray from straight lines, shape (n - 1, d), m; infinite where that is not known.
        exact_below: Distances are measured for motions up to this, m.
        slack: Lower bounds known, shape (n, q), m; raised here.
        exact: Which of them are the slack itself, shape (n, q); written here.
        room: Shape (n - 1,), m; written where an interval is open: the a + b of the part that leaves it open.
        moved: Shape (n - 1,), m; written likewise: that part's motion. An interval where it is above 0 is left alone.
    """
    parts = len(body.part_first) - 1
    start, end = np.empty(3), np.empty(3)
    ends, frees, work = np.empty((32, 2)), np.empty((32, 2)), np.empty((8, 3))
    left_open = np.empty((len(order) - 1, parts), np.bool_)
    look_at_ways(field, body, required, positions, rotations, order, motion, stray, slack, moved, left_open)
    for row in range(len(order) - 1):
        if moved[row] > 0.0:
            continue
        i, j = order[row], order[row + 1]
        for part in range(parts):
            if not left_open[row, part]:
                continue
            low, high = _disks_of(body, part)
            length = max(motion[row, low], motion[row, high])
            off = max(stray[row, low], stray[row, high])
            kept = required[part] + off + SPARE
            if math.isfinite(off) and (
                _part_way_free(field, wall, side, body, part, kept, positions, rotations, i, j, start, end, ends, frees)
                or swept_free(field, wall, side, body, part, kept, positions, rotations, i, j, work)
            ):
                continue
            if length <= exact_below and _slacks_suffice(
                field, wall, side, body, part, required[part], positions, rotations, i, j, length, slack, exact
            ):
                continue
            room[row], moved[row] = slack[i, part] + slack[j, part], length
            break


@njit(cache=True, nogil=True)
def least_slack(field, wall, side, body, required, positions, rotations, slack):  # type: ignore[no-untyped-def]
    """Lowers `slack`, shape (n,), m, to that of free states in one mesh; what is above it is not measured.

    The arguments are those of `prove_intervals`.
    """
    parts = len(body.part_first) - 1
    centre = np.empty(3)
    for row in range(len(positions)):
        best = slack[row]
        for part in range(parts):
            if best <= 0.0:
                break
            kept = required[part]
            reach = part_ball(body, part, positions[row], rotations[row], centre) + kept + SPARE
            free = -1.0
            if _disks_of(body, part)[0] >= 0:
                x, y, z = centre[0], centre[1], centre[2]
                free = _free_radius(field, wall, side, x, y, z, reach + best, reach + best, False)
            if free < reach + best:
                best = exact_slack(field, wall, side, body, part, kept, positions[row], rotations[row], best)
        slack[row] = best


@njit(cache=True, nogil=True)
def part_distance(wall, body, part, positions, rotations, bound):  # type: ignore[no-untyped-def]
    """Returns a part's distance from the walls where below `bound`, otherwise `bound`, m; 0 where they meet."""
    best = bound
    centre, axis = np.empty(3), np.empty(3)
    for index in range(body.part_first[part], body.part_first[part + 1]):
        half = place_solid(body, index, positions, rotations, centre, axis)
        if half >= 0.0:
            best = solid_distance(wall, body.round_ends[index], centre, axis, half, body.radius[index], best)
    return best
