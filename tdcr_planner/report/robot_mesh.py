"""The robot's visible parts as triangles and lines: disks, backbone, tendons, and tubes along any line."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.robot import RobotSpec

Mesh = tuple[FloatArray, IntArray]


def backbone_curve(
    positions: FloatArray, rotations: FloatArray, arc_lengths: FloatArray, per_gap: int = 4
) -> FloatArray:
    """Returns a smooth line through the disk centres: cubic pieces whose ends point along the disks' z axes.

    Args:
        positions: Shape (d, 3), m.
        rotations: Shape (d, 3, 3), world_from_disk.
        arc_lengths: Shape (d,), m.
        per_gap: Points for each gap between two disks.

    Returns:
        Shape ((d - 1) * per_gap + 1, 3), m, same frame.
    """
    t = (np.arange(per_gap) / per_gap)[None, :, None]
    length = np.diff(arc_lengths)[:, None, None]
    start, end = positions[:-1, None, :], positions[1:, None, :]
    leave, arrive = length * rotations[:-1, None, :, 2], length * rotations[1:, None, :, 2]
    points = (
        (2 * t**3 - 3 * t**2 + 1) * start
        + (t**3 - 2 * t**2 + t) * leave
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - t**2) * arrive
    )
    return np.concatenate([points.reshape(-1, 3), positions[-1:]])


def tendon_lines(robot: RobotSpec, positions: FloatArray, rotations: FloatArray) -> list[FloatArray]:
    """Returns each tendon as a line through its holes in the disks, shape (disks up to its end, 3), m.

    Args:
        robot: The robot.
        positions: Shape (d, 3), m.
        rotations: Shape (d, 3, 3).
    """
    lines = []
    for tendon in robot.tendons:
        disks = slice(tendon.start_disk, tendon.end_disk + 1)
        across = tendon.offsets(robot.arc_lengths[disks])
        offsets = np.concatenate([across, np.zeros((len(across), 1))], axis=1)
        lines.append(positions[disks] + (rotations[disks] @ offsets[:, :, None])[:, :, 0])
    return lines


def disk_mesh(robot: RobotSpec, positions: FloatArray, rotations: FloatArray, sides: int = 24) -> Mesh:
    """Returns all disks as one mesh of cylinders: vertices (d * (2 * sides + 2), 3), m, and faces.

    Args:
        robot: The robot.
        positions: Shape (d, 3), m.
        rotations: Shape (d, 3, 3).
        sides: Corners of each disk's rim.
    """
    return _cylinders(positions, rotations, robot.disk_radii, robot.disk_thicknesses, sides)


def _cylinders(
    positions: FloatArray, rotations: FloatArray, radii: FloatArray, thicknesses: FloatArray, sides: int
) -> Mesh:
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    half = 0.5 * thicknesses[:, None, None] * np.array([0.0, 0.0, 1.0])
    rim = radii[:, None, None] * ring
    local = np.concatenate([rim - half, rim + half, -half, half], axis=1)
    vertices = positions[:, None, :] + np.einsum("dij,dvj->dvi", rotations, local)
    i = np.arange(sides)
    j = (i + 1) % sides
    low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    one = np.concatenate(
        [
            np.stack([i, j, sides + j], axis=1),
            np.stack([i, sides + j, sides + i], axis=1),
            np.stack([low, j, i], axis=1),
            np.stack([high, sides + i, sides + j], axis=1),
        ]
    )
    faces = one[None] + (2 * sides + 2) * np.arange(len(positions))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)


def tube_mesh(line: FloatArray, radius: float, sides: int = 8) -> Mesh:
    """Returns a tube of constant radius along a line, closed at both ends.

    Args:
        line: Shape (m, 3), m, two or more points, neighbours apart.
        radius: Radius, m.
        sides: Corners of the cross-section.
    """
    tangents = np.gradient(line, axis=0)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-15)
    normals = np.zeros_like(line)
    normals[0] = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    for index in range(1, len(line)):  # carry the normal along, so that the tube does not twist
        normals[index] = normals[index - 1] - (normals[index - 1] @ tangents[index]) * tangents[index]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    binormals = np.cross(tangents, normals)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rim = np.cos(angle)[None, :, None] * normals[:, None] + np.sin(angle)[None, :, None] * binormals[:, None]
    vertices = np.concatenate([(line[:, None] + radius * rim).reshape(-1, 3), line[:1], line[-1:]])
    i = np.arange(sides)
    j = (i + 1) % sides
    quads = np.concatenate([np.stack([i, j, sides + j], axis=1), np.stack([i, sides + j, sides + i], axis=1)])
    body = (quads[None] + sides * np.arange(len(line) - 1)[:, None, None]).reshape(-1, 3)
    last = sides * (len(line) - 1)
    first_cap = np.stack([np.full(sides, sides * len(line)), j, i], axis=1)
    last_cap = np.stack([np.full(sides, sides * len(line) + 1), last + i, last + j], axis=1)
    return vertices, np.concatenate([body, first_cap, last_cap])


def merge_meshes(meshes: list[Mesh]) -> Mesh:
    """Returns several meshes as one: vertices (v, 3) and faces (f, 3)."""
    if not meshes:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + start for start, (_, faces) in zip(counts, meshes, strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def simplify_mesh(vertices: FloatArray, faces: IntArray, max_faces: int) -> Mesh:
    """Returns a mesh with at most `max_faces` triangles, its vertices merged by grid cells (Rossignac and Borrel 1993).

    For display only: details below the cell size are lost. A mesh that is small enough comes back as it is.

    Args:
        vertices: Shape (v, 3), m.
        faces: Shape (f, 3).
        max_faces: Most triangles wanted.
    """
    if len(faces) <= max_faces or len(vertices) == 0:
        return vertices, faces
    low = vertices.min(axis=0)
    span = float(np.ptp(vertices, axis=0).max())
    area = 0.5 * np.linalg.norm(
        np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]), axis=1
    )
    cell = max(float(np.sqrt(2.0 * area.sum() / max_faces)), 1e-6 * span)
    while True:
        keys = np.floor((vertices - low) / cell).astype(np.int64)
        flat = np.ravel_multi_index(tuple(keys.T), tuple(keys.max(axis=0) + 1))
        _, owner = np.unique(flat, return_inverse=True)
        merged = owner[faces]
        distinct = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
        kept = _first_of_each(np.sort(merged[distinct], axis=1))
        if len(kept) <= max_faces:
            break
        cell *= 1.2
    count = np.bincount(owner)
    centres = np.stack([np.bincount(owner, weights=vertices[:, axis]) / count for axis in range(3)], axis=1)
    return centres, merged[distinct][kept]


def _first_of_each(rows: IntArray) -> IntArray:
    """Index of the first of each set of equal rows, in the rows' order."""
    order = np.lexsort(rows.T)
    differs = np.ones(len(rows), dtype=np.bool_)
    differs[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    return np.sort(order[differs])
