"""The still picture of an inspection: the scene with its coverage map, coverage along the path, and why not more."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.inspection.answer import Inspection
from tdcr_planner.report import plots, raster
from tdcr_planner.report.coverage_map import CLASSES, COLOURS, PaintedMesh
from tdcr_planner.report.coverage_picture import CoveragePicture
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera
from tdcr_planner.report.robot_mesh import Mesh, backbone_curve, disk_mesh, tube_mesh
from tdcr_planner.report.scene_image import spread_states
from tdcr_planner.report.text import figure_text
from tdcr_planner.report.viewpoint import look_from, up_direction

WIDTH_PX, HEIGHT_PX, DPI = 1600, 900, 120
_SCENE_PX = (1010, 800)
_TIP_PX = 230
_SUPERSAMPLING = 2
_MARGIN = 1.25
_ROD_M = 1.2e-3
_DISKS, _ROD = np.array([0.13, 0.46, 0.71]), np.array([0.1, 0.15, 0.2])


def write_coverage_png(shown: CoveragePicture, file: str | Path) -> None:
    """Writes the still picture of an inspection, 1600 x 900 pixels."""
    with plots.plot_style():
        plots.save_figure(_draw(shown), file)


def _draw(shown: CoveragePicture) -> Figure:
    inspection, picture, painted = shown.inspection, shown.picture, shown.painted
    coverage = inspection.coverage
    figure = plots.new_figure(WIDTH_PX, HEIGHT_PX, DPI)
    figure.figimage(raster.to_bytes(_scene_image(inspection, picture, painted)), 0, 0)
    title = figure.text(0.02, 0.955, figure_text(picture.title), fontsize=17.0, fontweight="bold", va="center")
    plots.fit_text(title, 700)
    badge = figure.text(0.98, 0.955, picture.status.replace("_", " "), ha="right", va="center", fontsize=12.0)
    badge.set_color(plots.STATUS_COLOURS.get(picture.status, plots.MUTED))
    badge.set_fontweight("bold")
    figure.text(0.02, 0.915, figure_text(picture.message), fontsize=10.5, color=plots.MUTED, va="center")
    shares = (coverage.of_all, coverage.visible - coverage.of_all, 1.0 - coverage.visible)
    figure.add_artist(Rectangle((0.012, 0.04), 0.21, 0.105, facecolor="white", alpha=0.85, edgecolor="none"))
    for row, (name, colour, share) in enumerate(zip(CLASSES[1:], COLOURS[1:], shares, strict=True)):
        figure.text(0.022, 0.125 - 0.032 * row, "\u25a0", fontsize=15, color=colour, va="center")
        figure.text(0.041, 0.125 - 0.032 * row, f"{name}, {100 * max(share, 0.0):.1f} %", fontsize=10.5, va="center")
    left, width = (_SCENE_PX[0] + 110) / WIDTH_PX, (WIDTH_PX - _SCENE_PX[0] - 150) / WIDTH_PX
    if picture.has_path:
        _draw_rise(figure.add_axes((left, 0.60, width, 0.24)), inspection)
        _draw_tips(figure, shown)
    _draw_causes(figure.add_axes((left + 0.06, 0.05, width - 0.06, 0.12)), inspection)
    return figure


def _scene_image(inspection: Inspection, picture: Picture, painted: list[PaintedMesh]) -> raster.Image:
    """Returns the map and the robot in some states, from where most of what is seen shows."""
    camera = _choose_view(inspection, picture, painted)
    fine = Camera(
        camera.rotation, camera.centre, _SUPERSAMPLING * camera.scale,
        _SUPERSAMPLING * camera.width, _SUPERSAMPLING * camera.height,
    )  # fmt: skip
    image = np.ones((fine.height, fine.width, 3), dtype=np.float32)
    for mesh in painted:
        asked = mesh.classes > 0
        for faces, colours, cover in (
            (mesh.faces[~asked], mesh.colours[~asked], 0.22),
            (mesh.faces[asked], mesh.colours[asked], 0.96),
        ):
            if len(faces):
                _lay(image, fine, (mesh.vertices, faces), colours, cover)
    if picture.has_path:
        for state, fade in zip(*spread_states(picture), strict=True):
            positions, rotations = picture.positions[state], picture.rotations[state]
            rod = tube_mesh(backbone_curve(positions, rotations, picture.robot.arc_lengths), _ROD_M)
            _lay(image, fine, disk_mesh(picture.robot, positions, rotations), _DISKS, 0.55 * float(fade))
            _lay(image, fine, rod, _ROD, 0.9 * float(fade))
    return raster.shrink(image, _SUPERSAMPLING)


def _lay(image: raster.Image, camera: Camera, mesh: Mesh, colours: FloatArray, cover: float) -> None:
    """Paints a mesh over an image, with so much cover, 0 to 1."""
    layer = raster.render_layer(camera, *mesh)
    shaded = raster.shade(layer, colours, gloss=0.1, ambient=0.5)
    raster.lay_over(image, layer, shaded, np.where(layer.seen, cover, 0.0).astype(np.float32))


def _choose_view(inspection: Inspection, picture: Picture, painted: list[PaintedMesh]) -> Camera:
    """Returns the view in which most of the points that can be seen face the viewer and are not hidden."""
    targets, up = inspection.coverage.targets, up_direction(picture)
    points = targets.points
    shown = inspection.coverage.can_be_seen
    weights = targets.areas * np.where(shown if shown.any() else np.ones(len(points), dtype=np.bool_), 1.0, 0.2)
    tips = picture.positions[picture.known][:, -1] if picture.has_path else np.empty((0, 3))
    fitted = np.concatenate([points, tips])
    best, best_score = None, -1.0
    for elevation in (-35.0, -12.0, 12.0, 35.0, 60.0):
        for azimuth in range(0, 360, 20):
            rotation = look_from(float(azimuth), elevation, up)
            local = fitted @ rotation.T
            low, high = local.min(axis=0), local.max(axis=0)
            size = np.maximum((high - low)[:2] * _MARGIN, 1e-3)
            scale = float(min(_SCENE_PX[0] / size[0], (_SCENE_PX[1] - 60) / size[1]))
            camera = Camera(rotation, rotation.T @ (0.5 * (low + high)), scale, *_SCENE_PX)
            facing = targets.normals @ rotation[2]
            facing = np.where(targets.two_sided, np.abs(facing), np.maximum(facing, 0.0))
            score = scale**2 * float((weights * facing * _open(camera, points, painted)).sum())
            if score > best_score:
                best, best_score = camera, score
    assert best is not None  # there is a first view
    return best


def _open(camera: Camera, points: FloatArray, painted: list[PaintedMesh]) -> BoolArray:
    """Returns which points the inspected surfaces do not hide from a viewer, shape (p,)."""
    small = Camera(camera.rotation, camera.centre, 0.2 * camera.scale, camera.width // 5, camera.height // 5)
    place = small.project(points)
    column = np.clip(place[:, 0].astype(int), 0, small.width - 1)
    row = np.clip(place[:, 1].astype(int), 0, small.height - 1)
    nearest = np.full((small.height, small.width), -np.inf, dtype=np.float32)
    for mesh in painted:
        faces = mesh.faces[mesh.classes > 0]
        if len(faces):
            layer = raster.render_layer(small, mesh.vertices, faces)
            part = nearest[layer.rows, layer.columns]
            np.maximum(part, layer.nearness, out=part)
    return np.asarray(nearest[row, column] <= place[:, 2] + 4.0 / small.scale)


def _draw_rise(axes: Axes, inspection: Inspection) -> None:
    coverage, path = inspection.coverage, inspection.plan.path
    assert path is not None  # the caller has looked
    first, areas = coverage.sight.first, coverage.targets.areas
    added = np.bincount(first[first >= 0], weights=areas[first >= 0], minlength=len(path))
    axes.plot(path.times, 100.0 * np.cumsum(added) / areas.sum(), color=COLOURS[1], linewidth=2.2)
    axes.axhline(100.0 * coverage.visible, color=COLOURS[2], linestyle="--", linewidth=1.4)
    axes.text(
        path.times[-1],
        100.0 * coverage.visible,
        "can be seen",
        ha="right",
        va="bottom",
        fontsize=9.5,
        color=plots.MUTED,
    )
    axes.set_xlim(0.0, max(float(path.times[-1]), 1e-6))
    axes.set_ylim(0.0, max(112.0 * coverage.visible, 1.0))
    axes.set_xlabel("time (s)")
    axes.set_ylabel("seen (% of the surfaces)")
    axes.set_title("Coverage", loc="left", fontsize=12.0, fontweight="bold")


def _draw_tips(figure: Figure, shown: CoveragePicture) -> None:
    """Draws the tip views in two states: those of each half of the path that see most for the first time."""
    picture, coverage = shown.picture, shown.inspection.coverage
    first = coverage.sight.first
    added = np.bincount(first[first >= 0], weights=coverage.targets.areas[first >= 0], minlength=len(picture.times))
    half = max(1, len(added) // 2)
    states = [int(added[:half].argmax()), half + int(added[half:].argmax()) if len(added) > half else 0]
    for number, state in enumerate(states):
        left = _SCENE_PX[0] + 60 + number * (_TIP_PX + 26)
        figure.figimage(raster.to_bytes(shown.view(state, _TIP_PX)), left, 200)
        figure.text(
            left / WIDTH_PX, (200 + _TIP_PX + 8) / HEIGHT_PX, f"Tip view at {picture.times[state]:.1f} s",
            fontsize=10.0, va="bottom",
        )  # fmt: skip


def _draw_causes(axes: Axes, inspection: Inspection) -> None:
    shares = list(inspection.coverage.cause_shares.items())[:5][::-1]
    axes.set_title("Cannot be seen, % of the surfaces", loc="left", fontsize=10.5, fontweight="bold")
    if not shares:
        axes.set_axis_off()
        return
    axes.barh(range(len(shares)), [100.0 * share for _, share in shares], color=COLOURS[3], height=0.62)
    axes.set_yticks(range(len(shares)), [name for name, _ in shares], fontsize=8.5)
    axes.tick_params(axis="x", labelsize=8.5)
    axes.grid(axis="y", visible=False)
