"""The room of a body's parts: an estimate of how far each is from the walls, negative inside of them, and where.

It guides what moves colliding shapes to where they are free. Nothing rests on it: a state counts as free only when
`CollisionScene.check` says so.
"""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.body import across, part_ball, place_solid
from tdcr_planner.collision.room import signed_at
from tdcr_planner.compiled import njit

RIM = 8  # points of a rim
SPACING = 0.6  # of balls along a sleeve, in its radii: 5 % of the radius is what they miss between them at most
SLOPE_M = 2e-5  # way over which the slope of the distance is taken: far below the gaps of narrow places
HELD = 8  # numbers that say where a part has its room: station, share, offset in the disk's frame, slope


@njit(cache=True, nogil=True)
def _lowered(field, wall, side, split, fine, x, y, z, radius, room, spot):  # type: ignore[no-untyped-def]
    """Returns the least of `room` and the room of a ball about a point, which is written into `spot` if it is less."""
    value = signed_at(field, wall, side, split, fine, x, y, z) - radius
    if value >= room:
        return room
    spot[0], spot[1], spot[2] = x, y, z
    return value


@njit(cache=True, nogil=True)
def _rim_room(field, wall, side, split, fine, centre, axis, first, second, shift, radius, room, spot):  # type: ignore[no-untyped-def]
    """Returns the least of `room` and the distances at points on a circle about a solid's axis."""
    for k in range(RIM):
        angle = 2.0 * math.pi * k / RIM
        cosine, sine = radius * math.cos(angle), radius * math.sin(angle)
        x = centre[0] + shift * axis[0] + cosine * first[0] + sine * second[0]
        y = centre[1] + shift * axis[1] + cosine * first[1] + sine * second[1]
        z = centre[2] + shift * axis[2] + cosine * first[2] + sine * second[2]
        room = _lowered(field, wall, side, split, fine, x, y, z, 0.0, room, spot)
    return room


@njit(cache=True, nogil=True)
def _solid_room(field, wall, side, split, fine, body, index, positions, rotations, centre, axis, room, spot):  # type: ignore[no-untyped-def]  # fmt: skip
    """Returns the least of `room` and a solid's: balls along a sleeve, the middle of a capsule, the rims of the rest.

    Balls err by the square of their spacing, points of a rim by their spacing where an edge of a wall passes between.
    Where the least is, is written into `spot`, shape (3,).
    """
    half = place_solid(body, index, positions, rotations, centre, axis)
    if half < 0.0:
        return room
    radius, kind = body.radius[index], body.kind[index]
    if body.round_ends[index]:
        return _lowered(field, wall, side, split, fine, centre[0], centre[1], centre[2], radius, room, spot)
    if kind == 3:
        balls = math.ceil(2.0 * half / (SPACING * radius))
        for k in range(balls):
            shift = half * ((2.0 * k + 1.0) / balls - 1.0)
            x, y, z = centre[0] + shift * axis[0], centre[1] + shift * axis[1], centre[2] + shift * axis[2]
            room = _lowered(field, wall, side, split, fine, x, y, z, radius, room, spot)
        return room
    first, second = across(axis)
    # The tip and the shaft lead the way with their front ends; thick disks have two rims.
    if index == 0 or kind == 4:
        room = _rim_room(field, wall, side, split, fine, centre, axis, first, second, half, radius, room, spot)
    if kind == 4:
        return room
    if half > 0.5 * radius:
        room = _rim_room(field, wall, side, split, fine, centre, axis, first, second, half, radius, room, spot)
        return _rim_room(field, wall, side, split, fine, centre, axis, first, second, -half, radius, room, spot)
    return _rim_room(field, wall, side, split, fine, centre, axis, first, second, 0.0, radius, room, spot)


@njit(cache=True, nogil=True)
def _hold(field, wall, side, split, fine, body, part, positions, rotations, spot, held):  # type: ignore[no-untyped-def]
    """Writes by which disks a point of a part moves, and the slope of the distance there, into `held`, shape (8,).

    The point is p = (1 - t) q_(k-1) + t q_k, with q the places of an offset in the frames of the disks beside a gap,
    and t = 1 for a disk and for the shaft.
    """
    first = body.part_first[part]
    k = body.station[first]
    share = 1.0
    if body.kind[first] != 0 and body.kind[first] != 4:
        along, square = 0.0, 0.0
        for a in range(3):
            edge = positions[k, a] - positions[k - 1, a]
            along += (spot[a] - positions[k - 1, a]) * edge
            square += edge * edge
        share = along / max(square, 1e-24)
    held[0], held[1] = k, share
    for b in range(3):
        held[2 + b] = 0.0
    for a in range(3):
        off = spot[a] - positions[k, a]
        if share != 1.0:
            off = spot[a] - positions[k - 1, a] - share * (positions[k, a] - positions[k - 1, a])
        for b in range(3):
            held[2 + b] += rotations[k, a, b] * off
    here = signed_at(field, wall, side, split, fine, spot[0], spot[1], spot[2])
    held[5] = (signed_at(field, wall, side, split, fine, spot[0] + SLOPE_M, spot[1], spot[2]) - here) / SLOPE_M
    held[6] = (signed_at(field, wall, side, split, fine, spot[0], spot[1] + SLOPE_M, spot[2]) - here) / SLOPE_M
    held[7] = (signed_at(field, wall, side, split, fine, spot[0], spot[1], spot[2] + SLOPE_M) - here) / SLOPE_M


@njit(cache=True, nogil=True)
def part_rooms(field, wall, side, split, body, positions, rotations, rooms, held):  # type: ignore[no-untyped-def]
    """Lowers each part's room, shape (n, q), m, to its estimated distance from one mesh, margins taken off.

    Args:
        field: The mesh's `Field`.
        wall: Tree of the mesh's walls.
        side: `Side` of the mesh.
        split: `SplitCells` of the field, added to.
        body: `BodyArrays`, with the margins that are to be kept.
        positions: Disk centres, shape (n, d, 3), m, world frame.
        rotations: world_from_disk, shape (n, d, 3, 3).
        rooms: What is known so far; a part with more room than this is not looked at closely.
        held: Written for the parts whose room is lowered, for `room_slopes`, shape (n, q, HELD); or empty, where that
            is not wanted.
    """
    parts = len(body.part_first) - 1
    centre, axis, spot = np.empty(3), np.empty(3), np.empty(3)
    middle, cover = np.empty(parts), np.empty(parts)
    # A sleeve covers the disks between its gaps, the tip's aside.
    sleeve = parts > 1 and body.kind[body.part_first[1]] == 3
    for row in range(len(positions)):
        place, frame = positions[row], rotations[row]
        # A body of which a whole part is inside of a wall is far from where a closer look would matter.
        fine = True
        for part in range(parts):
            cover[part] = part_ball(body, part, place, frame, centre)
            middle[part] = 0.0
            if cover[part] >= 0.0:
                middle[part] = signed_at(field, wall, side, split, False, centre[0], centre[1], centre[2])
                fine = fine and middle[part] > -cover[part]
        for part in range(parts):
            room = rooms[row, part]
            inside = cover[part] >= 0.0 and middle[part] < -cover[part]
            if cover[part] >= 0.0 and middle[part] - cover[part] >= room:
                continue
            if inside:
                room = middle[part] - cover[part]
                part_ball(body, part, place, frame, spot)
            elif sleeve and part > 0 and body.kind[body.part_first[part]] == 0:
                continue
            else:
                for index in range(body.part_first[part], body.part_first[part + 1]):
                    room = _solid_room(
                        field, wall, side, split, fine, body, index, place, frame, centre, axis, room, spot
                    )
            if room < rooms[row, part]:
                rooms[row, part] = room
                if len(held):
                    closely = fine and not inside
                    _hold(field, wall, side, split, closely, body, part, place, frame, spot, held[row, part])


@njit(cache=True, nogil=True)
def room_slopes(held, lacking, positions, rotations, shifted, turned, slopes):  # type: ignore[no-untyped-def]
    """Writes how the room of parts changes where the disks move, shape (n, s, q), m; zeros where nothing is lacking.

    Args:
        held: Of `part_rooms`, shape (n, q, HELD).
        lacking: Which parts are asked about, shape (n, q).
        positions: Disk centres, shape (n, d, 3), m, world frame.
        rotations: world_from_disk, shape (n, d, 3, 3).
        shifted: Disk centres after each of s small motions, shape (n, s, d, 3), m.
        turned: world_from_disk after them, shape (n, s, d, 3, 3).
        slopes: Written.
    """
    for row in range(len(held)):
        for part in range(held.shape[1]):
            slopes[row, :, part] = 0.0
            if not lacking[row, part]:
                continue
            here = held[row, part]
            k, share = int(here[0]), here[1]
            for move in range(shifted.shape[1]):
                change = 0.0
                for a in range(3):
                    for end in range(2):
                        weight = share if end == 0 else 1.0 - share
                        disk = k - end
                        if weight == 0.0:
                            continue
                        way = shifted[row, move, disk, a] - positions[row, disk, a]
                        for b in range(3):
                            way += (turned[row, move, disk, a, b] - rotations[row, disk, a, b]) * here[2 + b]
                        change += here[5 + a] * weight * way
                slopes[row, move, part] = change
