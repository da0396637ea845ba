"""Pictures of wrong verdicts: the reference's shape in the scene, and over it the shape that the model believed in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdcr_planner.compare.comparison import Comparison, Disagreement
from tdcr_planner.report import plots, raster
from tdcr_planner.report.picture import Picture, gather_scenario_picture
from tdcr_planner.report.raster import Camera
from tdcr_planner.report.robot_mesh import backbone_curve
from tdcr_planner.report.scene_image import render_scene
from tdcr_planner.report.viewpoint import choose_camera

_WIDTH_PX, _HEIGHT_PX, _TITLE_PX, _DPI = 1200, 900, 90, 120
_KINDS = {
    "false_valid": "is called valid by {}, but is not",
    "false_invalid": "is called invalid by {}, but is valid",
}


def write_disagreements(comparison: Comparison, folder: Path) -> list[str]:
    """Writes a PNG for each of a comparison's disagreements into an existing folder and returns the file names."""
    if not comparison.disagreements:
        return []
    scene = gather_scenario_picture(comparison.scenario)
    names = []
    with plots.plot_style():
        for number, item in enumerate(comparison.disagreements, start=1):
            name = f"disagreement_{number}_{item.variant}_{item.kind}.png"
            plots.save_figure(draw_disagreement(scene, item), folder / name)
            names.append(name)
    return names


def draw_disagreement(scene: Picture, item: Disagreement) -> Figure:
    """Returns the picture of one wrong verdict.

    Args:
        scene: A picture of the scenario, for its meshes.
        item: The state with both shapes.
    """
    positions = np.stack([item.positions, item.model_positions])
    rotations = np.stack([item.rotations, item.model_rotations])
    # Both shapes are in the picture, so that the camera shows both; only the first is painted as a body.
    picture = replace(scene, goals=(), positions=positions, rotations=rotations)
    height = _HEIGHT_PX - _TITLE_PX
    camera = choose_camera(picture, _WIDTH_PX, height)
    one = replace(picture, positions=positions[:1], rotations=rotations[:1])
    image = render_scene(one, camera, np.array([0]), np.ones(1))
    figure = plots.new_figure(_WIDTH_PX, _HEIGHT_PX, _DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, height / _HEIGHT_PX))
    axes.imshow(raster.to_bytes(image), extent=(0.0, _WIDTH_PX, height, 0.0), interpolation="none", aspect="auto")
    axes.set_axis_off()
    _draw_outline(axes, picture, camera)
    model = item.variant.replace("_", " ")
    title = f"State {item.state} {_KINDS[item.kind].format(model)}"
    figure.text(0.02, 0.96, title, fontsize=14.0, fontweight="bold", va="center")
    figure.text(
        0.02,
        0.92,
        f"solid: reference, clearance {1e3 * item.clearance:.2f} mm  ·  outline: {model}, "
        f"{1e3 * item.deviation:.2f} mm from it",
        fontsize=10.5,
        color=plots.MUTED,
        va="center",
    )
    return figure


def _draw_outline(axes: Axes, picture: Picture, camera: Camera) -> None:
    """Draws the second shape as lines: its backbone and the rims of its disks."""
    robot, positions, rotations = picture.robot, picture.positions[1], picture.rotations[1]
    line = camera.project(backbone_curve(positions, rotations, robot.arc_lengths))
    axes.plot(line[:, 0], line[:, 1], color=plots.ALERT, linewidth=2.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 41)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    for centre, rotation, radius in zip(positions[1:], rotations[1:], robot.disk_radii[1:], strict=True):
        rim = camera.project(centre + radius * circle @ rotation.T)
        axes.plot(rim[:, 0], rim[:, 1], color=plots.ALERT, linewidth=1.0)
