"""Self slack: how far apart the parts of one body that could touch each other stay, as lower bounds."""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.body import part_ball, place_solid
from tdcr_planner.collision.self_contact import near_pairs
from tdcr_planner.compiled import njit

# Rounds of alternating projection, and the gap between its distance and the bound at which it ends, m.
PROJECTIONS = 40
SHARP = 1e-6


@njit(cache=True, nogil=True)
def _extent(nx, ny, nz, axis, half, radius, round_ends):  # type: ignore[no-untyped-def]
    """Returns how far a solid reaches from its centre along a unit direction, m."""
    along = abs(nx * axis[0] + ny * axis[1] + nz * axis[2])
    if round_ends:
        return half * along + radius
    return half * along + radius * math.sqrt(max(0.0, 1.0 - along * along))


@njit(cache=True, nogil=True)
def _project(point, centre, axis, half, radius, round_ends, found):  # type: ignore[no-untyped-def]
    """Writes the point of a solid that is nearest to a point, shape (3,), m."""
    along = 0.0
    for a in range(3):
        along += (point[a] - centre[a]) * axis[a]
    z = min(half, max(-half, along))
    # From the core's end for a capsule, from the axis at right angles for a cylinder.
    foot = z if round_ends else along
    square = 0.0
    for a in range(3):
        found[a] = point[a] - centre[a] - foot * axis[a]
        square += found[a] * found[a]
    shrink = min(1.0, radius / math.sqrt(square)) if square > 0.0 else 0.0
    for a in range(3):
        found[a] = centre[a] + z * axis[a] + shrink * found[a]


@njit(cache=True, nogil=True)
def solids_apart(body, one, other, positions, rotations, enough):  # type: ignore[no-untyped-def]
    """Returns a lower bound on the distance of two solids, m; 0 where they may meet.

    For any unit direction n the gap between the two along n bounds their distance from below. The direction comes from
    the nearest points, found by alternating projection (Cheney and Goldstein 1959), so that the bound is sharp.

    Args:
        body: `BodyArrays`.
        one: A solid.
        other: Another solid.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).
        enough: A bound of this need not be improved, m.
    """
    centre_a, axis_a, centre_b, axis_b = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    half_a = place_solid(body, one, positions, rotations, centre_a, axis_a)
    half_b = place_solid(body, other, positions, rotations, centre_b, axis_b)
    if half_a < 0.0 or half_b < 0.0:
        return np.inf
    p, q = centre_a.copy(), centre_b.copy()
    best = 0.0
    for _ in range(PROJECTIONS):
        nx, ny, nz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        distance = math.sqrt(nx * nx + ny * ny + nz * nz)
        if distance <= SHARP:
            break
        nx, ny, nz = nx / distance, ny / distance, nz / distance
        gap = nx * (centre_a[0] - centre_b[0]) + ny * (centre_a[1] - centre_b[1]) + nz * (centre_a[2] - centre_b[2])
        gap -= _extent(nx, ny, nz, axis_a, half_a, body.radius[one], body.round_ends[one])
        gap -= _extent(nx, ny, nz, axis_b, half_b, body.radius[other], body.round_ends[other])
        best = max(best, gap)
        if best >= enough or distance - best <= SHARP:
            break
        _project(q, centre_a, axis_a, half_a, body.radius[one], body.round_ends[one], p)
        _project(p, centre_b, axis_b, half_b, body.radius[other], body.round_ends[other], q)
    return best


@njit(cache=True, nogil=True)
def self_slack(pairs, body, positions, rotations, bound):  # type: ignore[no-untyped-def]
    """Returns how far apart the pairs of parts that may touch are at least, where below `bound`, otherwise `bound`, m.

    Args:
        pairs: `SelfPairs` of the body.
        body: `BodyArrays`, with its margins.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).
        bound: What is enough to know, m.
    """
    count = near_pairs(pairs, positions, bound, np.empty((0, 2), np.int64))
    if count == 0:
        return bound
    found = np.empty((count, 2), np.int64)
    near_pairs(pairs, positions, bound, found)
    best, last, first = bound, len(positions) - 1, body.part_first
    centre, other_centre = np.empty(3), np.empty(3)
    for row in range(count):
        k, j = found[row, 0], found[row, 1]
        for i in range(2):
            for h in range(2 if j > 0 else 1):
                one = 2 * (last - k) + i
                other = 2 * (last - j) + h if j > 0 else len(first) - 2
                if not pairs.allowed[one, other]:
                    continue
                reach = part_ball(body, one, positions, rotations, centre)
                reach += part_ball(body, other, positions, rotations, other_centre)
                if j > 0 and math.sqrt(((centre - other_centre) ** 2).sum()) - reach >= best:
                    continue
                for a in range(first[one], first[one + 1]):
                    for b in range(first[other], first[other + 1]):
                        best = min(best, solids_apart(body, a, b, positions, rotations, best))
                        if best <= 0.0:
                            return 0.0
    return best


@njit(cache=True, nogil=True)
def prove_apart(pairs, body, positions, rotations, order, motion, apart, exact, room, moved):  # type: ignore[no-untyped-def]
    """Finds the intervals between neighbouring free states in which the body may touch itself.

    Two parts that move by L each between two states in which they are a and b apart stay (a + b) / 2 - L apart. What
    all of them move alike with the base, in a straight line, does not count.

    Args:
        pairs: `SelfPairs` of the body.
        body: `BodyArrays`, with its margins.
        positions: Disk centres of the states, shape (n, d, 3), m, world frame.
        rotations: world_from_disk, shape (n, d, 3, 3).
        order: Indices that put the states in order, shape (n,).
        motion: Bound on each disk's motion in each interval of the ordered states, shape (n - 1, d), m.
        apart: Lower bounds known, shape (n,), m; raised here.
        exact: Which of them cannot be raised, shape (n,); written here.
        room: Shape (n - 1,), m; written where an interval is open: how far the parts may move.
        moved: Shape (n - 1,), m; written likewise: how far they move. An interval where it is above 0 is left alone.
    """
    for row in range(len(order) - 1):
        if moved[row] > 0.0:
            continue
        i, j = order[row], order[row + 1]
        length = 0.0
        for k in range(1, positions.shape[1]):
            shift, own = 0.0, 0.0
            for a in range(3):
                step = positions[j, k, a] - positions[i, k, a]
                shift += step * step
                own += (step - positions[j, 0, a] + positions[i, 0, a]) ** 2
            length = max(length, motion[row, k] - math.sqrt(shift) + math.sqrt(own))
        for attempt in range(3):
            here, there = (j, i) if attempt == 1 else (i, j)
            if apart[i] + apart[j] >= 2.0 * length:
                break
            if exact[here]:
                continue
            bound = max(length, 2.0 * length - apart[there]) if attempt == 0 else 2.0 * length - apart[there]
            found = self_slack(pairs, body, positions[here], rotations[here], bound)
            apart[here] = max(apart[here], found)
            exact[here] = found < bound
        if apart[i] + apart[j] < 2.0 * length:
            room[row], moved[row] = 0.5 * (apart[i] + apart[j]), length
