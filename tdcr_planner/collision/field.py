"""The signed distance field of a mesh in its role: distances on a grid, bounds between nodes, and its cache on disk."""

from __future__ import annotations

import hashlib
import logging
import math
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.cache_folder import cache_folder
from tdcr_planner.collision.containment import Side, entry_depth, is_wrong
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.tree import nearest_triangle, triangle_square_distance
from tdcr_planner.compiled import njit
from tdcr_planner.errors import FormatError
from tdcr_planner.files import is_private, read_bytes, write_file_whole

logger = logging.getLogger(__name__)

CELLS = 500_000
# A scene's fields together have at most as many nodes as this many fields of the largest size.
MOST_FIELDS = 8
LEAST_CELLS = 1000
# Part of the cache key: another way of filling the grid must not read what this one wrote.
FORMAT = "tdcr-field/1"
# Nodes are stored in single precision; this share covers its rounding (6e-8) and that of the bounds.
ROUNDING = 1e-6
_told_not_kept: set[Path] = set()  # cache folders that are not used: one warning each


class Field(NamedTuple):
    """Distances on the nodes of a grid around a mesh, for compiled code.

    The value at a node is its distance from the mesh's walls, caps included, negative on the wrong side. Nodes behind
    a cavity's entry plane are positive and say nothing of the side.

    Attributes:
        values: Shape (nx * ny * nz,), m, z fastest.
        shape: Number of nodes along each axis, shape (3,).
        origin: The first node, shape (3,), m, world frame.
        spacing: Distance between nodes, m.
        lower: Lower corner of the mesh's box, shape (3,), m; every wall lies inside of the box.
        upper: Upper corner of the mesh's box, shape (3,), m.
        rules: bounded, keep_inside, has_entry as 0 or 1, shape (3,); see `Side`.
        plane: Entry point and normal, shape (6,).
    """

    values: NDArray[np.float32]
    shape: IntArray
    origin: FloatArray
    spacing: float
    lower: FloatArray
    upper: FloatArray
    rules: IntArray
    plane: FloatArray


def share_nodes(meshes: Sequence[SceneMesh], finest: float, cells: int = CELLS) -> list[int]:
    """Returns about how many nodes the field of each mesh of a scene is to have.

    A field finer than the body's details settles little more, so a small mesh gets few nodes; and all the fields of a
    scene together have no more than a few large ones. Exact distances decide what a coarse field leaves open.

    Args:
        meshes: The meshes of a scene.
        finest: The least spacing that is of use, m.
        cells: Most nodes of one mesh.
    """
    wanted = [min(float(cells), max(float(LEAST_CELLS), _volume(mesh) / finest**3)) for mesh in meshes]
    fraction = min(1.0, MOST_FIELDS * cells / max(sum(wanted), 1.0))
    return [max(LEAST_CELLS, round(fraction * count)) for count in wanted]


def _volume(mesh: SceneMesh) -> float:
    return float(np.prod(_padded(np.ptp(mesh.wall_vertices, axis=0))))


def _padded(extent: FloatArray) -> FloatArray:
    """Returns a box's extent with no axis so short that a flat mesh would get no layers of nodes around it."""
    return np.maximum(extent, extent.max() / 50.0)


def build_field(mesh: SceneMesh, side: Side, cells: int = CELLS, *, keep: bool = True) -> Field:
    """Returns the field of a mesh, from the cache on disk where it is there and intact.

    Args:
        mesh: The mesh in its role.
        side: What decides its right side.
        cells: About how many nodes to use.
        keep: Whether to read and write the cache on disk.
    """
    lower, upper = mesh.wall_vertices.min(axis=0), mesh.wall_vertices.max(axis=0)
    extent = upper - lower
    spacing = float(np.cbrt(np.prod(_padded(extent)) / cells))
    shape = np.ceil(extent / spacing).astype(np.int64) + 3
    origin = 0.5 * (lower + upper) - 0.5 * (shape - 1) * spacing
    values = (_load_or_fill if keep else _filled)(mesh, side, shape, origin, spacing)
    entry = mesh.entry
    plane = np.zeros(6) if entry is None else np.concatenate([entry.point, entry.normal])
    rules = np.array([mesh.bounded, mesh.keeps_inside, entry is not None], dtype=np.int64)
    return Field(values, shape, origin, spacing, lower, upper, rules, plane)


def _load_or_fill(
    mesh: SceneMesh, side: Side, shape: IntArray, origin: FloatArray, spacing: float
) -> NDArray[np.float32]:
    grid = f"{FORMAT} {mesh.sha256} {shape.tolist()} {[*origin.tolist(), spacing]}"
    folder = cache_folder()
    if folder is None:
        return _filled(mesh, side, shape, origin, spacing)
    file = folder / f"field-{hashlib.sha256(grid.encode()).hexdigest()}.bin"
    count = int(np.prod(shape))
    is_kept = _is_own_folder(file.parent)
    stored = _read_stored(file, count) if is_kept else None
    if stored is not None:
        return stored
    values = _filled(mesh, side, shape, origin, spacing)
    if not is_kept:
        return values
    payload = values.tobytes()
    try:
        with write_file_whole(file) as temporary:
            temporary.write_bytes(hashlib.sha256(payload).digest() + payload)
    except (FormatError, OSError) as error:
        _warn_not_kept(file.parent, str(error))
    return values


def _is_own_folder(folder: Path) -> bool:
    """Whether a cache folder, made where it is missing, is nobody else's: who can write a field can hide a wall."""
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not os.path.isdir(folder) or is_private(folder):
        return True
    _warn_not_kept(folder, "other users can write there; TDCR_CACHE_DIR can name a folder of your own")
    return False


def _warn_not_kept(folder: Path, reason: str) -> None:
    if folder not in _told_not_kept:
        _told_not_kept.add(folder)
        logger.warning("distance fields are not kept for later runs in %s: %s", folder, reason)


def _filled(mesh: SceneMesh, side: Side, shape: IntArray, origin: FloatArray, spacing: float) -> NDArray[np.float32]:
    values = np.empty(int(np.prod(shape)), dtype=np.float32)
    _fill(mesh.wall_tree, side, shape, origin, spacing, values)
    return values


def _read_stored(file: Path, count: int) -> NDArray[np.float32] | None:
    """Returns a stored field, or None where there is none or its bytes are not those that were written."""
    if not os.path.lexists(file):
        return None
    try:
        content = read_bytes(file)
    except FormatError as error:
        logger.warning("%s cannot be read, so the field is computed again: %s", file, error.problem)
        return None
    if not is_private(file):
        logger.warning("%s can be written by other users, so the field is computed again", file)
        return None
    digest, payload = content[:32], content[32:]
    if len(payload) != 4 * count or hashlib.sha256(payload).digest() != digest:
        logger.warning("%s is damaged, so the field is computed again", file)
        return None
    # A copy can be written to, like a field just computed; compiled code would be compiled again for a read-only one.
    return np.frombuffer(payload, dtype=np.float32).copy()


@njit(cache=True, nogil=True)
def _fill(wall, side, shape, origin, spacing, values):  # type: ignore[no-untyped-def]
    """Computes the exact distance at every node, and its sign.

    Neighbouring nodes share their side where their distances together exceed the spacing, since then no wall cuts the
    line between them; only where no neighbour says so is the winding number asked.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    strides = (ny * nz, nz, 1)
    triangle = 0
    for ix in range(nx):
        for iy in range(ny):
            for turn in range(nz):
                # To and fro along z, so that the triangle nearest to one node is a good first guess for the next.
                iz = turn if iy % 2 == 0 else nz - 1 - turn
                index = ix * strides[0] + iy * strides[1] + iz
                x = origin[0] + ix * spacing
                y = origin[1] + iy * spacing
                z = origin[2] + iz * spacing
                guess = math.sqrt(triangle_square_distance(x, y, z, wall.corners[triangle]))
                square, found = nearest_triangle(wall, x, y, z, guess * (1.0 + 1e-12))
                if found >= 0:
                    triangle = found
                distance = math.sqrt(square)
                values[index] = distance
                if entry_depth(side, x, y, z) <= 0.0:
                    continue
                sign = 0.0
                back = 1 if iy % 2 == 0 else -1
                for axis in range(3):
                    step = -strides[axis] if axis < 2 else -back
                    present = (ix > 0) if axis == 0 else ((iy > 0) if axis == 1 else turn > 0)
                    if not present:
                        continue
                    px = x - spacing if axis == 0 else x
                    py = y - spacing if axis == 1 else y
                    pz = z - back * spacing if axis == 2 else z
                    other = values[index + step]
                    apart = distance + abs(other) > spacing * (1.0 + ROUNDING)
                    if apart and entry_depth(side, px, py, pz) > 0.0:
                        sign = math.copysign(1.0, other)
                        break
                if sign == 0.0:
                    sign = -1.0 if is_wrong(side, x, y, z) else 1.0
                values[index] = sign * distance


@njit(cache=True, nogil=True)
def front(field, x, y, z):  # type: ignore[no-untyped-def]
    """Returns how far a point lies in front of the entry plane, m; infinity without one."""
    if field.rules[2] == 0:
        return np.inf
    p = field.plane
    return (x - p[0]) * p[3] + (y - p[1]) * p[4] + (z - p[2]) * p[5]


@njit(cache=True, nogil=True)
def _cell_bounds(field, x, y, z):  # type: ignore[no-untyped-def]
    """Returns bounds on the distance of a point of the grid from the walls, from the nearest node alone, m."""
    h = field.spacing
    ux, uy, uz = (x - field.origin[0]) / h, (y - field.origin[1]) / h, (z - field.origin[2]) / h
    ix, iy, iz = int(ux + 0.5), int(uy + 0.5), int(uz + 0.5)
    distance = abs(field.values[(ix * field.shape[1] + iy) * field.shape[2] + iz])
    r = h * math.sqrt((ux - ix) ** 2 + (uy - iy) ** 2 + (uz - iz) ** 2)
    return max(0.0, distance * (1.0 - ROUNDING) - r), distance * (1.0 + ROUNDING) + r


@njit(cache=True, nogil=True)
def bounds_at(field, x, y, z, enough):  # type: ignore[no-untyped-def]
    """Returns a lower and an upper bound on a point's distance from the walls, and its side.

    A distance changes by no more than the way gone, so a node at distance r from the point whose value is v bounds the
    point's distance by |v| - r and |v| + r. All eight corners of the point's cell do so.

    The eight together say more: with d the distance from any closed set, d(p)^2 - |p|^2 is the least of functions that
    are linear in p, hence concave, so it is no less at p than its mean over the corners with p's trilinear weights w:
    d(p)^2 >= sum w v^2 - sum w r^2, and sum w r^2 = h^2 (fx (1 - fx) + fy (1 - fy) + fz (1 - fz)).

    The side is 1 for right, -1 for wrong, 0 for unknown. A node's side is the point's where no wall lies between them
    (|v| > r) and both are in front of the entry plane, so that no entry does either.

    Args:
        field: The field.
        x: The point, m, world frame.
        y: The point.
        z: The point.
        enough: A lower bound above this, with a known side, need not be improved.
    """
    h = field.spacing
    depth = front(field, x, y, z)
    ux, uy, uz = (x - field.origin[0]) / h, (y - field.origin[1]) / h, (z - field.origin[2]) / h
    nx, ny, nz = field.shape[0], field.shape[1], field.shape[2]
    if not (0.0 <= ux < nx - 1 and 0.0 <= uy < ny - 1 and 0.0 <= uz < nz - 1):
        # Every wall lies in the mesh's box, so with c the box's point nearest to p and w on a wall the angle p c w is
        # not acute: |p - w|^2 >= |p - c|^2 + |c - w|^2.
        cx = min(max(x, field.lower[0]), field.upper[0])
        cy = min(max(y, field.lower[1]), field.upper[1])
        cz = min(max(z, field.lower[2]), field.upper[2])
        square = (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2
        low, high = _cell_bounds(field, cx, cy, cz)
        outside = -1 if (field.rules[1] == 1 and depth > 0.0) else 1
        return math.sqrt(square + low * low) * (1.0 - ROUNDING), high + math.sqrt(square), outside
    ix, iy, iz = int(ux), int(uy), int(uz)
    fx, fy, fz = ux - ix, uy - iy, uz - iz
    sided = field.rules[0] == 1 and depth > 0.0
    side = 0 if sided else 1
    lower, upper, mean = 0.0, np.inf, 0.0
    # The nearest corner first: it most often decides alone.
    cx, cy, cz = (1 if fx > 0.5 else 0), (1 if fy > 0.5 else 0), (1 if fz > 0.5 else 0)
    for corner in range(8):
        jx, jy, jz = cx ^ (corner & 1), cy ^ ((corner >> 1) & 1), cz ^ (corner >> 2)
        value = field.values[((ix + jx) * ny + iy + jy) * nz + iz + jz]
        distance = abs(value)
        ax, ay, az = fx - jx, fy - jy, fz - jz
        r = h * math.sqrt(ax * ax + ay * ay + az * az)
        least = distance * (1.0 - ROUNDING)
        low = least - r
        if low > lower:
            lower = low
        mean += (fx if jx else 1.0 - fx) * (fy if jy else 1.0 - fy) * (fz if jz else 1.0 - fz) * least * least
        upper = min(upper, distance * (1.0 + ROUNDING) + r)
        if sided and side == 0 and low > 0.0:
            node = depth
            if field.rules[2] == 1:
                node -= h * (ax * field.plane[3] + ay * field.plane[4] + az * field.plane[5])
            if node > 0.0:
                side = 1 if value > 0.0 else -1
        if lower > enough and side != 0:
            return lower, upper, side
    square = mean - h * h * (fx * (1.0 - fx) + fy * (1.0 - fy) + fz * (1.0 - fz))
    if square > lower * lower:
        lower = math.sqrt(square)
    return lower, upper, side
