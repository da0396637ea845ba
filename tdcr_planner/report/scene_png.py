"""The static picture: see-through walls and the robot along its path, with clearance and tensions beside them."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from tdcr_planner.report import plots, raster
from tdcr_planner.report.guide_marks import Tag, draw_entry, draw_orientation, draw_tags
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera
from tdcr_planner.report.robot_mesh import backbone_curve
from tdcr_planner.report.scene_image import render_scene, spread_states
from tdcr_planner.report.text import figure_text, shorten
from tdcr_planner.report.viewpoint import choose_camera

WIDTH_PX, HEIGHT_PX, DPI = 1600, 900, 120
SCENE_PX = (1010, 770)
# Room for the status beside the title.
_BADGE_PX = 240.0
# What a line may lose at its end to a word that goes to the next one.
_LONGEST_WORD = 24


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
        upper = figure.add_axes((left, 0.535, width, 0.28))
        lower = figure.add_axes((left, 0.085, width, 0.365))
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
    image = render_scene(picture, camera, *spread_states(picture))
    figure.figimage(raster.to_bytes(image), left, bottom)
    axes.set_xlim(0.0, width)
    axes.set_ylim(height, 0.0)
    axes.set_axis_off()
    axes.set_zorder(1.0)  # above the image, which the figure holds itself
    draw_entry(axes, picture, camera)
    _draw_markers(axes, picture, camera)
    _draw_scale_bar(axes, camera)
    draw_orientation(axes, picture, camera)
    return axes


def _draw_markers(axes: Axes, picture: Picture, camera: Camera) -> None:
    """Marks start, goals, the state that fails and what the picture points out."""
    tags = []
    known = picture.positions[picture.known]
    if len(known):
        x, y, _ = camera.project(known[0, -1])
        axes.plot(x, y, "o", markersize=9, markerfacecolor="white", markeredgecolor=plots.INK, markeredgewidth=1.8)
        tags.append(Tag(x, y, "start", plots.INK))
    for number, goal in enumerate(picture.goals):
        x, y, _ = camera.project(goal.position)
        axes.plot(x, y, "o", markersize=13, markerfacecolor="none", markeredgecolor="white", markeredgewidth=4.0)
        axes.plot(x, y, "o", markersize=13, markerfacecolor="none", markeredgecolor=plots.GOAL, markeredgewidth=2.4)
        axes.plot(x, y, "o", markersize=3.5, color=plots.GOAL)
        tags.append(Tag(x, y, "goal" if len(picture.goals) == 1 else f"goal {number + 1}", plots.GOAL))
        if goal.direction is not None:
            tip = camera.project(goal.position + 60.0 / camera.scale * goal.direction)
            axes.annotate(
                "", (tip[0], tip[1]), (x, y), arrowprops={"arrowstyle": "-|>", "color": plots.GOAL, "linewidth": 1.8}
            )
    worst = picture.worst_state
    if picture.failed_state is not None and worst is not None and picture.known[worst]:
        tags.append(_draw_outline(axes, camera, picture, worst))
    for mark in picture.marks:
        if mark.point is not None:
            x, y, _ = camera.project(mark.point)
            axes.plot(x, y, "X", markersize=12, color=plots.ALERT, markeredgecolor="white", markeredgewidth=1.4)
            tags.append(Tag(x, y, mark.label, plots.ALERT))
        elif mark.positions is not None:
            x, y, _ = camera.project(mark.positions[-1])
            tags.append(Tag(x, y, mark.label, plots.ALERT))
    draw_tags(axes, tags)


def _draw_outline(axes: Axes, camera: Camera, picture: Picture, state: int) -> Tag:
    """Draws the backbone and the rims of the disks of a state as lines; returns the tag at its tip."""
    robot, positions, rotations = picture.robot, picture.positions[state], picture.rotations[state]
    line = camera.project(backbone_curve(positions, rotations, robot.arc_lengths))
    axes.plot(line[:, 0], line[:, 1], color=plots.ALERT, linewidth=1.6)
    angle = np.linspace(0.0, 2.0 * np.pi, 33)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    for centre, rotation, radius in zip(positions, rotations, robot.disk_radii, strict=True):
        rim = camera.project(centre + radius * circle @ rotation.T)
        axes.plot(rim[:, 0], rim[:, 1], color=plots.ALERT, linewidth=0.9)
    x, y = line[-1, 0], line[-1, 1]
    return Tag(float(x), float(y), picture.worst_label, plots.ALERT)


def _draw_scale_bar(axes: Axes, camera: Camera) -> None:
    """Draws a bar of a round length in the lower left corner."""
    room = 0.22 * camera.width / camera.scale
    power = 10.0 ** np.floor(np.log10(room))
    length = power * max(step for step in (1.0, 2.0, 5.0) if step * power <= room)
    x, y = 34.0, camera.height - 34.0
    axes.plot([x, x + length * camera.scale], [y, y], color=plots.INK, linewidth=2.5, solid_capstyle="butt")
    axes.text(
        x,
        y - 10.0,
        f"{1e3 * length:g} mm",
        color=plots.INK,
        fontsize=9.5,
        bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
    )


def _draw_time_plots(upper: Axes, lower: Axes, picture: Picture) -> None:
    plots.draw_clearance(upper, picture.times, picture.clearance, picture.required_clearance)
    plots.draw_tensions(lower, picture.times, picture.tensions, picture.robot)
    end = max(float(picture.times[-1]), 1e-6)
    for axes in (upper, lower):
        axes.set_xlim(0.0, end)


def _draw_header(figure: Figure, picture: Picture) -> None:
    """Writes the title, the status and one line of numbers."""
    left, top = 30.0 / WIDTH_PX, 1.0 - 36.0 / HEIGHT_PX
    title = figure.text(left, top, figure_text(picture.title), fontsize=17.0, fontweight="bold", va="center")
    plots.fit_text(title, WIDTH_PX - _BADGE_PX)
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
    _write_two_lines(figure, figure_text(summary_line(picture)), left, 1.0 - 62.0 / HEIGHT_PX)


def _write_two_lines(figure: Figure, words: str, left: float, top: float) -> None:
    """Writes a text in one line or, where it is too long, in two; what even they do not hold loses its middle."""
    text = figure.text(left, top, words, fontsize=10.5, color=plots.MUTED, va="top", linespacing=1.35)
    width, room = text.get_window_extent().width, (1.0 - 2.0 * left) * WIDTH_PX
    if width <= room:
        return
    letters = int(0.95 * len(words) * room / width)
    lines = textwrap.wrap(shorten(words, 2 * letters - _LONGEST_WORD), letters)
    text.set_text("\n".join(lines[:2]))


def summary_line(picture: Picture) -> str:
    """Returns one line of numbers: robot, planner, states, and what the reference says of them."""
    parts = [f"robot {picture.robot.name}"]
    if picture.has_path:
        parts.append(f"{picture.scenario.planner.name}, {picture.model_name.replace('_', ' ')} shapes")
        parts.append(f"{len(picture.times)} states in {picture.times[-1]:.1f} s")
        if np.isfinite(picture.clearance).any():
            parts.append(f"least clearance {1e3 * np.nanmin(picture.clearance):.2f} mm")
        if np.isfinite(picture.deviation).any():
            # a micrometre is finer than anyone can use
            parts.append(f"model within {max(1e3 * np.nanmax(picture.deviation), 1e-3):.2g} mm of the reference")
    elif picture.message:
        parts.append(picture.message)
    return "  ·  ".join(parts)
