"""Results for other programs: scene and path as GLB, an animation as GIF or MP4, the trajectory as JSON."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from matplotlib import animation
from matplotlib.colors import to_rgb
from trimesh.visual.material import PBRMaterial

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.files import write_file_whole
from tdcr_planner.report import plots, raster
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.robot_mesh import (
    Mesh,
    backbone_curve,
    disk_mesh,
    merge_meshes,
    tendon_lines,
    tube_mesh,
)
from tdcr_planner.report.scene_image import render_scene
from tdcr_planner.report.scene_png import write_png
from tdcr_planner.report.state_files import trajectory_table, write_shapes
from tdcr_planner.report.viewpoint import choose_camera
from tdcr_planner.session import PlanResult

TRAJECTORY_FORMAT = "tdcr-trajectory/1"


def export_picture(picture: Picture, file: str | Path, result: PlanResult | None = None) -> None:
    """Writes what a picture shows in the format that the file's ending names, whole or not at all.

    Args:
        picture: What is shown.
        file: .png, .glb (scene and path), .gif or .mp4 (animation), .json (trajectory) or .npz (all shapes).
        result: The answer to a query, which .json and .npz need.

    Raises:
        InputError: Another ending, or one that needs a result where there is none.
        FormatError: The file cannot be written, or there is no ffmpeg for an MP4.
    """
    target = Path(file)
    ending = target.suffix.lower()
    writers: dict[str, Callable[[Path], None]] = {
        ".png": lambda path: write_png(picture, path),
        ".glb": lambda path: write_glb(picture, path),
        ".gif": lambda path: write_animation(picture, path),
        ".mp4": lambda path: write_animation(picture, path),
    }
    if result is not None:
        writers[".json"] = lambda path: write_trajectory_json(result, path)
        writers[".npz"] = lambda path: write_shapes(result, path)
    if ending not in writers:
        what = "" if result is not None else " (a scenario has no trajectory)"
        raise InputError("file", f"a name that ends in {', '.join(writers)}{what}", repr(target.name))
    if ending == ".mp4" and not shutil.which("ffmpeg"):
        raise FormatError(target, "an MP4 needs ffmpeg on the PATH; a .gif does not")
    with write_file_whole(target) as temporary:
        writers[ending](temporary)


def write_trajectory_json(result: PlanResult, file: str | Path) -> None:
    """Writes the trajectory as joint trajectories have it in ROS: names once, then a point a state.

    The joints are the tendons (displacement in m, tension in N as effort), the insertion (m) and the roll (rad).
    """
    path, robot = result.path, result.scenario.robot
    names = [f"tendon_{index + 1}" for index in range(robot.tendon_count)] + ["insertion", "roll"]
    points: list[dict[str, Any]] = []
    if path is not None:
        positions = np.concatenate([path.tendon_displacements, path.insertion[:, None], path.roll[:, None]], axis=1)
        for index, time in enumerate(path.times.tolist()):
            seconds, nanoseconds = divmod(round(1e9 * time), 10**9)
            points.append(
                {
                    "time_from_start": {"sec": seconds, "nanosec": nanoseconds},
                    "positions": [_finite(value) for value in positions[index].tolist()],
                    "effort": [*path.tensions[index].tolist(), None, None],
                }
            )
    columns, rows = trajectory_table(result)
    content = {
        "format": TRAJECTORY_FORMAT,
        "robot": robot.name,
        "status": result.status.value,
        "joint_names": names,
        "joint_units": ["m"] * robot.tendon_count + ["m", "rad"],
        "points": points,
        "columns": columns,
        "rows": [[_finite(value) for value in row] for row in rows.tolist()],
    }
    Path(file).write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_glb(picture: Picture, file: str | Path) -> None:
    """Writes the scene, the robot in its first and last state, and the tip's way as a binary glTF file, in metres."""
    scene = trimesh.Scene()
    for number, mesh in enumerate(picture.meshes):
        colour = (0.76, 0.82, 0.86) if mesh.role == "cavity" else (0.79, 0.75, 0.70)
        _add(scene, f"{number + 1} {mesh.name}", (mesh.vertices, mesh.faces), colour, 0.3)
    known = np.flatnonzero(picture.known)
    for name, state in (("start", known[:1]), ("end", known[1:][-1:])):
        if len(state):
            _add_robot(scene, name, picture, int(state[0]), 0.35 if name == "start" and len(known) > 1 else 1.0)
    tips = picture.positions[known][:, -1]
    apart = np.ones(len(tips), dtype=np.bool_)
    apart[1:] = np.linalg.norm(np.diff(tips, axis=0), axis=1) > 1e-7
    if apart.sum() > 1:
        tube = tube_mesh(tips[apart], 0.25 * picture.robot.backbone.radius_m + 2e-4)
        _add(scene, "tip trace", tube, to_rgb(plots.TRACE), 1.0)
    for number, goal in enumerate(picture.goals):
        ball = trimesh.creation.icosphere(subdivisions=3, radius=max(goal.tolerance, 1e-3))
        _add(scene, f"goal {number + 1}", (ball.vertices + goal.position, ball.faces), to_rgb(plots.GOAL), 0.5)
    Path(file).write_bytes(scene.export(file_type="glb"))


def _add_robot(scene: trimesh.Scene, name: str, picture: Picture, state: int, opacity: float) -> None:
    robot, positions, rotations = picture.robot, picture.positions[state], picture.rotations[state]
    _add(scene, f"{name}: disks", disk_mesh(robot, positions, rotations), to_rgb(plots.ROBOT), opacity)
    line = backbone_curve(positions, rotations, robot.arc_lengths)
    tubes = [tube_mesh(line, robot.backbone.radius_m)]
    _add(scene, f"{name}: backbone", tubes[0], to_rgb(plots.INK), opacity)
    tendons = [tube_mesh(points, robot.body.tendon_radius_m) for points in tendon_lines(robot, positions, rotations)]
    _add(scene, f"{name}: tendons", merge_meshes(tendons), to_rgb(plots.MUTED), opacity)


def _add(scene: trimesh.Scene, name: str, mesh: Mesh, colour: tuple[float, ...], opacity: float) -> None:
    material = PBRMaterial(
        name=name,
        baseColorFactor=[*colour, opacity],
        metallicFactor=0.0,
        roughnessFactor=0.6,
        alphaMode="OPAQUE" if opacity >= 1.0 else "BLEND",
        doubleSided=True,
    )
    body = trimesh.Trimesh(*mesh, process=False, visual=trimesh.visual.TextureVisuals(material=material))
    scene.add_geometry(body, geom_name=name, node_name=name)


def write_animation(
    picture: Picture, file: str | Path, *, frames: int = 48, seconds: float = 6.0, width: int = 960, height: int = 640
) -> None:
    """Writes the robot's motion as a GIF or, with ffmpeg, as an MP4.

    Args:
        picture: What is shown.
        file: Ends in .gif or .mp4.
        frames: States shown, evenly spread over the time.
        seconds: Duration.
        width: Pixels, even.
        height: Pixels, even.
    """
    camera = choose_camera(picture, width, height)
    known = np.flatnonzero(picture.known)
    times = picture.times[known]
    spread = np.linspace(times[0], times[-1], frames) if len(times) else np.zeros(0)
    states = known[np.searchsorted(times, spread - 1e-12).clip(0, max(len(known) - 1, 0))]
    rate = max(1, round(frames / seconds))
    mp4 = Path(file).suffix.lower() == ".mp4"
    writer = animation.FFMpegWriter(fps=rate) if mp4 else animation.PillowWriter(fps=rate)
    with plots.plot_style():
        figure = plots.new_figure(width, height)
        note = figure.text(0.02, 0.95, "", fontsize=13.0, fontweight="bold")
        with writer.saving(figure, str(file), figure.dpi):
            for state in states:
                image = render_scene(picture, camera, np.array([state]), np.ones(1))
                shown = figure.figimage(raster.to_bytes(image))
                note.set_text(
                    f"{picture.title}   {picture.times[state]:.1f} s{_clearance_note(picture.clearance[state])}"
                )
                writer.grab_frame()
                shown.remove()


def _clearance_note(clearance: FloatArray | float) -> str:
    return f"   clearance {1e3 * float(clearance):.2f} mm" if np.isfinite(clearance) else ""
