"""Room: an estimate of a point's distance from the walls, negative inside of them, from distance fields.

It guides what moves colliding shapes to where they are free, see `part_room`. Nothing rests on it. Cells of a field at
walls and in the middle between walls, where a straight line between nodes errs most, are split: the gaps of a narrow
place are no wider than the field's spacing. The triangles nearest to a part's nodes are found when a body first comes
there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import IntArray
from tdcr_planner.collision.containment import Side, entry_depth, is_wrong
from tdcr_planner.collision.field import Field, front
from tdcr_planner.collision.tree import TriangleTree, nearest_triangle, triangle_square_distance
from tdcr_planner.compiled import njit

SPLIT = 3  # parts of a cell's edge
NODES = (SPLIT + 1) ** 3
NEAR = 1.0  # distance from the walls, in cells, up to which cells are split
NEAR_GRID = 4.0  # distance from the box that holds all walls, in cells, up to which its faces' cells are split
KINK = 0.9  # squared slope below which a cell is split: a distance has slope 1 but for kinks
MOST_SPLIT = 16_384  # cells of one field; more than that stay whole


class SplitCells(NamedTuple):
    """The cells of a field that have been split, for compiled code, which adds to them.

    Attributes:
        places: Place in `nearest` of the cell above each node of the field, -1 where it is whole, shape (n,).
        nearest: Place in tree order of the triangle nearest to each node of a split cell, z fastest, -1 where it is
            not known yet, shape (MOST_SPLIT, NODES).
        used: How many cells have been split, shape (1,).
        facing: 1 where the triangles' normals point to the right side, -1 where away from it, 0 without sides.
    """

    places: NDArray[np.int32]
    nearest: NDArray[np.int32]
    used: IntArray
    facing: float


def make_split_cells(field: Field, wall: TriangleTree, side: Side) -> SplitCells:
    """Returns the split cells of a field, none so far."""
    places = np.full(len(field.values), -1, dtype=np.int32)
    nearest = np.empty((MOST_SPLIT, NODES), dtype=np.int32)
    facing = float(_facing(field, wall, side)) if field.rules[0] == 1 else 0.0
    return SplitCells(places, nearest, np.zeros(1, dtype=np.int64), facing)


@njit(cache=True, nogil=True)
def _normal_side(corners, x, y, z):  # type: ignore[no-untyped-def]
    """Returns how a point lies to the plane of a triangle, shape (3, 3): above 0 on the side of its normal."""
    ax, ay, az = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    bx, by, bz = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1], corners[2, 2] - corners[0, 2]
    px, py, pz = x - corners[0, 0], y - corners[0, 1], z - corners[0, 2]
    return px * (ay * bz - az * by) + py * (az * bx - ax * bz) + pz * (ax * by - ay * bx)


@njit(cache=True, nogil=True)
def _facing(field, wall, side):  # type: ignore[no-untyped-def]
    """Returns 1 where most of some nodes near the walls lie on the side that the walls' normals point to, else -1."""
    votes, asked = 0, 0
    stride = max(1, len(field.values) // 4096)
    ny, nz = field.shape[1], field.shape[2]
    for index in range(0, len(field.values), stride):
        x = field.origin[0] + (index // (ny * nz)) * field.spacing
        y = field.origin[1] + (index // nz % ny) * field.spacing
        z = field.origin[2] + (index % nz) * field.spacing
        if abs(field.values[index]) > 4.0 * field.spacing or entry_depth(side, x, y, z) <= 0.0:
            continue
        _, found = nearest_triangle(wall, x, y, z, np.inf)
        votes += 1 if _normal_side(wall.corners[found], x, y, z) * field.values[index] > 0.0 else -1
        asked += 1
        if asked >= 99:
            break
    return 1 if votes >= 0 else -1


@njit(cache=True, nogil=True)
def _fill(wall, nearest, x, y, z, h, ix, iy, iz):  # type: ignore[no-untyped-def]
    """Writes the triangles nearest to those of a part's eight nodes that are not known yet.

    Args:
        wall: Tree of the walls.
        nearest: Triangles nearest to the nodes of a cell, shape (NODES,), -1 where not known.
        x: The cell's lower corner, m.
        y: The corner.
        z: The corner.
        h: Length of the part's edge, m.
        ix: Place of the part in the cell, 0 to SPLIT - 1.
        iy: The place.
        iz: The place.
    """
    count = SPLIT + 1
    triangle = -1
    for corner in range(8):
        jx, jy, jz = ix + (corner >> 2), iy + ((corner >> 1) & 1), iz + (corner & 1)
        place = (jx * count + jy) * count + jz
        if nearest[place] < 0:
            px, py, pz = x + jx * h, y + jy * h, z + jz * h
            bound = np.inf
            if triangle >= 0:
                bound = math.sqrt(triangle_square_distance(px, py, pz, wall.corners[triangle])) * (1.0 + 1e-12)
            _, found = nearest_triangle(wall, px, py, pz, bound)
            nearest[place] = found if found >= 0 else triangle
        triangle = nearest[place]


@njit(cache=True, nogil=True)
def _from_triangles(wall, side, facing, nearest, index, row, column, x, y, z):  # type: ignore[no-untyped-def]
    """Returns a point's distance from the triangles that are nearest to eight nodes about it, negative behind them.

    Unlike a value between the nodes it errs by next to nothing in the middle between walls. The nearest triangle says
    the side, which is right but for walls that meet at less than 90 degrees: good enough for a guide, and far cheaper
    than a winding number.
    """
    best, found, last = np.inf, -1, -1
    for corner in range(8):
        triangle = nearest[index + (corner >> 2) * row + ((corner >> 1) & 1) * column + (corner & 1)]
        if triangle in (last, found):
            continue
        last = triangle
        square = triangle_square_distance(x, y, z, wall.corners[triangle])
        if square < best:
            best, found = square, triangle
    wrong = facing * _normal_side(wall.corners[found], x, y, z) < 0.0
    distance = math.sqrt(best)
    return -distance if wrong and entry_depth(side, x, y, z) > 0.0 else distance


@njit(cache=True, nogil=True)
def _between_nodes(values, index, row, column, fx, fy, fz, sided):  # type: ignore[no-untyped-def]
    """Returns the trilinear value between eight nodes; rows and columns say how far apart they stand in memory."""
    total = 0.0
    for corner in range(8):
        jx, jy, jz = corner >> 2, (corner >> 1) & 1, corner & 1
        value = values[index + jx * row + jy * column + jz]
        weight = (fx if jx else 1.0 - fx) * (fy if jy else 1.0 - fy) * (fz if jz else 1.0 - fz)
        total += weight * (value if sided else abs(value))
    return total


@njit(cache=True, nogil=True)
def _square_slope(field, index, fx, fy, fz):  # type: ignore[no-untyped-def]
    """Returns the squared slope of the trilinear values in a cell, all corners on the right side."""
    row, column = field.shape[1] * field.shape[2], field.shape[2]
    sx, sy, sz = 0.0, 0.0, 0.0
    for corner in range(8):
        jx, jy, jz = corner >> 2, (corner >> 1) & 1, corner & 1
        value = abs(field.values[index + jx * row + jy * column + jz])
        wx, wy, wz = fx if jx else 1.0 - fx, fy if jy else 1.0 - fy, fz if jz else 1.0 - fz
        sx += value * wy * wz * (1.0 if jx else -1.0)
        sy += value * wx * wz * (1.0 if jy else -1.0)
        sz += value * wx * wy * (1.0 if jz else -1.0)
    return (sx * sx + sy * sy + sz * sz) / (field.spacing * field.spacing)


@njit(cache=True, nogil=True)
def _in_grid(field, wall, side, split, fine, sided, x, y, z):  # type: ignore[no-untyped-def]
    """Returns a point's distance inside of the grid: interpolated, or where `fine` from a split cell's triangles."""
    h = field.spacing
    ny, nz = field.shape[1], field.shape[2]
    ux, uy, uz = (x - field.origin[0]) / h, (y - field.origin[1]) / h, (z - field.origin[2]) / h
    ix, iy, iz = int(ux), int(uy), int(uz)
    fx, fy, fz = ux - ix, uy - iy, uz - iz
    index = (ix * ny + iy) * nz + iz
    value = _between_nodes(field.values, index, ny * nz, nz, fx, fy, fz, sided)
    if not fine or (abs(value) > NEAR * h and (value < 0.0 or _square_slope(field, index, fx, fy, fz) > KINK)):
        return value
    if split.places[index] < 0:
        if split.used[0] >= MOST_SPLIT:
            return value
        split.nearest[split.used[0]] = -1
        split.places[index] = split.used[0]
        split.used[0] += 1
    nearest = split.nearest[split.places[index]]
    low_x, low_y, low_z = field.origin[0] + ix * h, field.origin[1] + iy * h, field.origin[2] + iz * h
    ix, iy, iz = min(int(SPLIT * fx), SPLIT - 1), min(int(SPLIT * fy), SPLIT - 1), min(int(SPLIT * fz), SPLIT - 1)
    _fill(wall, nearest, low_x, low_y, low_z, h / SPLIT, ix, iy, iz)
    count = SPLIT + 1
    return _from_triangles(
        wall, side, split.facing, nearest, (ix * count + iy) * count + iz, count * count, count, x, y, z
    )


@njit(cache=True, nogil=True)
def signed_at(field, wall, side, split, fine, x, y, z):  # type: ignore[no-untyped-def]
    """Returns a point's interpolated distance from the walls, m, negative on the wrong side where the field knows it.

    Inside of the grid it is trilinear between the nodes; where `fine`, and a split cell is called for, it is the
    distance from the triangles nearest to the cell's nodes. Outside of it the distance from the box that holds all
    walls is added; behind a cavity's entry plane there is no wrong side. A point that is not finite has no room.
    """
    h = field.spacing
    sided = field.rules[2] == 0 or front(field, x, y, z) > 0.0
    ux, uy, uz = (x - field.origin[0]) / h, (y - field.origin[1]) / h, (z - field.origin[2]) / h
    nx, ny, nz = field.shape[0], field.shape[1], field.shape[2]
    if 0.0 <= ux < nx - 1 and 0.0 <= uy < ny - 1 and 0.0 <= uz < nz - 1:
        return _in_grid(field, wall, side, split, fine, sided, x, y, z)
    if not math.isfinite(x + y + z):
        return -math.inf
    cx = min(max(x, field.lower[0]), field.upper[0])
    cy = min(max(y, field.lower[1]), field.upper[1])
    cz = min(max(z, field.lower[2]), field.upper[2])
    beyond = math.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2)
    value = _in_grid(field, wall, side, split, fine and beyond < NEAR_GRID * h, sided, cx, cy, cz)
    if field.rules[1] == 1 and sided:
        return -abs(value) - beyond
    return math.sqrt(value * value + beyond * beyond)


@njit(cache=True, nogil=True)
def signed_distance(wall, side, x, y, z):  # type: ignore[no-untyped-def]
    """Returns the exact distance of a point from a mesh's walls, m, negative on the wrong side."""
    distance = math.sqrt(nearest_triangle(wall, x, y, z, np.inf)[0])
    return -distance if is_wrong(side, x, y, z) else distance
