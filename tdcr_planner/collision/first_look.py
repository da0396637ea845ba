"""The first look at a state: one node of the field for the ball about each part settles nearly all of them."""

from __future__ import annotations

import math

import numpy as np

from tdcr_planner.collision.field import ROUNDING
from tdcr_planner.compiled import njit

# A part counts as settled only if the bounds hold with this to spare, m: FCL's own answers are this sharp at best.
SPARE = 1e-6


@njit(cache=True, nogil=True)
def look_at_parts(field, body, positions, rotations, left_open):  # type: ignore[no-untyped-def]
    """Writes the parts that one look leaves open; returns their number, or -1 where a part surely is on a wrong side.

    It judges as `settle._ball` does and `body.part_ball` places, with the nearest node alone and in one flat loop:
    handing the arrays to a function for each part costs ten times as much as the sums.

    Args:
        field: The field.
        body: `BodyArrays`.
        positions: Shape (d, 3), m, world frame.
        rotations: Shape (d, 3, 3).
        left_open: Where to write, shape (q,) or more.
    """
    values, origin, plane = field.values, field.origin, field.plane
    lower, upper = field.lower, field.upper
    nx, ny, nz = field.shape[0], field.shape[1], field.shape[2]
    bounded, keep_inside, has_entry = field.rules[0] == 1, field.rules[1] == 1, field.rules[2] == 1
    spacing = field.spacing
    part_first, kind, station = body.part_first, body.kind, body.station
    radius, half, part_radius, part_offset = body.radius, body.half, body.part_radius, body.part_offset
    left = 0
    for part in range(len(part_first) - 1):
        first = part_first[part]
        k, what = station[first], kind[first]
        if what == 4:
            left_open[left] = part
            left += 1
            continue
        x, y, z = positions[k, 0], positions[k, 1], positions[k, 2]
        reach = part_radius[part]
        if what != 0:
            ex, ey, ez = x - positions[k - 1, 0], y - positions[k - 1, 1], z - positions[k - 1, 2]
            x, y, z = x - 0.5 * ex, y - 0.5 * ey, z - 0.5 * ez
            square = ex * ex + ey * ey + ez * ez
            if what == 3:
                reach = math.sqrt((0.5 * math.sqrt(square) + half[first]) ** 2 + radius[first] ** 2)
            else:
                low = ex * rotations[k - 1, 0, 2] + ey * rotations[k - 1, 1, 2] + ez * rotations[k - 1, 2, 2]
                high = ex * rotations[k, 0, 2] + ey * rotations[k, 1, 2] + ez * rotations[k, 2, 2]
                cosine = max(0.0, min(low, high))
                lean = math.sqrt(max(0.0, square - cosine * cosine))
                c = part_offset[part]
                reach += math.sqrt(0.25 * square + c * c + lean * c)
        reach += SPARE
        depth = np.inf
        if has_entry:
            depth = (x - plane[0]) * plane[3] + (y - plane[1]) * plane[4] + (z - plane[2]) * plane[5]
        # A ball whose centre lies behind the entry plane and that reaches over it needs a closer look.
        whole = depth > 0.0 or -depth >= reach
        ux, uy, uz = (x - origin[0]) / spacing, (y - origin[1]) / spacing, (z - origin[2]) / spacing
        if 0.0 <= ux < nx - 1 and 0.0 <= uy < ny - 1 and 0.0 <= uz < nz - 1:
            ix, iy, iz = int(ux + 0.5), int(uy + 0.5), int(uz + 0.5)
            value = values[(ix * ny + iy) * nz + iz]
            ax, ay, az = (ux - ix) * spacing, (uy - iy) * spacing, (uz - iz) * spacing
            square = ax * ax + ay * ay + az * az
            distance = abs(value) * (1.0 - ROUNDING)
            right = True
            if bounded and depth > 0.0:
                node = depth
                if has_entry:
                    node -= ax * plane[3] + ay * plane[4] + az * plane[5]
                # Without a wall between them and both in front of the plane, point and node are on the same side.
                if value < 0.0 and node > 0.0 and distance * distance > square:
                    return -1
                right = value > 0.0 and node > 0.0
            beyond = distance - reach
            if right and whole and beyond > 0.0 and beyond * beyond > square:
                continue
        elif not (keep_inside and depth > 0.0) and whole:
            dx = x - min(max(x, lower[0]), upper[0])
            dy = y - min(max(y, lower[1]), upper[1])
            dz = z - min(max(z, lower[2]), upper[2])
            if dx * dx + dy * dy + dz * dz > reach * reach:
                continue
        left_open[left] = part
        left += 1
    return left
