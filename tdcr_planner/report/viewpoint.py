"""Where to look from: the direction that shows a robot's motion best, and what fits into the picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.roles import find_role
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera, render_layer
from tdcr_planner.report.robot_mesh import Mesh, merge_meshes, simplify_mesh

_ELEVATIONS_DEG = (8.0, 18.0, 30.0, 45.0, 62.0)
_AZIMUTHS = 24
# A view within this angle of a world axis, told on the horizon, shows flat walls and ribs edge-on.
_OFF_AXIS_DEG = 15.0
# So many of the best views are compared by how much of the robot obstacles hide.
_LOOKED_THROUGH = 24
# Part of a view's width that a corner takes.
_CORNER = 0.18
# A scene of up to this many times the robot's reach is shown whole.
_WHOLE_SCENE = 1.6


def choose_camera(picture: Picture, width: int, height: int, margin: float = 0.085) -> Camera:
    """Returns the camera under which the robot's states and goals fill much of the picture and are seen from the side.

    Up is against gravity (world z without gravity). Directions above the horizon are compared, each fitted to the robot
    and to the scene about it; lower ones, and those in which obstacles hide little of the robot, are preferred. None
    looks along a world axis: each is turned at least 15 degrees about `up` away from them.

    Args:
        picture: What is shown.
        width: Pixels.
        height: Pixels.
        margin: Part of the picture left free on each side.
    """
    body = body_points(picture)
    fitted = points_to_fit(picture, body)
    few = fitted[:: max(1, len(fitted) // 2000)]
    tangents = picture.rotations[picture.known][..., 2].reshape(-1, 3)
    up = up_direction(picture)
    candidates = []
    for elevation in _ELEVATIONS_DEG:
        for step in range(_AZIMUTHS):
            rotation = look_from(360.0 * step / _AZIMUTHS, elevation, up)
            if _along_an_axis(rotation, up):
                continue
            camera = _fit(rotation, few, width, height, margin)
            side_on = 1.0 - float(np.mean((tangents @ camera.rotation[2]) ** 2)) if len(tangents) else 1.0
            level = 1.0 - 0.3 * np.sin(np.deg2rad(elevation))
            area = _hull_area((body @ camera.rotation.T)[:, :2]) + 0.3 * _hull_area((few @ camera.rotation.T)[:, :2])
            candidates.append((level * side_on * camera.scale**2 * area, camera.rotation))
    candidates.sort(key=lambda candidate: -candidate[0])
    obstacles = merge_meshes(
        [(mesh.vertices, mesh.faces) for mesh in picture.meshes if not find_role(mesh.role).keeps_inside]
    )
    obstacles = simplify_mesh(*obstacles, 8000)
    best, best_score = candidates[0][1], -1.0
    for score, rotation in candidates[:_LOOKED_THROUGH]:
        open_score = score * (1.0 - 0.8 * _hidden_share(_fit(rotation, few, 160, 120, margin), body, obstacles))
        if open_score > best_score:
            best, best_score = rotation, open_score
    return _fit(best, fitted, width, height, margin)


def _along_an_axis(rotation: FloatArray, up: FloatArray) -> bool:
    """Returns whether a viewer's compass direction is that of a world axis, both seen on the horizon."""
    right = rotation[0]
    level = np.cross(right, up)
    forward, aside = np.eye(3) @ level, np.eye(3) @ right
    # an axis that points up has no compass direction
    lying = np.hypot(forward, aside) > np.sin(np.deg2rad(_OFF_AXIS_DEG))
    off_deg = np.rad2deg(np.arctan2(np.abs(aside), np.abs(forward)))
    return bool((off_deg[lying] < _OFF_AXIS_DEG - 1e-6).any())


def _hidden_share(camera: Camera, points: FloatArray, obstacles: Mesh) -> float:
    """Returns which share of some points, shape (m, 3), m, obstacles hide from a camera."""
    if not len(obstacles[1]):
        return 0.0
    layer = render_layer(camera, *obstacles)
    place = camera.project(points)
    column = np.floor(place[:, 0]).astype(int) - layer.columns.start
    row = np.floor(place[:, 1]).astype(int) - layer.rows.start
    inside = (column >= 0) & (column < layer.face.shape[1]) & (row >= 0) & (row < layer.face.shape[0])
    hidden = layer.nearness[row[inside], column[inside]] > place[inside, 2]
    return float(hidden.sum()) / len(points)


def up_direction(picture: Picture) -> FloatArray:
    """Returns the direction against gravity, shape (3,), world frame; z where there is none."""
    gravity = picture.scenario.gravity
    size = float(np.linalg.norm(gravity))
    return np.array([0.0, 0.0, 1.0]) if size < 1e-9 else -gravity / size


def body_points(picture: Picture) -> FloatArray:
    """Returns disk centres of all states, goals and marks, shape (m, 3), m, world frame; the base without states."""
    parts = [picture.positions[picture.known].reshape(-1, 3), *(goal.position[None] for goal in picture.goals)]
    for mark in picture.marks:
        parts += [] if mark.point is None else [mark.point[None]]
        parts += [] if mark.positions is None else [mark.positions]
    return np.concatenate(parts if picture.known.any() else [*parts, picture.scenario.base_position[None]])


def free_corner(picture: Picture, camera: Camera, corners: Sequence[str]) -> tuple[str, str]:
    """Returns the corner of a view that robot and scene leave most free, as ("left" or "right", "top" or "bottom").

    Args:
        picture: What is shown.
        camera: How it is seen.
        corners: Of "lower left", "lower right", "upper left" and "upper right", the first preferred.
    """
    body = body_points(picture)
    place = camera.project(points_to_fit(picture, body))[:, :2] / [camera.width, camera.height]
    low = min(
        corners,
        key=lambda corner: int(
            (
                (np.abs(place[:, 0] - (1.0 if "right" in corner else 0.0)) < _CORNER)
                & (np.abs(place[:, 1] - (1.0 if "lower" in corner else 0.0)) < 1.5 * _CORNER)
            ).sum()
        ),
    )
    return ("right" if "right" in low else "left"), ("bottom" if "lower" in low else "top")


def look_from(azimuth_deg: float, elevation_deg: float, up: FloatArray) -> FloatArray:
    """Returns camera_from_world, shape (3, 3), of a viewer at an azimuth about `up`, so far above the horizon."""
    helper = np.eye(3)[np.argmin(np.abs(up))]
    east = np.cross(helper, up)
    east /= np.linalg.norm(east)
    north = np.cross(up, east)
    azimuth, elevation = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    level = np.cos(azimuth) * east + np.sin(azimuth) * north
    towards = np.cos(elevation) * level + np.sin(elevation) * up
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(towards, right), towards])


def _hull_area(points: FloatArray) -> float:
    try:
        return float(ConvexHull(points).volume)  # in the plane scipy calls the area a volume
    except (QhullError, ValueError):  # points on a line
        return float(np.linalg.norm(np.ptp(points, axis=0))) * 1e-9


def points_to_fit(picture: Picture, body: FloatArray) -> FloatArray:
    """The robot, and the scene as far as it is near; all of it where it is not much larger than the robot's reach."""
    low, high = body.min(axis=0), body.max(axis=0)
    reach = max(float((high - low).max()), picture.robot.length)
    vertices = np.concatenate([body, *(mesh.vertices for mesh in picture.meshes)])
    if np.ptp(vertices, axis=0).max() < _WHOLE_SCENE * reach:
        return vertices
    return vertices[((vertices > low - 0.45 * reach) & (vertices < high + 0.45 * reach)).all(axis=1)]


def _fit(rotation: FloatArray, points: FloatArray, width: int, height: int, margin: float) -> Camera:
    local = points @ rotation.T
    low, high = local.min(axis=0), local.max(axis=0)
    span = np.maximum(high - low, 1e-6)
    scale = (1.0 - 2.0 * margin) * min(width / span[0], height / span[1])
    return Camera(rotation, rotation.T @ (0.5 * (low + high)), float(scale), width, height)
