"""The coverage map: surfaces painted by what is seen of them, for pictures, and as meshes with coloured vertices."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from matplotlib.colors import to_rgb
from scipy.spatial import cKDTree

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.inspection.coverage import Coverage
from tdcr_planner.report.picture import DisplayMesh

CLASSES = ("not asked for", "seen", "could be seen", "cannot be seen")
COLOURS = ("#C9BFB4", "#12A594", "#E8A317", "#B4436C")

_FINENESS = 1.2  # longest edge of a painted triangle, in spacings
_NEAR = 1.6  # distance, in spacings, up to which a place is painted as the nearest point
_MOST_FACES = 400_000


@dataclass(frozen=True, eq=False)
class PaintedMesh:
    """A surface of the scene with the class of each face.

    Attributes:
        name: What the mesh is called.
        vertices: Shape (v, 3), m, world frame.
        faces: Shape (f, 3).
        classes: Index into `CLASSES` of each face, shape (f,).
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    classes: IntArray

    @property
    def colours(self) -> FloatArray:
        """Colour of each face, shape (f, 3), 0 to 1."""
        return np.array([to_rgb(colour) for colour in COLOURS])[self.classes]


def point_classes(coverage: Coverage) -> IntArray:
    """Returns the index into `CLASSES` of each point, shape (p,)."""
    return np.where(coverage.sight.seen, 1, np.where(coverage.can_be_seen, 2, 3))


def paint(coverage: Coverage, meshes: tuple[DisplayMesh, ...]) -> list[PaintedMesh]:
    """Returns all meshes of a scene, those that are inspected divided finely enough to show the map.

    Args:
        coverage: What the path sees.
        meshes: The scene's meshes, in the scenario's order.
    """
    classes = point_classes(coverage)
    painted = []
    for number, mesh in enumerate(meshes):
        which = np.flatnonzero(coverage.targets.meshes == number)
        if not len(which):
            painted.append(PaintedMesh(mesh.name, mesh.vertices, mesh.faces, np.zeros(len(mesh.faces), dtype=np.int64)))
            continue
        tree = cKDTree(coverage.targets.points[which])
        spacing = coverage.targets.spacing_m
        vertices, faces = _divide(mesh, tree, spacing)
        corners = vertices[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        distance, nearest = tree.query(corners.mean(axis=1), k=min(4, len(which)))
        distance, nearest = distance.reshape(len(faces), -1), nearest.reshape(len(faces), -1)
        # The other side of a thin blade is near, too: only points whose normals agree, either way, are taken.
        length = np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
        agree = np.abs(np.einsum("fkj,fj->fk", coverage.targets.normals[which][nearest], normals)) / length[:, None]
        chosen = np.argmin(np.where(agree > 0.5, distance, distance + spacing), axis=1)
        rows = np.arange(len(faces))
        found = np.where(distance[rows, chosen] <= _NEAR * spacing, classes[which][nearest[rows, chosen]], 0)
        painted.append(PaintedMesh(mesh.name, vertices, faces, found))
    return painted


def _divide(mesh: DisplayMesh, tree: cKDTree, spacing: float) -> tuple[FloatArray, IntArray]:
    """Returns a mesh whose triangles near the points are no longer than the map is fine."""
    corners = mesh.vertices[mesh.faces]
    radii = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    distance, _ = tree.query(corners.mean(axis=1))
    near = distance <= radii + _NEAR * spacing
    if not near.any() or near.sum() > _MOST_FACES:
        return mesh.vertices, mesh.faces
    fine, triangles = trimesh.remesh.subdivide_to_size(
        mesh.vertices, mesh.faces[near], _FINENESS * spacing, max_iter=12
    )
    rest = mesh.faces[~near]
    return np.concatenate([mesh.vertices, fine]), np.concatenate([rest, triangles + len(mesh.vertices)])


def write_map(painted: list[PaintedMesh], file: str | Path) -> None:
    """Writes painted meshes as one mesh with coloured vertices: binary glTF or PLY, by the file's ending, in metres."""
    target = Path(file)
    parts = []
    for mesh in painted:
        # Vertices of their own for every face, so that a colour ends where its class does.
        vertices = mesh.vertices[mesh.faces].reshape(-1, 3)
        colours = np.repeat(np.round(255 * mesh.colours), 3, axis=0).astype(np.uint8)
        opaque = np.full((len(colours), 1), 255, dtype=np.uint8)
        parts.append(
            trimesh.Trimesh(
                vertices,
                np.arange(len(vertices)).reshape(-1, 3),
                vertex_colors=np.concatenate([colours, opaque], axis=1),
                process=False,
            )
        )
    if target.suffix.lower() == ".ply":
        target.write_bytes(trimesh.util.concatenate(parts).export(file_type="ply"))
        return
    scene = trimesh.Scene()
    for number, (part, mesh) in enumerate(zip(parts, painted, strict=True)):
        scene.add_geometry(part, geom_name=f"{number + 1} {mesh.name}")
    target.write_bytes(scene.export(file_type="glb"))
