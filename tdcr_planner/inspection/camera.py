"""The camera: where it sits on the last disk, what its picture covers, and its pose in the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.planning.scenario import Scenario

_PARALLEL = 1e-6


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera on the last disk.

    Attributes:
        position: Its centre of projection, shape (3,), m, last disk's frame.
        axes: disk_from_camera: columns right, up and the optical axis, shape (3, 3); left-handed, as pictures are.
        tangents: Tangents of half the opening angles: (t, t) of a cone, (width, height) of a rectangle, shape (2,).
        rectangular: Whether the picture is a rectangle.
        range_m: Least and largest working distance.
        max_incidence_deg: Largest angle between line of sight and the surface's normal.
        pixels: Width and height of the picture, or None.
    """

    position: FloatArray
    axes: FloatArray
    tangents: FloatArray
    rectangular: bool
    range_m: tuple[float, float]
    max_incidence_deg: float
    pixels: tuple[int, int] | None = None

    @property
    def farthest_tangent(self) -> float:
        """Tangent of the angle between the optical axis and the outermost line of sight."""
        return float(np.hypot(*self.tangents)) if self.rectangular else float(self.tangents[0])

    @property
    def cosine_of_incidence(self) -> float:
        """Least cosine of the angle of incidence."""
        return float(np.cos(np.deg2rad(self.max_incidence_deg)))

    def poses(self, positions: FloatArray, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns the camera's centres, shape (n, 3), m, and world_from_camera, shape (n, 3, 3), of the robot's states.

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).
        """
        last = rotations[:, -1]
        return np.ascontiguousarray(positions[:, -1] + last @ self.position), np.ascontiguousarray(last @ self.axes)

    def pixel_size(self, distance: FloatArray, incidence_cosine: FloatArray) -> FloatArray:
        """Returns the length on a surface that one pixel covers, along the steepest direction, shape as given, m."""
        if self.pixels is None:
            return np.full_like(distance, np.nan)
        across = 2.0 * float((self.tangents / np.asarray(self.pixels)).max())
        return np.asarray(distance * across / np.maximum(incidence_cosine, 1e-9))


def make_camera(table: Any) -> Camera:
    """Returns the camera that a table describes; see `CameraTable` for its keys.

    Raises:
        InputError: It sees nothing: its range is empty, or an angle is 0.
    """
    low, high = (float(value) for value in table.range_m)
    if not 0.0 <= low < high:
        raise InputError("camera.range_m", "[least, largest] distance with 0 <= least < largest", [low, high])
    if not 0.0 < table.max_incidence_deg <= 90.0:
        raise InputError("camera.max_incidence_deg", "an angle above 0 and up to 90 degrees", table.max_incidence_deg)
    angles = np.atleast_1d(np.asarray(table.field_of_view_deg, dtype=np.float64))
    if not ((angles > 0.0) & (angles < 180.0)).all():
        raise InputError("camera.field_of_view_deg", "angles above 0 and below 180 degrees", angles.tolist())
    forward = np.asarray(table.direction, dtype=np.float64)
    forward = forward / np.linalg.norm(forward)
    given = getattr(table, "up", None)
    up = np.array([1.0, 0.0, 0.0]) if given is None else np.asarray(given, dtype=np.float64)
    up = up - (up @ forward) * forward
    if np.linalg.norm(up) < _PARALLEL:
        if given is not None:
            raise InputError("camera.up", "a direction that is not the optical axis", list(given))
        up = np.array([0.0, 0.0, 1.0]) - forward[2] * forward
    up = up / np.linalg.norm(up)
    right = np.cross(forward, up)
    pixels = getattr(table, "pixels", None)
    return Camera(
        position=np.asarray(table.position_m, dtype=np.float64),
        axes=np.stack([right, up, forward], axis=1),
        tangents=np.tan(np.deg2rad(0.5 * np.broadcast_to(angles, 2))),
        rectangular=len(angles) == 2,
        range_m=(low, high),
        max_incidence_deg=float(table.max_incidence_deg),
        pixels=None if pixels is None else (int(pixels[0]), int(pixels[1])),
    )


def scenario_camera(scenario: Scenario) -> Camera:
    """Returns the camera of a scenario: that of its `[inspect]`, or else its robot's.

    Raises:
        InputError: Neither has one.
    """
    inspect = scenario.file.inspect
    table = None if inspect is None else inspect.camera
    if table is None:
        table = getattr(scenario.robot, "camera", None)
    if table is None:
        raise InputError("camera", "a [camera] in the robot file or [inspect.camera] in the scenario", "neither")
    return make_camera(table)
