"""What the distance field settles about a state without FCL: parts that are surely free and bodies that surely hit."""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.body import across, part_ball, place_solid
from tdcr_planner.collision.containment import deepest_point
from tdcr_planner.collision.distance import solid_distance
from tdcr_planner.collision.field import bounds_at, front
from tdcr_planner.collision.first_look import SPARE, look_at_parts
from tdcr_planner.collision.self_contact import near_pairs
from tdcr_planner.compiled import njit

# CLEAR: touches no wall, but the field does not know its side.
FREE, HIT, OPEN, CLEAR = 0, 1, 2, 3
# Balls tried for one solid before its exact distance is computed, which costs about as much.
BALLS = 16


@njit(cache=True, nogil=True)
def _ball(field, x, y, z, radius, inscribed):  # type: ignore[no-untyped-def]
    """Judges a ball that covers a piece of a solid about a point of it.

    Args:
        field: The field.
        x: The centre, a point of the solid, m, world frame.
        y: The centre.
        z: The centre.
        radius: The ball holds the piece.
        inscribed: A ball of this radius about the centre lies inside the solid, m.

    Returns:
        FREE, HIT or OPEN, and the lower bound on the centre's distance, m.
    """
    lower, upper, side = bounds_at(field, x, y, z, radius + SPARE)
    if side < 0 or upper < inscribed - SPARE:
        return HIT, lower
    if lower <= radius + SPARE or side == 0:
        return OPEN, lower
    depth = front(field, x, y, z)
    if depth > 0.0 or -depth >= radius:
        return FREE, lower
    # The centre is behind the entry plane and the ball reaches over it. What it has in front is in one piece and
    # meets no wall, so the point of it nearest to the centre decides.
    ahead = (-depth) * (1.0 + 1e-9) + 1e-12
    p = field.plane
    _, _, other = bounds_at(field, x + ahead * p[3], y + ahead * p[4], z + ahead * p[5], 0.0)
    return (FREE if other > 0 else OPEN), lower


@njit(cache=True, nogil=True)
def _settle_capsule(field, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Judges a capsule by balls along its core, halving where a ball leaves it open."""
    middle = np.empty(BALLS + 2)
    reach = np.empty(BALLS + 2)
    middle[0], reach[0] = 0.0, half
    top, used, answer = 1, 0, FREE
    while top > 0:
        top -= 1
        at, extent = middle[top], reach[top]
        result, lower = _ball(
            field, centre[0] + at * axis[0], centre[1] + at * axis[1], centre[2] + at * axis[2], extent + radius, radius
        )
        used += 1
        if result == HIT:
            return HIT
        if result == FREE or answer == OPEN:
            continue
        if lower <= radius or used + top >= BALLS:
            answer = OPEN
            continue
        middle[top], reach[top] = at - 0.5 * extent, 0.5 * extent
        middle[top + 1], reach[top + 1] = at + 0.5 * extent, 0.5 * extent
        top += 2
    return answer


@njit(cache=True, nogil=True)
def _settle_cylinder(field, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Judges a cylinder: a ball about its middle, then balls about the pieces of the ring that this one leaves open.

    A ball of radius b about the middle holds all of the cylinder within sqrt(b^2 - half^2) of its axis. Pieces of the
    rest are cells in cylinder coordinates, split along their longest side while that can help.
    """
    result, lower = _ball(
        field, centre[0], centre[1], centre[2], math.sqrt(radius * radius + half * half), min(radius, half)
    )
    if result != OPEN or lower <= 0.0:
        return result
    inner = 0.0
    first, second = across(axis)
    # r low, r high, angle, half angle, z, half z
    cells = np.empty((BALLS + 8, 6))
    if lower - 2.0 * SPARE > half and front(field, centre[0], centre[1], centre[2]) > 0.0:
        inner = math.sqrt((lower - 2.0 * SPARE) ** 2 - half * half)
        _, _, side = bounds_at(field, centre[0], centre[1], centre[2], 0.0)
        if side <= 0:
            inner = 0.0
    top = 6
    for k in range(top):
        cells[k, 0], cells[k, 1] = min(inner, 0.99 * radius), radius
        cells[k, 2], cells[k, 3] = (k + 0.5) * math.pi / 3.0, math.pi / 6.0
        cells[k, 4], cells[k, 5] = 0.0, half
    used, answer = 0, FREE
    while top > 0:
        top -= 1
        low, high, angle = cells[top, 0], cells[top, 1], cells[top, 2]
        turn, z, tall = cells[top, 3], cells[top, 4], cells[top, 5]
        r = 0.5 * (low + high)
        far = high * high + r * r - 2.0 * high * r * math.cos(turn)
        near = low * low + r * r - 2.0 * low * r * math.cos(turn)
        cover = math.sqrt(max(far, near) + tall * tall)
        cosine, sine = r * math.cos(angle), r * math.sin(angle)
        result, lower = _ball(
            field,
            centre[0] + cosine * first[0] + sine * second[0] + z * axis[0],
            centre[1] + cosine * first[1] + sine * second[1] + z * axis[1],
            centre[2] + cosine * first[2] + sine * second[2] + z * axis[2],
            cover,
            min(radius - r, half - abs(z)),
        )
        used += 1
        if result == HIT:
            return HIT
        if result == FREE or answer == OPEN:
            continue
        if lower <= 0.0 or used + top >= BALLS:
            answer = OPEN
            continue
        wide, broad = 2.0 * r * turn, high - low
        for a in range(6):
            cells[top + 1, a] = cells[top, a]
        if wide >= broad and wide >= 2.0 * tall:
            cells[top, 2], cells[top, 3] = angle - 0.5 * turn, 0.5 * turn
            cells[top + 1, 2], cells[top + 1, 3] = angle + 0.5 * turn, 0.5 * turn
        elif broad >= 2.0 * tall:
            cells[top, 1], cells[top + 1, 0] = r, r
        else:
            cells[top, 4], cells[top, 5] = z - 0.5 * tall, 0.5 * tall
            cells[top + 1, 4], cells[top + 1, 5] = z + 0.5 * tall, 0.5 * tall
        top += 2
    return answer


@njit(cache=True, nogil=True)
def _settle_rod(field, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Judges a cylinder that is longer than wide as a stack of cylinders that are not."""
    slices = math.ceil(half / radius)
    answer = FREE
    piece = np.empty(3)
    for k in range(slices):
        shift = half * ((2.0 * k + 1.0) / slices - 1.0)
        for a in range(3):
            piece[a] = centre[a] + shift * axis[a]
        result = _settle_cylinder(field, piece, axis, half / slices, radius)
        if result == HIT:
            return HIT
        if result == OPEN:
            answer = OPEN
    return answer


@njit(cache=True, nogil=True)
def _settle_exactly(wall, round_ends, centre, axis, half, radius):  # type: ignore[no-untyped-def]
    """Judges a solid by its exact distance from the triangles near it, and again shrunk by SPARE.

    A solid farther than SPARE from the walls touches none of them, and one whose shrunk self meets them surely hits.
    """
    if solid_distance(wall, round_ends, centre, axis, half, radius, 2.0 * SPARE) >= SPARE:
        return CLEAR
    thin = half if round_ends else half - SPARE
    if solid_distance(wall, round_ends, centre, axis, thin, radius - SPARE, SPARE) <= 0.0:
        return HIT
    return OPEN


@njit(cache=True, nogil=True)
def _side_of_clear(field, body, index, centre, axis, half):  # type: ignore[no-untyped-def]
    """Judges the side of a solid that touches no wall by one point of it, as far as the field knows that point's side.

    What such a solid has in front of the entry plane is in one piece, so any point of it there decides.
    """
    point = centre
    if front(field, centre[0], centre[1], centre[2]) <= 0.0:
        point = np.empty(3)
        deepest_point(body, index, centre, axis, half, field.plane[3:], point)
        if front(field, point[0], point[1], point[2]) <= 0.0:
            return FREE
    _, _, side = bounds_at(field, point[0], point[1], point[2], 0.0)
    if side == 0:
        return CLEAR
    return FREE if side > 0 else HIT


@njit(cache=True, nogil=True)
def _settle_parts(field, body, positions, rotations, parts_open, left):  # type: ignore[no-untyped-def]
    """Keeps of the open parts those that all corners about their middle leave open; returns how many, -1 for a hit."""
    centre = np.empty(3)
    kept = 0
    for i in range(left):
        part = parts_open[i]
        reach = part_ball(body, part, positions, rotations, centre)
        result = OPEN
        if reach >= 0.0:
            first = body.part_first[part]
            inscribed = body.radius[first] if body.kind[first] != 0 else min(body.radius[first], body.half[first])
            if body.kind[first] == 3:
                inscribed = 0.0
            result, _ = _ball(field, centre[0], centre[1], centre[2], reach, inscribed)
            if result == HIT:
                return -1
        if result == OPEN:
            parts_open[kept] = part
            kept += 1
    return kept


@njit(cache=True, nogil=True)
def _settle_state(field, wall, body, positions, rotations, undecided, parts_open):  # type: ignore[no-untyped-def]
    """Judges one state and one mesh; marks the solids left to FCL in `undecided`, shape (m,).

    Returns:
        FREE, HIT, or OPEN where solids are left to FCL, or CLEAR where none touches but the side is not known.
    """
    # Plain hits are found before any closer look is paid for.
    left = look_at_parts(field, body, positions, rotations, parts_open)
    if left > 0:
        left = _settle_parts(field, body, positions, rotations, parts_open, left)
    if left <= 0:
        return FREE if left == 0 else HIT
    centre, axis = np.empty(3), np.empty(3)
    answer = FREE
    for i in range(left):
        part = parts_open[i]
        for index in range(body.part_first[part], body.part_first[part + 1]):
            half = place_solid(body, index, positions, rotations, centre, axis)
            if half < 0.0:
                continue
            radius = body.radius[index]
            if body.round_ends[index]:
                result = _settle_capsule(field, centre, axis, half, radius)
            elif half > radius:
                result = _settle_rod(field, centre, axis, half, radius)
            else:
                result = _settle_cylinder(field, centre, axis, half, radius)
            if result == OPEN:
                result = _settle_exactly(wall, body.round_ends[index], centre, axis, half, radius)
                if result == CLEAR:
                    result = _side_of_clear(field, body, index, centre, axis, half)
            if result == HIT:
                return HIT
            if result == OPEN:
                undecided[index] = True
                answer = OPEN
            elif result == CLEAR and answer == FREE:
                answer = CLEAR
    return answer


@njit(cache=True, nogil=True)
def settle_batch(field, wall, verdict, body, positions, rotations, codes, undecided, open_rows, stop):  # type: ignore[no-untyped-def]
    """Settles what the field of one mesh can about a batch; rows whose code is not 0 are left alone.

    Args:
        field: The mesh's field.
        wall: The tree of the mesh's walls.
        verdict: Code to write into the rows that surely hit.
        body: `BodyArrays`.
        positions: Shape (n, d, 3), m, world frame.
        rotations: Shape (n, d, 3, 3).
        codes: Shape (n,), int8.
        undecided: Shape (n, m), false before; set true for the solids that FCL must decide.
        open_rows: Shape (n,), bool, written: the rows that are not settled. Where none of their undecided solids
            touches, the side is still to be found.
        stop: Whether to leave the rows after the first hit as they are.

    Returns:
        The number of open rows.
    """
    parts_open = np.empty(len(body.part_first), np.int64)
    total = 0
    open_rows[:] = False
    for row in range(len(positions)):
        if codes[row] != 0:
            continue
        result = _settle_state(field, wall, body, positions[row], rotations[row], undecided[row], parts_open)
        if result == HIT:
            codes[row] = verdict
            if stop:
                break
        elif result != FREE:
            open_rows[row] = True
            total += 1
    return total


@njit(cache=True, nogil=True)
def screen(pairs, positions, rotations, undefined, codes, near):  # type: ignore[no-untyped-def]
    """Starts the codes of a batch: `undefined` where a pose is not finite, else 0; marks rows near self-contact.

    Args:
        pairs: `SelfPairs`.
        positions: Shape (n, d, 3), m.
        rotations: Shape (n, d, 3, 3).
        undefined: The code for a pose that is not finite.
        codes: Shape (n,), int8, written.
        near: Shape (n,), bool, written.

    Returns:
        The number of rows near self-contact.
    """
    none = np.empty((0, 2), np.int64)
    total = 0
    disks = positions.shape[1]
    for row in range(len(positions)):
        # A sum is finite only if every term is.
        value = 0.0
        for k in range(disks):
            for a in range(3):
                value += positions[row, k, a]
                for b in range(3):
                    value += rotations[row, k, a, b]
        codes[row] = 0 if math.isfinite(value) else undefined
        near[row] = codes[row] == 0 and near_pairs(pairs, positions[row], 0.0, none) > 0
        total += near[row]
    return total
