"""The first pass over intervals: one flat loop shows most parts to be free on their way between two states."""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.field import ROUNDING
from tdcr_planner.collision.first_look import SPARE
from tdcr_planner.compiled import njit

# Length of a piece of a ball's way over the ball's radius, and the most pieces of a way.
PIECE, MOST_PIECES = 0.6, 8
# Balls along a gap, where one is too coarse.
SLICES = 3


@njit(cache=True, nogil=True)
def look_at_ways(field, body, required, positions, rotations, order, motion, stray, slack, moved, left_open):  # type: ignore[no-untyped-def]  # fmt: skip
    """Marks the parts that one look leaves open in each interval between neighbouring free states.

    It judges as `slack._way_free` does a ball about each part, by a few points of its way and in one flat loop: handing
    the arrays to a function for each point costs ten times as much as the sums.

    Where there is room no point of a way is looked up: its ball is in a larger one, about the same part or the one
    before it in a state looked at earlier, that meets no wall and lies behind the entry plane if its middle does. The
    middle of that larger ball is the middle of a part of a free state, so what the ball has in front of the plane is on
    the right side.

    Args:
        field: The mesh's `Field`.
        body: `BodyArrays` without margins.
        required: Distance that each part must keep, shape (q,), m.
        positions: Disk centres of the states, shape (n, d, 3), m, world frame.
        rotations: world_from_disk, shape (n, d, 3, 3).
        order: Indices that put the states in order, shape (n,).
        motion: How far the points of each disk move in each interval of the ordered states, shape (n - 1, d), m.
        stray: How far they stray from straight lines, shape (n - 1, d), m; infinite where that is not known.
        slack: Lower bounds on the slack of the states, shape (n, q), m.
        moved: Intervals where it is above 0 are left alone, shape (n - 1,).
        left_open: Written, shape (n - 1, q).
    """
    values, origin, plane = field.values, field.origin, field.plane
    box_low, box_high = field.lower, field.upper
    nx, ny, nz = field.shape[0], field.shape[1], field.shape[2]
    keep_inside, has_entry = field.rules[1] == 1, field.rules[2] == 1
    h = field.spacing
    part_first, kind, station = body.part_first, body.kind, body.station
    radii, halves, part_radius, part_offset = body.radius, body.half, body.part_radius, body.part_offset
    place = np.empty((2, 3))
    # Middle and radius of a ball for each part that is known to be free.
    room = np.full((len(part_first) - 1, 4), -1.0)
    for row in range(len(order) - 1):
        if moved[row] > 0.0:
            continue
        for part in range(len(part_first) - 1):
            left_open[row, part] = False
            first = part_first[part]
            k, what = station[first], kind[first]
            if what == 4:
                # The shaft slides along its own axis: on the way it lies within the longer one of the two.
                continue
            low = k if what == 0 else k - 1
            if slack[order[row], part] + slack[order[row + 1], part] >= max(motion[row, low], motion[row, k]):
                continue
            left_open[row, part] = True
            kept = max(stray[row, low], stray[row, k]) + required[part] + SPARE
            if not math.isfinite(kept):
                continue
            # One ball for the part; for a gap where that does not do, one for each of its slices.
            for slices in range(1, 2 if what == 0 else SLICES + 1, SLICES - 1):
                free = True
                for index in range(slices):
                    along = 1.0 - (index + 0.5) / slices
                    ball = 0.0
                    for end in range(2):
                        state = order[row + end]
                        x, y, z = positions[state, k, 0], positions[state, k, 1], positions[state, k, 2]
                        reach = part_radius[part]
                        if what != 0:
                            ex = x - positions[state, low, 0]
                            ey = y - positions[state, low, 1]
                            ez = z - positions[state, low, 2]
                            x, y, z = x - along * ex, y - along * ey, z - along * ez
                            square = ex * ex + ey * ey + ez * ez
                            half = 0.5 * math.sqrt(square) / slices
                            if what == 3:
                                reach = math.sqrt((half + halves[first]) ** 2 + radii[first] ** 2)
                            else:
                                below, above = 0.0, 0.0
                                for a, e in enumerate((ex, ey, ez)):
                                    below += e * rotations[state, low, a, 2]
                                    above += e * rotations[state, k, a, 2]
                                cosine = max(0.0, min(below, above))
                                lean = math.sqrt(max(0.0, square - cosine * cosine))
                                c = part_offset[part]
                                reach += math.sqrt(half * half + c * c + lean * c / slices)
                        place[end, 0], place[end, 1], place[end, 2] = x, y, z
                        ball = max(ball, reach + kept)
                    inside = False
                    for near in range(max(0, part - 1), part + 1):
                        spare = room[near, 3] - ball
                        if spare <= 0.0:
                            continue
                        farthest = 0.0
                        for end in range(2):
                            square = 0.0
                            for a in range(3):
                                square += (place[end, a] - room[near, a]) ** 2
                            farthest = max(farthest, square)
                        inside = inside or farthest <= spare * spare
                    if inside:
                        continue
                    dx, dy, dz = place[1, 0] - place[0, 0], place[1, 1] - place[0, 1], place[1, 2] - place[0, 2]
                    whole = math.sqrt(dx * dx + dy * dy + dz * dz)
                    pieces = max(1, min(MOST_PIECES, math.ceil(whole / (PIECE * ball))))
                    piece = (whole / pieces) ** 2
                    enough = math.sqrt(ball * ball + 0.25 * piece)
                    before = 0.0
                    for point in range(pieces + 1):
                        t = point / pieces
                        x, y, z = place[0, 0] + t * dx, place[0, 1] + t * dy, place[0, 2] + t * dz
                        depth = np.inf
                        if has_entry:
                            depth = (x - plane[0]) * plane[3] + (y - plane[1]) * plane[4] + (z - plane[2]) * plane[5]
                        ux, uy, uz = (x - origin[0]) / h, (y - origin[1]) / h, (z - origin[2]) / h
                        radius = 0.0
                        if 0.0 <= ux < nx - 1 and 0.0 <= uy < ny - 1 and 0.0 <= uz < nz - 1:
                            ix, iy, iz = int(ux + 0.5), int(uy + 0.5), int(uz + 0.5)
                            value = abs(values[(ix * ny + iy) * nz + iz]) * (1.0 - ROUNDING)
                            radius = value - h * math.sqrt((ux - ix) ** 2 + (uy - iy) ** 2 + (uz - iz) ** 2)
                            if radius < enough:
                                ix, iy, iz = int(ux), int(uy), int(uz)
                                fx, fy, fz = ux - ix, uy - iy, uz - iz
                                mean = 0.0
                                for corner in range(8):
                                    jx, jy, jz = corner & 1, (corner >> 1) & 1, corner >> 2
                                    value = abs(values[((ix + jx) * ny + iy + jy) * nz + iz + jz]) * (1.0 - ROUNDING)
                                    weight = (
                                        (fx if jx else 1.0 - fx) * (fy if jy else 1.0 - fy) * (fz if jz else 1.0 - fz)
                                    )
                                    mean += weight * value * value
                                mean -= h * h * (fx * (1.0 - fx) + fy * (1.0 - fy) + fz * (1.0 - fz))
                                radius = max(radius, math.sqrt(max(0.0, mean)))
                        elif not (keep_inside and depth > 0.0):
                            gx = x - min(max(x, box_low[0]), box_high[0])
                            gy = y - min(max(y, box_low[1]), box_high[1])
                            gz = z - min(max(z, box_low[2]), box_high[2])
                            radius = math.sqrt(gx * gx + gy * gy + gz * gz)
                        if depth <= 0.0:
                            radius = min(radius, -depth)
                        if radius < ball:
                            free = False
                            break
                        if point == 0:
                            room[part, 0], room[part, 1], room[part, 2], room[part, 3] = x, y, z, radius
                            if radius >= ball + whole:
                                break
                        else:
                            a2, b2 = before * before, radius * radius
                            s = 0.5 if piece == 0.0 else min(1.0, max(0.0, 0.5 - 0.5 * (b2 - a2) / piece))
                            if (1.0 - s) * a2 + s * b2 - s * (1.0 - s) * piece < ball * ball:
                                free = False
                                break
                        before = radius
                    if not free:
                        break
                if free:
                    left_open[row, part] = False
                    break
