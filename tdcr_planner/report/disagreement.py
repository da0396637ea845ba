"""Pictures of wrong verdicts: the reference's shape in the scene, and over it the shape that the model believed in."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compare.comparison import Comparison, Disagreement
from tdcr_planner.planning.scene import entry_plane
from tdcr_planner.report import plots, raster
from tdcr_planner.report.drawing import Drawing
from tdcr_planner.report.picture import Picture, gather_scenario_picture
from tdcr_planner.report.raster import Camera
from tdcr_planner.report.robot_mesh import backbone_curve
from tdcr_planner.report.scene_image import render_scene
from tdcr_planner.report.viewpoint import choose_camera
from tdcr_planner.robot import RobotSpec

_WIDTH_PX, _HEIGHT_PX, _TITLE_PX, _DPI = 1200, 900, 130, 120
_KINDS = {
    "false_valid": "is called valid by the {} model, but is not",
    "false_invalid": "is called invalid by the {} model, but is valid",
}
_CAUSES = {
    "obstacle": "its body, grown by the margin, meets an obstacle",
    "cavity": "its body, grown by the margin, leaves the cavity or passes its entry plane beside the opening",
    "self_collision": "it touches itself",
    "model_domain": "the state is outside of the model's domain",
    "statics": "it has no shape there",
    "tendon_displacement": "a tendon would move too far",
    "strain": "the backbone would bend too much",
    "no_shape": "there is no stable shape",
    "limits": "tendon displacement or backbone strain is beyond its limit",
    "clearance": "the body comes too near to a surface, or is on its wrong side",
}


def disagreement_drawings(comparison: Comparison) -> dict[str, Drawing]:
    """Returns what draws each of a comparison's disagreements as PNG, by file name."""
    scene = cache(lambda: gather_scenario_picture(comparison.scenario))

    def draw(item: Disagreement, file: Path) -> None:
        with plots.plot_style():
            plots.save_figure(draw_disagreement(scene(), item), file)

    return {
        f"disagreement_{number}_{item.variant}_{item.kind}.png": partial(draw, item)
        for number, item in enumerate(comparison.disagreements, start=1)
    }


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
    entry = _draw_entry(axes, picture, camera)
    _draw_outline(axes, picture, camera)
    axes.set_xlim(0.0, _WIDTH_PX)
    axes.set_ylim(height, 0.0)
    who, why, how = describe_disagreement(item)
    figure.text(0.02, 0.96, who, fontsize=14.0, fontweight="bold", va="center")
    figure.text(0.02, 0.925, why, fontsize=10.5, va="center")
    figure.text(0.02, 0.9, how, fontsize=10.5, color=plots.MUTED, va="center")
    figure.text(0.02, 0.875, entry, fontsize=10.5, color=plots.MUTED, va="center")
    return figure


def describe_disagreement(item: Disagreement) -> tuple[str, str, str]:
    """Returns the three lines of text above a picture: who is wrong, why it was rejected, and what is drawn how."""
    model = item.variant.replace("_", " ")
    rejects = "The reference" if item.kind == "false_valid" else "The model"
    reason = _CAUSES.get(item.cause, item.cause.replace("_", " "))
    apart = f"{model}, {_length(item.deviation)} from it"
    return (
        f"State {item.state} {_KINDS[item.kind].format(model)}",
        f"{rejects} rejects it: {reason}.",
        f"solid: reference, clearance {_length(item.clearance)}  ·  outline: {apart}",
    )


def _length(metres: float) -> str:
    """Returns a length with the unit in which people can read it."""
    text = f"{1e3 * metres:.2f} mm" if abs(metres) >= 1e-4 else f"{1e6 * metres:.2g} µm"
    return text.replace("-", "\N{MINUS SIGN}")


def _draw_entry(axes: Axes, picture: Picture, camera: Camera) -> str:
    """Draws the entry plane of the cavity as a pale disk that reaches past both shapes.

    Returns:
        How far the reference's and the model's disks pass it, for people; empty where there is no cavity. Beside the
        opening the plane is a wall, and a picture alone does not show depth.
    """
    text = ""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    for mesh in picture.scenario.file.surfaces:
        point, normal = entry_plane(picture.scenario, mesh)
        if point is None:
            continue
        normal = normal / np.linalg.norm(normal)
        across = np.linalg.svd(normal[None])[2][1:]
        reach = np.linalg.norm((picture.positions.reshape(-1, 3) - point) @ across.T, axis=1).max()
        radius = reach + 2.0 * picture.robot.disk_radii.max()
        rim = camera.project(point + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across)
        axes.fill(rim[:, 0], rim[:, 1], facecolor=plots.MUTED, alpha=0.1)
        axes.plot(rim[:, 0], rim[:, 1], color=plots.MUTED, linewidth=1.2, linestyle="--")
        passed = disks_past_plane(picture.robot, picture.positions, picture.rotations, point, normal)
        reference, model = (_length(float(distance)) for distance in passed)
        text = f"dashed: entry plane; the reference's disks pass it by {reference}, the model's by {model}"
    return text


def disks_past_plane(
    robot: RobotSpec, positions: FloatArray, rotations: FloatArray, point: FloatArray, normal: FloatArray
) -> FloatArray:
    """Returns how far the disks of a robot pass a plane in each of several states, shape (k,), m; negative before it.

    Args:
        robot: The robot.
        positions: Disk centres, shape (k, d, 3), m.
        rotations: Shape (k, d, 3, 3).
        point: A point of the plane, shape (3,), m.
        normal: Its unit normal, shape (3,).
    """
    cosines = np.abs(rotations[..., 2] @ normal)
    sines = np.sqrt(np.clip(1.0 - cosines**2, 0.0, 1.0))
    rims = (positions - point) @ normal + robot.disk_radii * sines + 0.5 * robot.disk_thicknesses * cosines
    return np.asarray(rims.max(axis=1))


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
