"""Guides and labels over a rendered scene: entry planes, axes and gravity, and tags that do not cover each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import Bbox

from tdcr_planner.arrays import FloatArray
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera
from tdcr_planner.report.scene_guides import (
    AXIS_COLOURS,
    GRAVITY_COLOUR,
    base_axes,
    entry_disks,
    gravity_direction,
    gravity_label,
)
from tdcr_planner.report.text import figure_text
from tdcr_planner.report.viewpoint import free_corner

_TAG_LETTERS = 44
_ARM_PX = 44.0
# Where a tag may stand about its point, points right and up, and how it is aligned there.
_TAG_PLACES = (
    (10.0, 8.0, "left", "bottom"),
    (10.0, -8.0, "left", "top"),
    (-10.0, 8.0, "right", "bottom"),
    (-10.0, -8.0, "right", "top"),
    (10.0, 30.0, "left", "bottom"),
    (10.0, -30.0, "left", "top"),
    (-10.0, 30.0, "right", "bottom"),
    (-10.0, -30.0, "right", "top"),
    (10.0, 52.0, "left", "bottom"),
    (10.0, -52.0, "left", "top"),
)


class Tag(NamedTuple):
    """A label at a point, pixels of the scene, y down."""

    x: float
    y: float
    text: str
    colour: str


def draw_tags(axes: Axes, tags: list[Tag]) -> None:
    """Writes labels beside their points, each where it covers no earlier one and stays inside of the axes."""
    taken: list[Bbox] = []
    for tag in tags:
        best = None
        for right, up, across, along in _TAG_PLACES:
            note = axes.annotate(
                figure_text(tag.text, _TAG_LETTERS),
                (tag.x, tag.y),
                xytext=(right, up),
                textcoords="offset points",
                color=tag.colour,
                fontsize=10.0,
                fontweight="bold",
                ha=across,
                va=along,
                bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
                zorder=6,
            )
            box = note.get_window_extent().padded(4.0)
            inside = [axes.bbox.containsx(end) for end in box.intervalx] + [
                axes.bbox.containsy(end) for end in box.intervaly
            ]

            cost = 2 * inside.count(False) + sum(box.overlaps(other) for other in taken)
            if best is None or cost < best[0]:
                if best is not None:
                    best[1].remove()
                best = (cost, note, box)
            else:
                note.remove()
            if best[0] == 0:
                break
        assert best is not None  # there is a place to try
        taken.append(best[2])


def draw_entry(axes: Axes, picture: Picture, camera: Camera) -> None:
    """Draws each cavity's entry plane as a pale disk with a dashed rim and an arrow into the cavity."""
    for disk in entry_disks(picture):
        rim = camera.project(disk.rim)
        axes.fill(rim[:, 0], rim[:, 1], facecolor=GRAVITY_COLOUR, alpha=0.06)
        axes.plot(rim[:, 0], rim[:, 1], color=GRAVITY_COLOUR, linewidth=1.1, linestyle=(0, (4, 3)), alpha=0.75)


def draw_orientation(axes: Axes, picture: Picture, camera: Camera) -> None:
    """Draws the world's axes and the direction of gravity in a lower corner, and the base frame where it is."""
    side, height = free_corner(picture, camera, ("lower right", "upper right", "upper left"))
    corner = np.array([2.3 * _ARM_PX, 2.6 * _ARM_PX])
    if side == "right":
        corner[0] = camera.width - corner[0]
    if height == "bottom":
        corner[1] = camera.height - 2.0 * _ARM_PX
    arms = {name: camera.rotation[:2, index] * [1.0, -1.0] for index, name in enumerate("xyz")}
    for name, arm in arms.items():
        _draw_arm(axes, corner, _ARM_PX * arm, AXIS_COLOURS[name], name)
    direction = gravity_direction(picture)
    if direction is not None:
        arm = 1.15 * _ARM_PX * (camera.rotation[:2] @ direction) * [1.0, -1.0]
        _draw_arm(axes, corner, arm, GRAVITY_COLOUR, "g")
    axes.text(
        corner[0],
        corner[1] + 1.8 * _ARM_PX,
        gravity_label(picture),
        color=GRAVITY_COLOUR,
        fontsize=8.5,
        ha="center",
    )
    if picture.has_path:
        return
    origin, rotation = base_axes(picture)
    start = camera.project(origin)[:2]
    length = 3.0 * float(picture.robot.disk_radii.max())
    for index, name in enumerate("xyz"):
        end = camera.project(origin + length * rotation[:, index])[:2]
        _draw_arm(axes, start, end - start, AXIS_COLOURS[name], "")


def _draw_arm(axes: Axes, start: FloatArray, arm: FloatArray, colour: str, name: str) -> None:
    """Draws an arrow, pixels of the scene, with a letter beyond its end; an arm towards the viewer is a dot."""
    end = start + arm
    length = float(np.hypot(*arm))
    if length < 4.0:
        axes.plot(*start, "o", markersize=5.0, color=colour)
    else:
        style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 0.0, "shrinkB": 0.0}
        axes.annotate("", tuple(end), tuple(start), arrowprops=style)
    letter = end + 10.0 * (arm / length if length >= 4.0 else np.array([0.7, -0.7]))
    axes.text(
        float(letter[0]),
        float(letter[1]),
        name,
        color=colour,
        fontsize=9.0,
        fontweight="bold",
        ha="center",
        va="center",
    )
