"""The connectivity of a triangle mesh: clean faces, one orientation, connected pieces, boundary loops and caps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.connected import connected_parts
from tdcr_planner.collision.nesting import enclosing_boxes
from tdcr_planner.compiled import njit

# Corners nearer than this share of the mesh's diagonal are one vertex: single-precision files round at 6e-8.
MERGE_SHARE = 2e-7
# No farther than this, m: a crumb far away must not make a fine mesh collapse. Contacts are decided to 1 um as well.
MERGE_LIMIT = 1e-6
# A direction along which the vertices of few meshes coincide, unit.
_OBLIQUE = np.sqrt([0.375, 0.2857142857142857, 0.3392857142857143])


@dataclass(frozen=True)
class Loop:
    """A hole's rim: the boundary edges that hang together.

    Attributes:
        edges: Shape (e, 2), vertex indices, directed as in the face beside each edge.
        faces: The face beside each edge, shape (e,).
        piece: Connected piece of the mesh that the rim belongs to.
        centre: Mean of the edges' midpoints, weighted by length, shape (3,), m.
        diameter: Twice the largest distance of the rim from the centre, m.
        normal: Unit normal of the plane of least squares, shape (3,).
        flatness: Largest distance of the rim from that plane, m.
        steepness: Mean angle between the plane and the faces beside it, 0 (the faces lie in the plane) to 1 (they
            stand at right angles to it), weighted by edge length.
    """

    edges: IntArray
    faces: IntArray
    piece: int
    centre: FloatArray
    diameter: float
    normal: FloatArray
    flatness: float
    steepness: float


def clean_mesh(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Returns a mesh with coincident vertices merged and collapsed or repeated faces dropped.

    Args:
        vertices: Shape (v, 3), m.
        faces: Shape (f, 3).
    """
    named, faces = np.unique(faces, return_inverse=True)
    unique, inverse = np.unique(vertices[named], axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[faces.reshape(-1, 3)]
    diagonal = float(np.linalg.norm(np.ptp(unique, axis=0))) if len(unique) else 0.0
    distance = min(MERGE_SHARE * diagonal, MERGE_LIMIT)
    pairs = _near_pairs(unique, distance)
    if len(pairs):
        _, group = connected_parts(len(unique), pairs)
        faces = group[faces]
        _, representative = np.unique(group, return_index=True)
        unique = unique[representative]
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[distinct]
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = faces[np.sort(kept)]
    used, compact = np.unique(faces, return_inverse=True)
    return np.ascontiguousarray(unique[used]), np.ascontiguousarray(compact.reshape(-1, 3), dtype=np.int64)


def _near_pairs(points: FloatArray, distance: float) -> IntArray:
    """Returns the pairs of points, shape (v, 3), that are no farther apart than a distance, m, shape (p, 2)."""
    along = points @ _OBLIQUE
    order = np.argsort(along)
    steps = np.diff(along[order])
    rounding = 8.0 * np.finfo(np.float64).eps * np.abs(along).max(initial=0.0)
    close = np.flatnonzero(steps <= distance + rounding)
    if (np.diff(close) == 1).any():
        # More than two points in a row: a tree tells which of them are near. Few meshes need it and its slow import.
        from scipy.spatial import cKDTree

        return np.asarray(cKDTree(points).query_pairs(distance, output_type="ndarray"), dtype=np.int64)
    pairs = np.stack([order[close], order[close + 1]], axis=1)
    return pairs[np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1) <= distance]


@dataclass(frozen=True)
class Surface:
    """A mesh whose faces are oriented alike within each piece, outward where a piece is closed.

    Attributes:
        faces: Shape (f, 3), reordered corners where a face had to be turned.
        piece: Connected piece (by shared edges) of each face, shape (f,).
        loops: The rims of its holes.
        tangled: Shape (pieces,); true where a piece cannot be oriented: edges of three or more faces, or a one-sided
            surface, leave its inside undefined.
    """

    faces: IntArray
    piece: IntArray
    loops: tuple[Loop, ...]
    tangled: BoolArray


def analyse(vertices: FloatArray, faces: IntArray) -> Surface:
    """Returns the oriented surface of a clean mesh.

    Args:
        vertices: Shape (v, 3), m.
        faces: Shape (f, 3).
    """
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    numbers = directed.min(axis=1) * len(vertices) + directed.max(axis=1)
    _, edge, count = np.unique(numbers, return_inverse=True, return_counts=True)
    order = np.argsort(edge, kind="stable")
    start = np.concatenate([[0], np.cumsum(count)])
    first, later = order[start[:-1]][edge], np.arange(len(edge))
    pieces, piece = connected_parts(len(faces), np.stack([owner[first], owner[later]], axis=1))
    twice = np.flatnonzero(count == 2)
    pair = np.stack([order[start[twice]], order[start[twice] + 1]], axis=1)
    same_way = directed[pair[:, 0], 0] == directed[pair[:, 1], 0]
    flipped = _orient(len(faces), owner[pair], same_way)
    oriented = np.where(flipped[:, None], faces[:, ::-1], faces)
    turned = np.where(flipped[owner][:, None], directed[:, ::-1], directed)
    tangled = np.zeros(pieces, dtype=np.bool_)
    torn = pair[turned[pair[:, 0], 0] == turned[pair[:, 1], 0]]
    tangled[piece[owner[torn[:, 0]]]] = True
    balance = np.zeros(len(count), dtype=np.int64)
    np.add.at(balance, edge, np.where(turned[:, 0] < turned[:, 1], 1, -1))
    branching = (count > 2) & (balance != 0)
    tangled[piece[owner[order[start[:-1][branching]]]]] = True
    single = order[start[:-1][count == 1]]
    loops = _loops(vertices, oriented, turned[single], owner[single], piece)
    outward = _point_outward(vertices, oriented, piece, pieces, loops)
    final = tuple(
        loop if outward[loop.piece] else replace(loop, edges=np.ascontiguousarray(loop.edges[:, ::-1]))
        for loop in loops
    )
    oriented = np.where(outward[piece][:, None], oriented, oriented[:, ::-1])
    return Surface(np.ascontiguousarray(oriented, dtype=np.int64), piece.astype(np.int64), final, tangled)


@njit(cache=True, nogil=True)
def _orient(total, pair, same_way):  # type: ignore[no-untyped-def]
    """Returns which faces to turn so that neighbours run their shared edge in opposite directions."""
    degree = np.zeros(total + 1, np.int64)
    for k in range(len(pair)):
        degree[pair[k, 0] + 1] += 1
        degree[pair[k, 1] + 1] += 1
    start = np.cumsum(degree)
    place = start.copy()
    neighbour = np.empty(2 * len(pair), np.int64)
    link = np.empty(2 * len(pair), np.int64)
    for k in range(len(pair)):
        for side in range(2):
            f = pair[k, side]
            neighbour[place[f]] = pair[k, 1 - side]
            link[place[f]] = k
            place[f] += 1
    flipped = np.zeros(total, np.bool_)
    seen = np.zeros(total, np.bool_)
    queue = np.empty(total, np.int64)
    for seed in range(total):
        if seen[seed]:
            continue
        seen[seed] = True
        queue[0] = seed
        head, tail = 0, 1
        while head < tail:
            f = queue[head]
            head += 1
            for i in range(start[f], start[f + 1]):
                other = neighbour[i]
                if not seen[other]:
                    seen[other] = True
                    flipped[other] = flipped[f] != same_way[link[i]]
                    queue[tail] = other
                    tail += 1
    return flipped


def _loops(
    vertices: FloatArray, faces: IntArray, edges: IntArray, beside: IntArray, piece: IntArray
) -> tuple[Loop, ...]:
    """Returns the rims that boundary edges make, all described at once.

    Args:
        vertices: Shape (v, 3), m.
        faces: Shape (f, 3).
        edges: Boundary edges, shape (e, 2).
        beside: The face beside each of them, shape (e,).
        piece: Connected piece of each face, shape (f,).
    """
    if not len(edges):
        return ()
    used, compact = np.unique(edges, return_inverse=True)
    compact = compact.reshape(-1, 2)
    count, of_vertex = connected_parts(len(used), compact)
    # A vertex's edges all belong to one loop, so each vertex of a rim does, too.
    order = np.argsort(of_vertex[compact[:, 0]], kind="stable")
    edges, beside, label = edges[order], beside[order], of_vertex[compact[:, 0]][order]
    ends = vertices[edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    centre = _loop_means(ends.mean(axis=1), length, label, count)
    rim = vertices[used] - centre[of_vertex]
    normal = _plane_normals(rim, of_vertex, count)
    radius, flatness = np.zeros(count), np.zeros(count)
    np.maximum.at(radius, of_vertex, np.linalg.norm(rim, axis=1))
    np.maximum.at(flatness, of_vertex, np.abs(np.einsum("vi,vi->v", rim, normal[of_vertex])))
    corners = vertices[faces[beside]]
    face_normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(face_normal, axis=1)
    cosine = np.abs(np.einsum("ei,ei->e", face_normal, normal[label])) / np.where(size > 0.0, size, 1.0)
    angle = np.arccos(np.clip(cosine, 0.0, 1.0)) / (np.pi / 2.0)
    steepness = _loop_means(angle[:, None], length, label, count)[:, 0]
    start = np.searchsorted(label, np.arange(count + 1))
    return tuple(
        Loop(
            edges=edges[start[k] : start[k + 1]],
            faces=beside[start[k] : start[k + 1]],
            piece=int(piece[beside[start[k]]]),
            centre=centre[k],
            diameter=2.0 * float(radius[k]),
            normal=normal[k],
            flatness=float(flatness[k]),
            steepness=float(steepness[k]),
        )
        for k in range(count)
    )


def _loop_means(values: FloatArray, weights: FloatArray, label: IntArray, count: int) -> FloatArray:
    """Returns the weighted mean of the values, shape (e, c), of each loop, shape (count, c)."""
    total = np.bincount(label, weights, count)
    sums = [np.bincount(label, weights * column, count) for column in values.T]
    return np.stack(sums, axis=1) / total[:, None]


def _plane_normals(rim: FloatArray, label: IntArray, count: int) -> FloatArray:
    """Returns the unit normal of each loop's plane of least squares, shape (count, 3).

    Args:
        rim: The rims' vertices from their loop's centre, shape (v, 3), m.
        label: The loop of each, shape (v,).
        count: Number of loops.
    """
    scatter = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(3):
            scatter[:, i, j] = np.bincount(label, rim[:, i] * rim[:, j], count)
    return np.asarray(np.linalg.eigh(scatter)[1][:, :, 0])


def fan_cap(loop: Loop, centre_index: int) -> IntArray:
    """Returns triangles from a rim to one vertex, shape (e, 3), oriented like the faces beside it."""
    return np.stack([loop.edges[:, 1], loop.edges[:, 0], np.full(len(loop.edges), centre_index)], axis=1)


def signed_volumes(
    vertices: FloatArray, faces: IntArray, piece: IntArray, pieces: int, loops: tuple[Loop, ...]
) -> FloatArray:
    """Returns the volume of each piece with its rims capped, shape (pieces,), m^3, positive if it is outward."""
    origin = vertices.mean(axis=0)
    corners = vertices[faces] - origin
    signed = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    volume = np.zeros(pieces)
    np.add.at(volume, piece, signed)
    if loops:
        sizes = [len(loop.edges) for loop in loops]
        ends = vertices[np.concatenate([loop.edges for loop in loops])] - origin
        tips = np.repeat([loop.centre for loop in loops], sizes, axis=0) - origin
        capped = np.einsum("ei,ei->e", np.cross(ends[:, 1], ends[:, 0]), tips) / 6.0
        np.add.at(volume, np.repeat([loop.piece for loop in loops], sizes), capped)
    return volume


def _point_outward(
    vertices: FloatArray, faces: IntArray, piece: IntArray, pieces: int, loops: tuple[Loop, ...]
) -> BoolArray:
    """Returns which pieces to keep as they are so that the outermost ones enclose a positive volume.

    A piece inside another one keeps its orientation relative to the file's majority: a shell turned inward inside a
    shell turned outward is a hollow, and stays one.
    """
    volume = signed_volumes(vertices, faces, piece, pieces, loops)
    negative = volume < 0.0
    if pieces == 1 or not negative.any():
        return ~negative
    order = np.argsort(-np.abs(volume))
    lower = np.empty((pieces, 3))
    upper = np.empty((pieces, 3))
    for axis in range(3):
        values = vertices[faces][:, :, axis]
        lower[:, axis] = np.inf
        upper[:, axis] = -np.inf
        np.minimum.at(lower[:, axis], piece, values.min(axis=1))
        np.maximum.at(upper[:, axis], piece, values.max(axis=1))
    rank = np.empty(pieces, dtype=np.int64)
    rank[order] = np.arange(pieces)
    # The smallest box around a piece is the shell that it is nested in; it turns with that shell.
    around = enclosing_boxes(lower, upper, rank)
    flip = np.zeros(pieces, dtype=np.bool_)
    for index in order.tolist():
        flip[index] = flip[around[index]] if around[index] >= 0 else negative[index]
    return ~flip
