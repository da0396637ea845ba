"""Where to look from: the direction that shows a robot's motion best, and what fits into the picture."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tdcr_planner.arrays import FloatArray
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera

_ELEVATIONS_DEG = (8.0, 16.0, 24.0)
_AZIMUTHS = 24


def choose_camera(picture: Picture, width: int, height: int, margin: float = 0.07) -> Camera:
    """Returns the camera under which the robot's states and goals fill the largest part of the picture.

    Up is against gravity (world z without gravity). Directions a little above the horizon are compared, each fitted to
    the robot and to that part of the scene that surrounds it.

    Args:
        picture: What is shown.
        width: Pixels.
        height: Pixels.
        margin: Part of the picture left free on each side.
    """
    body = body_points(picture)
    fitted = _points_to_fit(picture, body)
    few = fitted[:: max(1, len(fitted) // 2000)]
    up = up_direction(picture)
    best, best_score = look_from(0.0, 20.0, up), -1.0
    for elevation in _ELEVATIONS_DEG:
        for step in range(_AZIMUTHS):
            rotation = look_from(360.0 * step / _AZIMUTHS, elevation, up)
            scale = _fit(rotation, few, width, height, margin).scale
            score = scale**2 * _hull_area((body @ rotation.T)[:, :2])
            if score > 1.0001 * best_score:
                best, best_score = rotation, score
    return _fit(best, fitted, width, height, margin)


def up_direction(picture: Picture) -> FloatArray:
    """Returns the direction against gravity, shape (3,), world frame; z where there is none."""
    gravity = picture.scenario.gravity
    size = float(np.linalg.norm(gravity))
    return np.array([0.0, 0.0, 1.0]) if size < 1e-9 else -gravity / size


def body_points(picture: Picture) -> FloatArray:
    """Returns the disk centres of all states, the goals, and the base, shape (m, 3), m, world frame."""
    parts = [picture.positions[picture.known].reshape(-1, 3), picture.scenario.base_position[None]]
    parts += [goal.position[None] for goal in picture.goals]
    return np.concatenate(parts)


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


def _points_to_fit(picture: Picture, body: FloatArray) -> FloatArray:
    """The robot with room about it, and the scene as far as it is near."""
    low, high = body.min(axis=0), body.max(axis=0)
    reach = 0.45 * max(float((high - low).max()), picture.robot.length)
    parts = [body]
    for mesh in picture.meshes:
        near = ((mesh.vertices > low - reach) & (mesh.vertices < high + reach)).all(axis=1)
        parts.append(mesh.vertices[near])
    return np.concatenate(parts)


def _fit(rotation: FloatArray, points: FloatArray, width: int, height: int, margin: float) -> Camera:
    local = points @ rotation.T
    low, high = local.min(axis=0), local.max(axis=0)
    span = np.maximum(high - low, 1e-6)
    scale = (1.0 - 2.0 * margin) * min(width / span[0], height / span[1])
    return Camera(rotation, rotation.T @ (0.5 * (low + high)), float(scale), width, height)
