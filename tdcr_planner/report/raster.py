"""A small renderer: triangles to depth, normal and colour images without a display, and layers laid over each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.compiled import njit

Image = NDArray[np.float32]
_CREASE_COSINE = float(np.cos(np.deg2rad(35.0)))


@dataclass(frozen=True)
class Camera:
    """A parallel projection.

    Attributes:
        rotation: camera_from_world, shape (3, 3): rows point right, up and towards the viewer.
        centre: World point in the middle of the image, shape (3,), m.
        scale: Pixels a metre.
        width: Pixels.
        height: Pixels.
    """

    rotation: FloatArray
    centre: FloatArray
    scale: float
    width: int
    height: int

    def project(self, points: FloatArray) -> FloatArray:
        """Returns pixel x (right), pixel y (down) and nearness (m, larger is nearer) of points (..., 3) in m."""
        local = (points - self.centre) @ self.rotation.T
        x = 0.5 * self.width + self.scale * local[..., 0]
        y = 0.5 * self.height - self.scale * local[..., 1]
        return np.stack([x, y, local[..., 2]], axis=-1)


@dataclass(frozen=True)
class Layer:
    """One surface seen from the camera, in the part of the image that it may cover.

    Attributes:
        rows: The rows of the image that are covered.
        columns: The columns of the image that are covered.
        nearness: Shape (h, w) of that part, m; -inf where nothing is seen.
        normals: Shape (h, w, 3), camera frame, facing the viewer.
        face: Index of the face that is seen, shape (h, w); -1 where nothing is.
    """

    rows: slice
    columns: slice

    nearness: Image
    normals: Image
    face: NDArray[np.int32]

    @property
    def seen(self) -> BoolArray:
        """Where something is seen, shape (h, w)."""
        return self.face >= 0


def corner_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Returns a unit normal for each corner, shape (f, 3, 3): smooth over a surface, sharp at its edges."""
    corners = vertices[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    smooth = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(smooth, faces[:, corner], flat)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-30)
    result = smooth[faces]
    sharp = np.einsum("fcj,fj->fc", result, flat) < _CREASE_COSINE
    return np.where(sharp[..., None], flat[:, None], result)


def render_layer(
    camera: Camera, vertices: FloatArray, faces: IntArray, *, farthest: bool = False, behind: Layer | None = None
) -> Layer:
    """Returns the nearest (or the farthest) surface of a mesh at each pixel.

    Args:
        camera: Where to look from.
        vertices: Shape (v, 3), m, world frame.
        faces: Shape (f, 3).
        farthest: Keep the surface that is farthest from the viewer: of a tube, the wall behind what is in it.
        behind: Leave out what is not behind this layer of the same mesh.
    """
    points = camera.project(vertices)[faces]
    normals = corner_normals(vertices, faces) @ camera.rotation.T
    size = np.array([camera.width, camera.height])
    flat = points[..., :2].reshape(-1, 2)
    left, top = np.clip(np.floor(flat.min(axis=0, initial=np.inf)), 0, size).astype(int)
    right, bottom = np.clip(np.ceil(flat.max(axis=0, initial=-np.inf)), [left, top], size).astype(int)
    points[..., :2] -= [left, top]
    height, width = bottom - top, right - left
    sign = -1.0 if farthest else 1.0
    nearness = np.full((height, width), -np.inf, dtype=np.float32)
    image = np.zeros((height, width, 3), dtype=np.float32)
    face = np.full((height, width), -1, dtype=np.int32)
    # half a pixel of depth, so that a surface is not behind itself
    limit = (
        np.full((height, width), np.inf, dtype=np.float32) if behind is None else behind.nearness - 0.5 / camera.scale
    )
    arrays = (np.ascontiguousarray(points), np.ascontiguousarray(normals), limit.astype(np.float32))
    _fill_triangles(*arrays, sign, nearness, image, face)
    seen = face >= 0
    nearness[seen] *= sign
    image /= np.maximum(np.linalg.norm(image, axis=-1, keepdims=True), 1e-12)
    image *= np.where(image[..., 2:] < 0.0, -1.0, 1.0)
    return Layer(slice(top, bottom), slice(left, right), nearness, image, face)


@njit(cache=True)
def _fill_triangles(
    points: FloatArray,
    normals: FloatArray,
    limit: Image,
    sign: float,
    nearness: Image,
    image: Image,
    face: NDArray[np.int32],
) -> None:
    height, width = nearness.shape
    for f in range(points.shape[0]):
        x0, y0, z0 = points[f, 0, 0], points[f, 0, 1], points[f, 0, 2]
        x1, y1, z1 = points[f, 1, 0], points[f, 1, 1], points[f, 1, 2]
        x2, y2, z2 = points[f, 2, 0], points[f, 2, 1], points[f, 2, 2]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if abs(area) < 1e-9:
            continue
        left = max(0, int(np.ceil(min(x0, x1, x2) - 0.5)))
        right = min(width - 1, int(np.floor(max(x0, x1, x2) - 0.5)))
        top = max(0, int(np.ceil(min(y0, y1, y2) - 0.5)))
        bottom = min(height - 1, int(np.floor(max(y0, y1, y2) - 0.5)))
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                x = column + 0.5
                a = ((x1 - x) * (y2 - y) - (x2 - x) * (y1 - y)) / area
                b = ((x2 - x) * (y0 - y) - (x0 - x) * (y2 - y)) / area
                c = 1.0 - a - b
                if a < 0.0 or b < 0.0 or c < 0.0:
                    continue
                z = a * z0 + b * z1 + c * z2
                if z >= limit[row, column]:
                    continue
                z *= sign
                if z > nearness[row, column]:
                    nearness[row, column] = z
                    face[row, column] = f
                    for k in range(3):
                        image[row, column, k] = a * normals[f, 0, k] + b * normals[f, 1, k] + c * normals[f, 2, k]


def shade(
    layer: Layer,
    colours: Image | FloatArray,
    *,
    gloss: float = 0.25,
    ambient: float = 0.40,
    depth_range: tuple[float, float] | None = None,
) -> Image:
    """Returns the lit colour of a layer, shape (h, w, 3) in 0 to 1; black where nothing is seen.

    Args:
        layer: What is seen.
        colours: Colour of each face, shape (f, 3), or of all, shape (3,).
        gloss: Strength of the highlight.
        ambient: Light that reaches every side, 0 to 0.9.
        depth_range: Nearness (far, near) over which colours fade towards white with distance, m; None for no fading.
    """
    seen = layer.seen
    normals = layer.normals[seen]
    base = colours.astype(np.float32) if colours.ndim == 1 else colours[layer.face[seen]]
    key = np.array([-0.45, 0.65, 0.62], dtype=np.float32)
    key /= np.linalg.norm(key)
    half = key + np.array([0.0, 0.0, 1.0], dtype=np.float32)
    half /= np.linalg.norm(half)
    diffuse = np.clip(normals @ key, 0.0, 1.0)
    sky = 0.5 + 0.5 * normals[:, 1]
    light = ambient + 0.17 * sky + (0.90 - ambient) * diffuse
    highlight = np.clip(normals @ half, 0.0, 1.0)
    for _ in range(5):  # to the 32nd power
        highlight *= highlight
    lit = base * light[:, None] + (gloss * highlight)[:, None]
    if depth_range is not None:
        far, near = depth_range
        distance = np.clip((near - layer.nearness[seen]) / max(near - far, 1e-9), 0.0, 1.0)
        lit += (1.0 - lit) * (0.35 * distance)[:, None]
    image = np.zeros(layer.normals.shape, dtype=np.float32)
    image[seen] = np.clip(lit, 0.0, 1.0)
    return image


def outline(layer: Layer, step: float) -> BoolArray:
    """Returns where a layer ends or falls back by more than `step` (m) from one pixel to the next, shape (h, w)."""
    seen = layer.seen
    z = np.where(seen, layer.nearness, np.float32(-1e6))
    edge = np.zeros(z.shape, dtype=np.bool_)
    for axis in (0, 1):
        for shift in (-1, 1):
            other = np.roll(z, shift, axis=axis)
            edge |= seen & (z - other > step)
    return edge


def lay_over(image: Image, layer: Layer, colour: Image, cover: Image) -> None:
    """Paints a layer over the whole image in place.

    Args:
        image: Shape (height, width, 3) of the camera.
        layer: What is painted.
        colour: Shape (h, w, 3) of the layer.
        cover: How much it hides, 0 to 1, shape (h, w) of the layer.
    """
    part = image[layer.rows, layer.columns]
    part += cover[..., None] * (colour - part)


def shrink(image: Image, factor: int) -> Image:
    """Returns an image averaged over blocks of factor x factor pixels, shape (h / factor, w / factor, 3)."""
    height, width = image.shape[0] // factor, image.shape[1] // factor
    return image.reshape(height, factor, width, factor, -1).mean(axis=(1, 3))


def to_bytes(image: Image) -> NDArray[np.uint8]:
    """Returns an image of 0 to 1 as bytes."""
    return np.round(255.0 * np.clip(image, 0.0, 1.0)).astype(np.uint8)
