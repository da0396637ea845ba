"""The scene as an image: far walls, the robot's states one over the other, and the near walls as glass before them."""

from __future__ import annotations

from copy import copy

import numpy as np
from matplotlib.colors import to_rgb
from scipy.ndimage import gaussian_filter

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.roles import MESH_ROLES
from tdcr_planner.report import plots, raster
from tdcr_planner.report.body_mesh import part_mesh, shaft_mesh, sleeve_mesh
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera, Image, Layer
from tdcr_planner.report.robot_mesh import (
    Mesh,
    backbone_curve,
    disk_mesh,
    merge_meshes,
    tendon_lines,
    tube_mesh,
)
from tdcr_planner.report.tendon_style import tendon_colour

SHOWN_STATES = 6
_SUPERSAMPLING = 2
_INNER_COVER = 0.4
# The sleeve is glass: the disks and tendons in it are seen.
_SLEEVE_COVER = 0.38
_MARK_COVER = 0.5


def render_scene(picture: Picture, camera: Camera, states: IntArray, fades: FloatArray) -> Image:
    """Returns the scene and some states of the robot as an image; see `SceneRenderer.render`."""
    return SceneRenderer(picture, camera).render(states, fades)


class SceneRenderer:
    """One view of a scene, whose walls are painted once for all the images of the robot in it."""

    def __init__(self, picture: Picture, camera: Camera) -> None:
        """Paints the walls as they are seen from a camera."""
        self._picture = picture
        self._walls = _Canvas(camera, _SUPERSAMPLING)
        self._walls.paint_walls(picture)
        self._trace = _trace_mesh(picture, self._walls.camera)

    def render(self, states: IntArray, fades: FloatArray) -> Image:
        """Returns the scene and some states of the robot as an image of the camera's size, shape (h, w, 3) in 0 to 1.

        Args:
            states: Indices of the states, painted in this order, shape (n,).
            fades: How present each state is, 0 to 1, shape (n,).
        """
        canvas, picture = self._walls.with_own_image(), self._picture
        robots = [
            _robot_mesh(picture, int(state), canvas.camera, float(fade))
            for state, fade in zip(states, fades, strict=True)
        ]
        if robots:
            canvas.paint_shadow(robots[-1][0])
        step = float(picture.robot.disk_radii.max())
        for (mesh, colours), state, fade in zip(robots, states, fades, strict=True):
            canvas.paint_body(mesh, colours, float(fade), step)
            sleeve = sleeve_mesh(picture.body, picture.positions[state], picture.rotations[state], sides=40)
            canvas.paint_body(sleeve, _of_one_colour(sleeve, plots.SLEEVE), _SLEEVE_COVER * float(fade), step)
        for mesh in _marked_meshes(picture, canvas.camera):
            canvas.paint_body(mesh, _of_one_colour(mesh, plots.ALERT), _MARK_COVER, step)
        if self._trace is not None:
            canvas.paint_body(self._trace, _of_one_colour(self._trace, plots.TRACE), 0.9, np.inf)
        return _fade_border(raster.shrink(canvas.image, _SUPERSAMPLING))


def spread_states(picture: Picture, most: int = SHOWN_STATES) -> tuple[IntArray, FloatArray]:
    """Returns states evenly spread over the body's motion, and how present each is: pale first, the last one solid."""
    known = np.flatnonzero(picture.known)
    if len(known) == 0:
        return known, np.zeros(0)
    steps = np.linalg.norm(np.diff(picture.positions[known], axis=0), axis=2).mean(axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, travelled[-1], most)
    # a float sum may end a hair below its own last entry
    places = np.unique(np.searchsorted(travelled, wanted * (1.0 - 1e-12)).clip(0, len(known) - 1))
    fades = np.linspace(0.25, 0.5, len(places))
    fades[-1] = 1.0
    return known[places], fades


def _fade_border(image: Image, width: int = 28) -> Image:
    """Lets an image fade to white at its border, so that a scene that goes on beyond it is not cut off hard."""
    rows, columns = (np.arange(size) for size in image.shape[:2])
    fades = [np.clip((np.minimum(place, place[::-1]) + 1.0) / width, 0.0, 1.0) for place in (rows, columns)]
    fade = np.minimum.outer(*fades).astype(np.float32)[..., None]
    return np.asarray(1.0 - fade * (1.0 - image))


class _Canvas:
    """An image in the making, finer than what is asked for, with the glass that stands before what is painted next."""

    def __init__(self, camera: Camera, factor: int) -> None:
        self.camera = Camera(
            camera.rotation, camera.centre, factor * camera.scale, factor * camera.width, factor * camera.height
        )
        shape = (self.camera.height, self.camera.width)
        self.image = np.ones((*shape, 3), dtype=np.float32)
        self._glass = np.zeros(shape, dtype=np.float32)
        self._glass_nearness = np.full(shape, -np.inf, dtype=np.float32)

    def with_own_image(self) -> _Canvas:
        """Returns the same canvas to paint on without changing this one."""
        other = copy(self)
        other.image = self.image.copy()
        return other

    def paint_walls(self, picture: Picture) -> None:
        """Paints the far walls and, over them, the near ones as glass."""
        for role in MESH_ROLES.values():
            parts = [(mesh.vertices, mesh.faces) for mesh in picture.meshes if mesh.role == role.name]
            if not parts:
                continue
            mesh = merge_meshes(parts)
            colour = np.array(to_rgb(role.wall.paint), dtype=np.float32)
            far = raster.render_layer(self.camera, *mesh, farthest=True)
            seen = far.nearness[far.seen]
            depths = (float(seen.min()), float(seen.max())) if seen.size else None
            cover = np.where(far.seen, role.wall.far_cover, 0.0).astype(np.float32)
            raster.lay_over(
                self.image, far, raster.shade(far, colour, gloss=0.0, ambient=0.62, depth_range=depths), cover
            )
            near = raster.render_layer(self.camera, *mesh)
            # walls between the nearest and the farthest: a plate across a pipe, a branch before another
            inner = raster.render_layer(self.camera, *mesh, behind=near)
            between = inner.seen & (inner.nearness > far.nearness + 1.0 / self.camera.scale)
            cover = np.where(between, _INNER_COVER, 0.0).astype(np.float32)
            raster.lay_over(self.image, inner, raster.shade(inner, 0.92 * colour, ambient=0.5), cover)
            self._paint_glass(near, 0.86 * colour, *role.wall.glass)

    def _paint_glass(self, near: Layer, colour: Image, base: float, rise: float) -> None:
        grazing = (1.0 - near.normals[..., 2]) ** 3
        cover = np.where(near.seen, base + rise * grazing, 0.0).astype(np.float32)
        raster.lay_over(self.image, near, raster.shade(near, colour, gloss=0.35, ambient=0.55), cover)
        glass = self._glass[near.rows, near.columns]
        nearness = self._glass_nearness[near.rows, near.columns]
        glass[:] = np.where(near.nearness > nearness, cover, glass)
        np.maximum(nearness, near.nearness, out=nearness)

    def paint_shadow(self, mesh: Mesh) -> None:
        """Darkens softly what lies behind a body, so that it stands off from the wall."""
        layer = raster.render_layer(self.camera, *mesh)
        block = 8
        mask = np.zeros((self.camera.height, self.camera.width), dtype=np.float32)
        mask[layer.rows, layer.columns] = layer.seen
        rows, columns = (self.camera.height // block, self.camera.width // block)
        small = mask[: rows * block, : columns * block].reshape(rows, block, columns, block).mean(axis=(1, 3))
        soft = gaussian_filter(np.roll(small, (1, 1), axis=(0, 1)), 2.0)
        shadow = np.ones_like(mask)
        shadow[: rows * block, : columns * block] -= 0.28 * np.kron(soft, np.ones((block, block), dtype=np.float32))
        walls = np.isfinite(self._glass_nearness)
        self.image[walls] *= shadow[walls][:, None]

    def paint_body(self, mesh: Mesh, colours: Image, fade: float, step: float) -> None:
        """Paints a body behind the glass that stands before it.

        Args:
            mesh: Vertices and faces, m, world frame.
            colours: Colour of each face, shape (f, 3).
            fade: How present it is, 0 to 1.
            step: Outlines are drawn where the surface falls back by a quarter of this, m.
        """
        layer = raster.render_layer(self.camera, *mesh)
        colour = raster.shade(layer, colours, ambient=0.5)
        colour[raster.outline(layer, 0.25 * step)] *= 0.6
        glass = self._glass[layer.rows, layer.columns]
        hidden = np.where(self._glass_nearness[layer.rows, layer.columns] > layer.nearness, glass, 0.0)
        cover = np.where(layer.seen, fade * (1.0 - 0.75 * hidden), 0.0).astype(np.float32)
        raster.lay_over(self.image, layer, colour, cover)


def _robot_mesh(picture: Picture, state: int, camera: Camera, fade: float) -> tuple[Mesh, Image]:
    """The robot in one state, no part thinner than the eye can see, and the colour of each face."""
    robot, positions, rotations = picture.robot, picture.positions[state], picture.rotations[state]
    pixel = 1.0 / camera.scale
    line = backbone_curve(positions, rotations, robot.arc_lengths)
    meshes = [
        disk_mesh(robot, positions, rotations, sides=40),
        tube_mesh(line, max(robot.backbone.radius_m, 2.0 * pixel)),
    ]
    colours = [plots.ROBOT, plots.INK]
    for tendon, points in enumerate(tendon_lines(robot, positions, rotations)):
        meshes.append(tube_mesh(points, max(robot.body.tendon_radius_m, 1.4 * pixel), sides=6))
        colours.append(tendon_colour(tendon))
    meshes.append(shaft_mesh(picture.body, positions, rotations, sides=40))
    colours.append(plots.SHAFT)
    pale = 0.0 if fade >= 1.0 else 0.25
    shades = [np.array(to_rgb(colour)) * (1.0 - pale) + pale for colour in colours]
    each = [np.tile(shade, (len(faces), 1)) for shade, (_, faces) in zip(shades, meshes, strict=True)]
    return merge_meshes(meshes), np.concatenate(each).astype(np.float32)


def _of_one_colour(mesh: Mesh, colour: str) -> Image:
    return np.tile(np.array(to_rgb(colour), dtype=np.float32), (len(mesh[1]), 1))


def _marked_meshes(picture: Picture, camera: Camera) -> list[Mesh]:
    """What is marked of bodies: configurations as their disks, and the parts that are named, in one mesh each."""
    robot, pixel, meshes = picture.robot, 1.0 / camera.scale, []
    for mark in picture.marks:
        positions, rotations = mark.positions, mark.rotations
        if positions is not None and rotations is not None:
            line = backbone_curve(positions, rotations, robot.arc_lengths)
            backbone = tube_mesh(line, max(robot.backbone.radius_m, 2.0 * pixel))
            meshes.append(merge_meshes([disk_mesh(robot, positions, rotations, sides=40), backbone]))
        elif not picture.has_path and picture.known.all():
            positions, rotations = picture.positions[0], picture.rotations[0]
        if positions is None or rotations is None or not mark.part:
            continue
        room = 0.06 * float(robot.disk_radii.max())
        parts = [part_mesh(picture.body, positions, rotations, name, room) for name in mark.part.split(" and ")]
        meshes += [part for part in parts if part is not None]
    return meshes


def _trace_mesh(picture: Picture, camera: Camera) -> Mesh | None:
    """The way of the tip as a thin tube; None where it does not move."""
    tips = picture.positions[picture.known][:, -1]
    apart = np.ones(len(tips), dtype=np.bool_)
    apart[1:] = np.linalg.norm(np.diff(tips, axis=0), axis=1) > 1e-7
    if apart.sum() < 2:
        return None
    return tube_mesh(tips[apart], 3.2 / camera.scale)
