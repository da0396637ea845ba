"""Targets: the points of surfaces that are to be seen, with their normals, areas and the meshes that they lie on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.meshes import SceneMesh, load_scene_mesh
from tdcr_planner.collision.tree import nearest_distances
from tdcr_planner.errors import FormatError, UnknownNameError
from tdcr_planner.planning.inspect_table import SurfaceTable
from tdcr_planner.planning.scenario import Scenario

MOST_POINTS = 50_000
"""Of a query: what every state sees of them is kept, a bit each."""

_DENSE = 12  # samples drawn for each point that is kept
_FILL = 0.7  # points of a maximal packing for each square of the spacing, about
_SIDE_M = 1e-5  # distance from the surface at which its sides are told
_FEW_SAMPLES = 4_000
_SEED = 1


@dataclass(frozen=True, eq=False)
class Targets:
    """Points of surfaces.

    Attributes:
        points: Shape (p, 3), m, world frame.
        normals: Unit normals on the visible side, shape (p, 3).
        areas: Area that each point stands for, shape (p,), m^2.
        two_sided: Whether both sides may be seen, shape (p,).
        meshes: Number of the mesh in the scene, shape (p,).
        faces: Number of the triangle in its mesh, shape (p,).
        spacing_m: Least distance between two points of a surface.
    """

    points: FloatArray
    normals: FloatArray
    areas: FloatArray
    two_sided: BoolArray
    meshes: IntArray
    faces: IntArray
    spacing_m: float

    def __len__(self) -> int:
        return len(self.points)

    def share(self, seen: BoolArray) -> float:
        """Returns the share of the area for which points, shape (p,), stand."""
        total = float(self.areas.sum())
        return float(self.areas[seen].sum()) / total if total > 0.0 else 0.0


def make_targets(scenario: Scenario, meshes: Sequence[SceneMesh]) -> Targets:
    """Returns the points that a scenario's `[inspect]` names.

    Points on a surface are at least spacing_m apart, and no place of it is farther than that from the nearest; the
    same table gives the same points.

    Args:
        scenario: A scenario with `[inspect]`.
        meshes: Its meshes.

    Raises:
        FormatError: A surface is unknown or has no area, or the spacing makes too many points.
    """
    table = scenario.file.inspect
    assert table is not None  # the caller has checked
    generator = np.random.default_rng(_SEED)
    parts = []
    for number, surface in enumerate(table.surfaces):
        place = f"inspect.surfaces[{number + 1}]"
        index = _find_mesh(scenario, surface.mesh, meshes, place)
        if surface.points_m is not None:
            part = _given_points(meshes[index], np.asarray(surface.points_m), table.spacing_m)
        else:
            part = _spread_points(scenario, surface, meshes[index], table.spacing_m, place, generator)
        parts.append((*part, np.full(len(part[0]), index)))
    points, normals, areas, faces, numbers = (np.concatenate(items) for items in zip(*parts, strict=True))
    normals, two_sided = _visible_sides(points, normals, numbers, meshes)
    sizes = [len(part[0]) for part in parts]
    facing = np.repeat([surface.facing or (0.0, 0.0, 0.0) for surface in table.surfaces], sizes, axis=0)
    turned = (normals * facing).sum(axis=1)
    kept = np.flatnonzero(~facing.any(axis=1) | (turned > 0.0) | (two_sided & (turned != 0.0)))
    if not len(kept):
        raise FormatError(scenario.path, "nothing of the surfaces faces that way", "inspect.surfaces.facing")
    # A side that may be seen from both is asked for from the one that faces the direction.
    back = two_sided & (turned < 0.0)
    normals[back] *= -1.0
    two_sided = two_sided & ~facing.any(axis=1)
    return Targets(
        points[kept], normals[kept], areas[kept], two_sided[kept], numbers[kept], faces[kept], table.spacing_m
    )


def _find_mesh(scenario: Scenario, name: str, meshes: Sequence[SceneMesh], place: str) -> int:
    for index, (mesh, entry) in enumerate(zip(meshes, scenario.file.meshes, strict=True)):
        if name in (mesh.name, entry.file, entry.file.rpartition("/")[2]):
            return index
    error = UnknownNameError(f"{place}.mesh", name, [mesh.name for mesh in meshes])
    raise FormatError(scenario.path, str(error.args[0]).removeprefix(f"{place}.mesh: "), f"{place}.mesh") from error


Part = tuple[FloatArray, FloatArray, FloatArray, IntArray]


def _spread_points(
    scenario: Scenario,
    surface: SurfaceTable,
    mesh: SceneMesh,
    spacing: float,
    place: str,
    generator: np.random.Generator,
) -> Part:
    """Returns points, normals, areas and triangles of a surface, evenly spread."""
    inside = _Marks(scenario, surface)
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(cross, axis=1)
    possible = np.flatnonzero(inside.may_hold(corners))
    nothing = FormatError(scenario.path, f"no part of {mesh.name} lies in it: {_bounds_text(mesh)}", place)
    if not len(possible):
        raise nothing
    # What the marks leave of the area is told by a few samples before many are drawn.
    faces, points = _draw(corners[possible], areas[possible], _FEW_SAMPLES, generator)
    kept = inside.hold(points)
    area = float(areas[possible].sum()) * float(kept.mean())
    count = _FILL * area / spacing**2
    if count > MOST_POINTS:
        _refuse(scenario, count, area)
    drawn = int(min(max(_DENSE * count / max(float(kept.mean()), 1e-3), _FEW_SAMPLES), 4e6))
    faces, points = _draw(corners[possible], areas[possible], drawn, generator)
    each = float(areas[possible].sum()) / drawn
    kept = inside.hold(points)
    if not kept.any():
        raise nothing
    faces, points = possible[faces[kept]], points[kept]
    chosen = thin_out(points, spacing)
    _, nearest = cKDTree(points[chosen]).query(points)
    normals: Any = cross[faces[chosen]] / (2.0 * areas[faces[chosen]])[:, None]
    stands_for: Any = each * np.bincount(nearest, minlength=len(chosen))
    return np.asarray(points[chosen]), normals, stands_for, faces[chosen]


def _draw(
    corners: FloatArray, areas: FloatArray, count: int, generator: np.random.Generator
) -> tuple[IntArray, FloatArray]:
    """Returns triangles and points of them, uniform by area, shape (count,) and (count, 3)."""
    ends = np.cumsum(areas)
    # One of each even share of the area: as uniform as independent draws, and far less uneven.
    places = (np.arange(count) + generator.uniform(size=count)) * (ends[-1] / count)
    faces = np.minimum(np.searchsorted(ends, places), len(areas) - 1)
    u, v = generator.uniform(size=(2, count))
    root = np.sqrt(u)[:, None]
    a, b, c = corners[faces, 0], corners[faces, 1], corners[faces, 2]
    return faces, a * (1.0 - root) + b * (root * (1.0 - v[:, None])) + c * (root * v[:, None])


def thin_out(points: FloatArray, spacing: float) -> IntArray:
    """Returns numbers of points, shape (n, 3), that are at least `spacing` apart, so many that none can be added."""
    tree = cKDTree(points)
    order = np.random.default_rng(_SEED).permutation(len(points))
    open_ = np.ones(len(points), dtype=np.bool_)
    chosen = []
    for index in order.tolist():
        if open_[index]:
            chosen.append(index)
            open_[tree.query_ball_point(points[index], spacing)] = False
    return np.array(chosen, dtype=np.int64)


def _given_points(mesh: SceneMesh, given: FloatArray, spacing: float) -> Part:
    """Returns points moved onto a mesh, each standing for the area of a square of the spacing."""
    _, triangles = nearest_distances(mesh.wall_tree, np.ascontiguousarray(given))
    faces = np.minimum(triangles, len(mesh.faces) - 1)
    corners = mesh.vertices[mesh.faces[faces]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    moved = np.array([_nearest_on(triangle, point) for triangle, point in zip(corners, given, strict=True)])
    return moved, normals, np.full(len(given), spacing**2), faces


def _nearest_on(triangle: FloatArray, point: FloatArray) -> FloatArray:
    from trimesh.triangles import closest_point

    return np.asarray(closest_point(triangle[None], point[None])[0])


def _visible_sides(
    points: FloatArray, normals: FloatArray, numbers: IntArray, meshes: Sequence[SceneMesh]
) -> tuple[FloatArray, BoolArray]:
    """Returns normals that point where the robot may be, and where it may be on both sides."""
    normals = normals.copy()
    two_sided = np.zeros(len(points), dtype=np.bool_)
    for number in np.unique(numbers):
        which = np.flatnonzero(numbers == number)
        mesh = meshes[number]
        ahead = mesh.contains(points[which] + _SIDE_M * normals[which])
        behind = mesh.contains(points[which] - _SIDE_M * normals[which])
        free_ahead, free_behind = (ahead, behind) if mesh.role == "cavity" else (~ahead, ~behind)
        normals[which[free_behind & ~free_ahead]] *= -1.0
        two_sided[which] = free_ahead == free_behind
    return normals, two_sided


class _Marks:
    """What marks a part of a surface."""

    def __init__(self, scenario: Scenario, surface: SurfaceTable) -> None:
        self._box = None if surface.box_m is None else np.asarray(surface.box_m)
        self._sphere = surface.sphere
        self._marker: SceneMesh | None = None
        if surface.within is not None:
            file = scenario.resolve(surface.within.file)
            self._marker = load_scene_mesh(file, surface.within.unit, "obstacle")
            if not self._marker.bounded:
                raise FormatError(file, "is open, and so marks no part of a surface; close it")

    def may_hold(self, corners: FloatArray) -> BoolArray:
        """Returns which triangles, shape (f, 3, 3), may lie in the part, by their boxes."""
        low, high = corners.min(axis=1), corners.max(axis=1)
        possible = np.ones(len(corners), dtype=np.bool_)
        boxes = [] if self._box is None else [self._box]
        if self._sphere is not None:
            centre = np.asarray(self._sphere.center_m)
            boxes.append(np.stack([centre - self._sphere.radius_m, centre + self._sphere.radius_m]))
        if self._marker is not None:
            boxes.append(self._marker.bounds)
        for box in boxes:
            possible &= ((high >= box[0]) & (low <= box[1])).all(axis=1)
        return possible

    def hold(self, points: FloatArray) -> BoolArray:
        """Returns which points, shape (n, 3), lie in the part."""
        held = np.ones(len(points), dtype=np.bool_)
        if self._box is not None:
            held &= ((points >= self._box[0]) & (points <= self._box[1])).all(axis=1)
        if self._sphere is not None:
            held &= np.linalg.norm(points - np.asarray(self._sphere.center_m), axis=1) <= self._sphere.radius_m
        if self._marker is not None:
            held &= self._marker.contains(points)
        return held


def _refuse(scenario: Scenario, count: float, area: float) -> None:
    spacing = math.sqrt(_FILL * area / (0.2 * MOST_POINTS))
    digits = 10.0 ** (math.floor(math.log10(spacing)) - 1)
    spacing = math.ceil(spacing / digits) * digits
    raise FormatError(
        scenario.path,
        f"makes about {count:,.0f} points of {1e4 * area:,.0f} cm^2, expected {MOST_POINTS:,} at most; "
        f"{spacing:.2g} makes about {_FILL * area / spacing**2:,.0f}",
        "inspect.spacing_m",
    )


def _bounds_text(mesh: SceneMesh) -> str:
    low, high = (np.round(corner, 4).tolist() for corner in mesh.bounds)
    return f"the mesh reaches from {low} to {high} m"
