"""The tip view: what the camera sees from a state, drawn in perspective."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.inspection.camera import Camera
from tdcr_planner.report import raster
from tdcr_planner.report.coverage_map import PaintedMesh

_NEAR_M = 5e-4  # triangles are cut this far before the camera
_EDGE = 1.12  # half width of the picture, in tangents of the outermost line of sight
_SUPERSAMPLING = 2
_DARKEST = 0.12
_BEYOND = np.array([0.06, 0.07, 0.09])
_OUTSIDE = 0.35  # brightness of what lies outside of the field of view
_DIM = 0.55  # brightness of what is out of the working range


@dataclass(frozen=True, eq=False)
class TipScene:
    """All surfaces, painted, in one piece.

    Attributes:
        vertices: Shape (v, 3), m, world frame.
        faces: Shape (f, 3).
        colours: Colour of each face, shape (f, 3), 0 to 1.
    """

    vertices: FloatArray
    faces: IntArray
    colours: FloatArray

    @classmethod
    def of(cls, painted: list[PaintedMesh]) -> TipScene:
        """Returns painted meshes in one piece."""
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in painted)])
        return cls(
            np.concatenate([mesh.vertices for mesh in painted]),
            np.concatenate([mesh.faces + offset for mesh, offset in zip(painted, offsets, strict=False)]),
            np.concatenate([mesh.colours for mesh in painted]),
        )


def draw_tip_view(
    scene: TipScene, camera: Camera, centre: FloatArray, frame: FloatArray, up: FloatArray, size: int
) -> raster.Image:
    """Returns what a camera sees, shape (size, size, 3), 0 to 1, lit from the camera.

    What lies outside of the field of view, whose edge is drawn, and beyond the working range is darker. A tick at the
    edge points up, and a faint line is the horizon.

    Args:
        scene: The surfaces.
        camera: The camera.
        centre: Its centre, shape (3,), m, world frame.
        frame: world_from_camera, shape (3, 3).
        up: Direction that is up in the world, shape (3,).
        size: Pixels of a side.
    """
    local = (scene.vertices - centre) @ frame
    pixels = _SUPERSAMPLING * size
    edge = _EDGE * camera.farthest_tangent
    faces, points, parents = _cut(local, scene.faces, edge)
    # A perspective picture is the parallel picture of (x / z, y / z, 1 / z): what is straight stays straight.
    flat = np.stack([points[:, 0] / points[:, 2], points[:, 1] / points[:, 2], 1.0 / points[:, 2]], axis=1)
    view = raster.Camera(np.eye(3), np.zeros(3), 0.5 * pixels / edge, pixels, pixels)
    layer = raster.render_layer(view, flat, faces)
    image = np.tile(_BEYOND.astype(np.float32), (pixels, pixels, 1))
    if layer.seen.any():
        corners = points[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        middles = corners.mean(axis=1)
        lean = np.abs((normals * middles).sum(axis=1))
        lean /= np.maximum(np.linalg.norm(normals, axis=1) * np.linalg.norm(middles, axis=1), 1e-30)
        seen = layer.face[layer.seen]
        distance = 1.0 / np.maximum(layer.nearness[layer.seen], 1e-6)
        low, high = camera.range_m
        light = (_DARKEST + (1.0 - _DARKEST) * lean[seen]) * np.where((distance > high) | (distance < low), _DIM, 1.0)
        part = image[layer.rows, layer.columns]
        part[layer.seen] = (scene.colours[parents[seen]] * light[:, None]).astype(np.float32)
    return _with_edge(raster.shrink(image, _SUPERSAMPLING), camera, frame, up, edge)


def _cut(local: FloatArray, faces: IntArray, edge: float) -> tuple[IntArray, FloatArray, IntArray]:
    """Returns triangles before the camera, cut at the near plane: faces, points, and the face that each comes from.

    Triangles all of whose corners lie beyond one side of the picture, `edge` its tangent, are left out.
    """
    ahead = local[:, 2] > _NEAR_M
    limit = edge * local[:, 2]
    x, y = local[:, 0], local[:, 1]
    beyond = np.stack([x > limit, x < -limit, y > limit, y < -limit], axis=1)
    out: BoolArray = np.asarray(beyond[faces].all(axis=1))
    inside = np.flatnonzero(~out.any(axis=1))
    count = np.zeros(len(faces), dtype=np.int64)
    count[inside] = ahead[faces[inside]].sum(axis=1)
    whole = np.flatnonzero(count == 3)
    new_points, new_faces, parents = [], [], []
    total = len(local)
    for face in np.flatnonzero((count == 1) | (count == 2)).tolist():
        polygon: list[FloatArray] = []
        corners = local[faces[face]]
        for corner, following in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if corner[2] > _NEAR_M:
                polygon.append(corner)
            if (corner[2] > _NEAR_M) != (following[2] > _NEAR_M):
                share = (_NEAR_M - corner[2]) / (following[2] - corner[2])
                polygon.append(corner + share * (following - corner))
        for index in range(1, len(polygon) - 1):
            new_points += [polygon[0], polygon[index], polygon[index + 1]]
            new_faces.append([total, total + 1, total + 2])
            parents.append(face)
            total += 3
    points = local.copy()
    points[~ahead, 2] = 1.0  # of no face that is left
    if new_points:
        points = np.concatenate([points, np.array(new_points)])
        kept = np.concatenate([faces[whole], np.array(new_faces, dtype=np.int64)])
        return kept, points, np.concatenate([whole, np.array(parents, dtype=np.int64)])
    return faces[whole], points, whole


def _with_edge(image: raster.Image, camera: Camera, frame: FloatArray, up: FloatArray, edge: float) -> raster.Image:
    """Returns a picture with the edge of the field of view, the horizon and a tick that points up."""
    size = len(image)
    place = (np.arange(size) + 0.5) / size * 2.0 * edge - edge
    x, y = np.meshgrid(place, -place)
    if camera.rectangular:
        out = np.maximum(np.abs(x) / camera.tangents[0], np.abs(y) / camera.tangents[1]) - 1.0
    else:
        out = np.hypot(x, y) / camera.tangents[0] - 1.0
    width = 2.0 * edge / size / float(camera.tangents.max())
    image = image.copy()
    image[out > 0.0] *= _OUTSIDE
    image[np.abs(out) < 1.2 * width] = (0.95, 0.95, 0.95)
    local = frame.T @ up
    # On the horizon lines of sight are at right angles to up: local . (x, y, 1) = 0.
    level = np.abs(local[0] * x + local[1] * y + local[2]) / max(float(np.linalg.norm(local[:2])), 1e-9)
    horizon = (level < 0.5 * 2.0 * edge / size) & (out <= 0.0)
    image[horizon] = 0.55 * image[horizon] + 0.45
    if np.linalg.norm(local[:2]) > 1e-3:
        across = local[:2] / np.linalg.norm(local[:2])
        along, aside = x * across[0] + y * across[1], np.abs(x * across[1] - y * across[0])
        tick = (along > 0.0) & (aside < 0.03 * edge * (1.0 - along / edge) * 4.0) & (out > 0.0) & (along < edge)
        image[tick] = (1.0, 0.85, 0.2)
    return image


def write_tip_video(views: list[raster.Image], file: str | Path, *, rate: int = 8) -> None:
    """Writes tip views as an animated GIF.

    Args:
        views: The pictures in order, shape (h, w, 3), 0 to 1.
        file: The GIF.
        rate: Pictures a second.
    """
    shots = [Image.fromarray(raster.to_bytes(view)) for view in views]
    shots[0].save(file, format="GIF", save_all=True, append_images=shots[1:], duration=1000 // rate, loop=0)
