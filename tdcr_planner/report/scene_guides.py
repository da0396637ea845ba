"""What helps to read a scene: entry planes, the world's axes, the base frame and gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.planning.scene import entry_plane
from tdcr_planner.report.picture import DisplayMesh, Picture

AXIS_COLOURS = {"x": "#C1272D", "y": "#3A8B3A", "z": "#1F5FBF"}
GRAVITY_COLOUR = "#4A3B76"
_RIM_CORNERS = 73
# Vertices of an opening's rim lie within this part of the mesh's size of the entry plane.
_RIM_DEPTH = 0.05


@dataclass(frozen=True)
class EntryDisk:
    """The part of a cavity's entry plane that a picture shows.

    Attributes:
        rim: Closed line about the opening, shape (m, 3), m, world frame.
        centre: Point of the plane, shape (3,), m.
        normal: Unit normal, shape (3,), into the cavity.
    """

    rim: FloatArray
    centre: FloatArray
    normal: FloatArray


def entry_disks(picture: Picture) -> list[EntryDisk]:
    """Returns the entry plane of each cavity of a scene, as large as the opening there."""
    disks = []
    angle = np.linspace(0.0, 2.0 * np.pi, _RIM_CORNERS)
    for entry, mesh in zip(picture.scenario.file.surfaces, picture.meshes, strict=False):
        point, normal = entry_plane(picture.scenario, entry)
        if point is None:
            continue
        normal = normal / np.linalg.norm(normal)
        across = np.linalg.svd(normal[None])[2][1:]
        radius = 1.15 * _opening_radius(mesh, point, normal, 3.0 * float(picture.robot.disk_radii.max()))
        rim = point + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
        disks.append(EntryDisk(rim, point, normal))
    return disks


def _opening_radius(mesh: DisplayMesh, point: FloatArray, normal: FloatArray, otherwise: float) -> float:
    """Returns how far the open border of a mesh near a plane reaches from a point of it, m."""
    border = mesh.vertices[_open_border(mesh.faces)] - point
    near = border[np.abs(border @ normal) < _RIM_DEPTH * np.ptp(mesh.vertices, axis=0).max()]
    return float(np.linalg.norm(near, axis=1).max()) if len(near) else otherwise


def _open_border(faces: IntArray) -> IntArray:
    """Returns the vertices of edges that one face alone has."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    count = int(faces.max(initial=0)) + 1
    numbers, counts = np.unique(edges.min(axis=1) * count + edges.max(axis=1), return_counts=True)
    return np.unique(np.stack(np.divmod(numbers[counts == 1], count)))


def base_axes(picture: Picture) -> tuple[FloatArray, FloatArray]:
    """Returns origin, shape (3,), m, and world_from_base, shape (3, 3), of the base in the first state of a picture."""
    known = np.flatnonzero(picture.known)
    if len(known):
        return picture.positions[known[0], 0], picture.rotations[known[0], 0]
    return picture.scenario.base_position, picture.scenario.base_rotation


def gravity_label(picture: Picture) -> str:
    """Returns gravity as a label, "no gravity" where a scenario has none."""
    size = float(np.linalg.norm(picture.scenario.gravity))
    return f"gravity {size:.3g} m/s²" if size > 1e-9 else "no gravity"


def gravity_direction(picture: Picture) -> FloatArray | None:
    """Returns the direction of gravity, shape (3,), world frame; None where there is none."""
    size = float(np.linalg.norm(picture.scenario.gravity))
    return picture.scenario.gravity / size if size > 1e-9 else None
