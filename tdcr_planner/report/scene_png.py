"""The static picture: see-through walls and the robot along its path, with clearance and tensions beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.report import plots, raster
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera, Image
from tdcr_planner.report.robot_mesh import backbone_curve, disk_mesh, merge_meshes, tendon_lines, tube_mesh
from tdcr_planner.report.viewpoint import choose_camera

WIDTH_PX, HEIGHT_PX, DPI = 1600, 900, 120
SCENE_PX = (1010, 770)
_SUPERSAMPLING = 2
_SHOWN_STATES = 7
_BACKGROUND = np.ones(3, dtype=np.float32)


def write_png(picture: Picture, file: str | Path) -> None:
    """Writes the static picture of a result or a scenario, 1600 x 900 pixels."""
    with plots.plot_style():
        plots.save_figure(draw_figure(picture), file)


def draw_figure(picture: Picture) -> Figure:
    """Returns the static picture as a matplotlib figure that no global state knows."""
    figure = plots.new_figure(WIDTH_PX, HEIGHT_PX, DPI)
    wide = SCENE_PX if picture.has_path else (WIDTH_PX, SCENE_PX[1])
    draw_scene(figure, picture, (0, 0, *wide))
    if picture.has_path:
        left, width = (SCENE_PX[0] + 95) / WIDTH_PX, (WIDTH_PX - SCENE_PX[0] - 125) / WIDTH_PX
        upper = figure.add_axes((left, 0.505, width, 0.31))
        lower = figure.add_axes((left, 0.09, width, 0.31))
        _draw_time_plots(upper, lower, picture)
    _draw_header(figure, picture)
    return figure


def draw_scene(figure: Figure, picture: Picture, box: tuple[int, int, int, int]) -> Axes:
    """Draws scene, robot and markers into a part of a figure.

    Args:
        figure: The figure.
        picture: What is shown.
        box: Left, bottom, width and height, pixels of the figure.

    Returns:
        Axes in pixels of the box, y down.
    """
    left, bottom, width, height = box
    size = figure.get_size_inches() * figure.dpi
    axes = figure.add_axes((left / size[0], bottom / size[1], width / size[0], height / size[1]))
    camera = choose_camera(picture, width, height)
    image = render_scene(picture, camera)
    axes.imshow(raster.to_bytes(image), extent=(0.0, width, height, 0.0), interpolation="none", aspect="auto")
    axes.set_axis_off()
    _draw_markers(axes, picture, camera)
    _draw_scale_bar(axes, camera)
    return axes


def render_scene(picture: Picture, camera: Camera) -> Image:
    """Returns the scene and the robot's states as an image of the camera's size, shape (h, w, 3) in 0 to 1."""
    factor = _SUPERSAMPLING
    fine = Camera(camera.rotation, camera.centre, factor * camera.scale, factor * camera.width, factor * camera.height)
    image = np.tile(_BACKGROUND, (fine.height, fine.width, 1))
    glass, glass_nearness = _paint_walls(image, picture, fine)
    for index, fade in zip(*shown_states(picture), strict=True):
        _paint_robot(image, picture, fine, int(index), float(fade), glass, glass_nearness)
    _paint_trace(image, picture, fine, glass, glass_nearness)
    return raster.shrink(image, factor)


def shown_states(picture: Picture, most: int = _SHOWN_STATES) -> tuple[IntArray, FloatArray]:
    """Returns indices of states that are evenly spread over the body's motion, and how present each is, 0 to 1."""
    known = np.flatnonzero(picture.known)
    if len(known) == 0:
        return known, np.zeros(0)
    positions = picture.positions[known]
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=2).mean(axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, travelled[-1], most)
    places = np.unique(np.searchsorted(travelled, wanted - 1e-12).clip(0, len(known) - 1))
    fades = np.linspace(0.22, 0.5, len(places))
    fades[-1] = 1.0
    return known[places], fades


def _paint_walls(image: Image, picture: Picture, camera: Camera) -> tuple[Image, Image]:
    """Paints the far walls and then the near ones as glass; returns the glass's cover and nearness."""
    glass = np.zeros(image.shape[:2], dtype=np.float32)
    nearest = np.full(image.shape[:2], -np.inf, dtype=np.float32)
    colour = np.array(to_rgb(plots.WALL), dtype=np.float32)
    for role in ("cavity", "obstacle"):
        parts = [(mesh.vertices, mesh.faces) for mesh in picture.meshes if mesh.role == role]
        if not parts:
            continue
        vertices, faces = merge_meshes(parts)
        far = raster.render_layer(camera, vertices, faces, farthest=True)
        seen = far.seen
        depths = (float(far.nearness[seen].min()), float(far.nearness[seen].max())) if seen.any() else None
        cover = np.where(seen, 0.85 if role == "cavity" else 0.30, 0.0).astype(np.float32)
        raster.lay_over(image, raster.shade(far, colour, gloss=0.05, depth_range=depths), cover)
        near = raster.render_layer(camera, vertices, faces)
        grazing = (1.0 - near.normals[..., 2]) ** 3
        base, rise = (0.05, 0.45) if role == "cavity" else (0.42, 0.4)
        cover = np.where(near.seen, base + rise * grazing, 0.0).astype(np.float32)
        raster.lay_over(image, raster.shade(near, 0.9 * colour, gloss=0.5), cover)
        glass = np.where(near.nearness > nearest, cover, glass)
        nearest = np.maximum(nearest, near.nearness)
    return glass, nearest


def _behind_glass(layer: raster.Layer, glass: Image, glass_nearness: Image) -> Image:
    """How much of a layer comes through the glass before it, shape (h, w)."""
    hidden = np.where(glass_nearness > layer.nearness, glass, 0.0)
    return np.where(layer.seen, 1.0 - 0.75 * hidden, 0.0).astype(np.float32)


def _paint_robot(
    image: Image, picture: Picture, camera: Camera, index: int, fade: float, glass: Image, glass_nearness: Image
) -> None:
    robot, positions, rotations = picture.robot, picture.positions[index], picture.rotations[index]
    pixel = 1.0 / camera.scale
    white, ink = np.ones(3), np.array(to_rgb(plots.INK))
    disks = disk_mesh(robot, positions, rotations, sides=40)
    line = backbone_curve(positions, rotations, robot.arc_lengths)
    backbone = tube_mesh(line, max(robot.backbone.radius_m, 1.6 * pixel))
    parts, colours = [disks, backbone], [np.array(to_rgb(plots.ROBOT)), ink]
    for tendon, points in enumerate(tendon_lines(robot, positions, rotations)):
        parts.append(tube_mesh(points, max(robot.body.tendon_radius_m, 1.3 * pixel), sides=6))
        colours.append(np.array(to_rgb(plots.tendon_colour(tendon))))
    if fade < 1.0:
        colours = [0.75 * colour + 0.25 * white for colour in colours]
    vertices, faces = merge_meshes(parts)
    each = np.concatenate(
        [np.tile(colour, (len(part[1]), 1)) for colour, part in zip(colours, parts, strict=True)]
    ).astype(np.float32)
    layer = raster.render_layer(camera, vertices, faces)
    colour = raster.shade(layer, each)
    edges = raster.outline(layer, 0.25 * float(robot.disk_radii.max()))
    colour[edges] *= 0.55
    raster.lay_over(image, colour, (fade * _behind_glass(layer, glass, glass_nearness)).astype(np.float32))


def _paint_trace(image: Image, picture: Picture, camera: Camera, glass: Image, glass_nearness: Image) -> None:
    tips = picture.positions[picture.known][:, -1]
    if len(tips) < 2:
        return
    apart = np.concatenate([[True], np.linalg.norm(np.diff(tips, axis=0), axis=1) > 1e-7])
    if apart.sum() < 2:
        return
    layer = raster.render_layer(camera, *tube_mesh(tips[apart], 3.0 / camera.scale))
    colour = raster.shade(layer, np.array(to_rgb(plots.TRACE), dtype=np.float32))
    raster.lay_over(image, colour, (0.9 * _behind_glass(layer, glass, glass_nearness)).astype(np.float32))


def _draw_markers(axes: Axes, picture: Picture, camera: Camera) -> None:
    """Marks start and goals."""
    known = picture.positions[picture.known]
    if len(known):
        x, y, _ = camera.project(known[0, -1])
        axes.plot(x, y, "o", markersize=9, markerfacecolor="white", markeredgecolor=plots.INK, markeredgewidth=1.8)
        _label(axes, x, y, "start", plots.INK)
    for number, goal in enumerate(picture.goals):
        x, y, _ = camera.project(goal.position)
        axes.plot(x, y, "o", markersize=13, markerfacecolor="none", markeredgecolor="white", markeredgewidth=4.0)
        axes.plot(x, y, "o", markersize=13, markerfacecolor="none", markeredgecolor=plots.GOAL, markeredgewidth=2.4)
        axes.plot(x, y, "o", markersize=3.5, color=plots.GOAL)
        _label(axes, x, y, "goal" if len(picture.goals) == 1 else f"goal {number + 1}", plots.GOAL)
        if goal.direction is not None:
            tip = camera.project(goal.position + 60.0 / camera.scale * goal.direction)
            axes.annotate(
                "", (tip[0], tip[1]), (x, y), arrowprops={"arrowstyle": "-|>", "color": plots.GOAL, "linewidth": 1.8}
            )


def _label(axes: Axes, x: float, y: float, text: str, colour: str) -> None:
    axes.annotate(
        text,
        (x, y),
        xytext=(10, 8),
        textcoords="offset points",
        color=colour,
        fontsize=10.0,
        fontweight="bold",
        bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
    )


def _draw_scale_bar(axes: Axes, camera: Camera) -> None:
    """Draws a bar of a round length in the lower left corner."""
    room = 0.22 * camera.width / camera.scale
    power = 10.0 ** np.floor(np.log10(room))
    length = power * max(step for step in (1.0, 2.0, 5.0) if step * power <= room)
    x, y = 34.0, camera.height - 34.0
    axes.plot([x, x + length * camera.scale], [y, y], color=plots.INK, linewidth=2.5, solid_capstyle="butt")
    axes.text(x, y - 9.0, f"{1e3 * length:g} mm", color=plots.INK, fontsize=9.5)


def _draw_time_plots(upper: Axes, lower: Axes, picture: Picture) -> None:
    plots.draw_clearance(upper, picture.times, picture.clearance, picture.required_clearance)
    robot = picture.robot
    plots.draw_tensions(lower, picture.times, picture.tensions, robot.tendon_segments, float(robot.max_tensions.max()))
    end = max(float(picture.times[-1]), 1e-6)
    for axes in (upper, lower):
        axes.set_xlim(0.0, end)


def _draw_header(figure: Figure, picture: Picture) -> None:
    """Writes the title, the status and one line of numbers."""
    left, top = 30.0 / WIDTH_PX, 1.0 - 42.0 / HEIGHT_PX
    title = figure.text(left, top, picture.title, fontsize=17.0, fontweight="bold", va="center")
    box = title.get_window_extent(figure.canvas.get_renderer())  # type: ignore[attr-defined]
    x = (box.x1 + 26.0) / WIDTH_PX
    badge = figure.text(
        x, top, picture.status.replace("_", " "), fontsize=11.0, fontweight="bold", color="white", va="center"
    )
    extent = badge.get_window_extent(figure.canvas.get_renderer())  # type: ignore[attr-defined]
    pad_x, pad_y = 11.0 / WIDTH_PX, 7.0 / HEIGHT_PX
    figure.add_artist(
        FancyBboxPatch(
            (extent.x0 / WIDTH_PX - pad_x, extent.y0 / HEIGHT_PX - pad_y),
            extent.width / WIDTH_PX + 2 * pad_x,
            extent.height / HEIGHT_PX + 2 * pad_y,
            boxstyle="round,pad=0,rounding_size=0.008",
            facecolor=plots.STATUS_COLOURS.get(picture.status, plots.MUTED),
            edgecolor="none",
            transform=figure.transFigure,
            mutation_aspect=WIDTH_PX / HEIGHT_PX,
            zorder=-1,
        )
    )
    figure.text(left, 1.0 - 88.0 / HEIGHT_PX, summary_line(picture), fontsize=10.5, color=plots.MUTED, va="center")


def summary_line(picture: Picture) -> str:
    """Returns one line of numbers: robot, planner, states, and what the reference says of them."""
    parts = [f"robot {picture.robot.name}"]
    if picture.has_path:
        parts.append(f"{picture.scenario.planner.name}, {picture.model_name.replace('_', ' ')} shapes")
        parts.append(f"{len(picture.times)} states in {picture.times[-1]:.1f} s")
        if np.isfinite(picture.clearance).any():
            parts.append(f"least clearance {1e3 * np.nanmin(picture.clearance):.2f} mm")
        if np.isfinite(picture.deviation).any():
            parts.append(f"model within {1e3 * np.nanmax(picture.deviation):.2f} mm of the reference")
    elif picture.message:
        parts.append(picture.message)
    return "  ·  ".join(parts)
