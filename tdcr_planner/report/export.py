"""Results for other programs, by the ending of a file; the trajectory as JSON and the motion as GIF or MP4."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import animation

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.files import write_file_whole
from tdcr_planner.query.result import PlanResult
from tdcr_planner.report import plots, raster
from tdcr_planner.report.glb import write_glb
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.scene_image import SceneRenderer
from tdcr_planner.report.scene_png import write_png
from tdcr_planner.report.state_files import trajectory_table, write_shapes, write_trajectory_csv
from tdcr_planner.report.text import figure_text
from tdcr_planner.report.viewpoint import choose_camera

TRAJECTORY_FORMAT = "tdcr-trajectory/1"


def check_export(file: str | Path, *, has_result: bool, name: str = "file") -> None:
    """Checks that a file can be exported, before anything is written.

    Args:
        file: The file's name.
        has_result: Whether there is an answer to a query to take a trajectory from.
        name: What the caller calls the argument, for the message.

    Raises:
        InputError: An ending that no export has, or one that needs a result where there is none.
        FormatError: A program that the format needs is not there.
    """
    target = Path(file)
    endings = [kind.ending for kind in EXPORT_FORMATS.values() if has_result or not kind.needs_result]
    if target.suffix.lower() not in endings:
        what = "" if has_result else " (a scenario has no trajectory)"
        raise InputError(name, f"a name that ends in {', '.join(endings)}{what}", repr(target.name))
    program = EXPORT_FORMATS[target.suffix.lower()].program
    if program and not shutil.which(program):
        raise FormatError(target, f"an {target.suffix[1:].upper()} needs {program} on the PATH; a .gif does not")


def export_picture(picture: Picture, file: str | Path, result: PlanResult | None = None) -> None:
    """Writes what a picture shows in the format that the file's ending names, whole or not at all.

    Args:
        picture: What is shown.
        file: A name with an ending of `EXPORT_FORMATS`.
        result: The answer to a query, which some formats need.

    Raises:
        InputError: Another ending, or one that needs a result where there is none.
        FormatError: The file cannot be written, or a program that the format needs is not there.
    """
    check_export(file, has_result=result is not None)
    with write_file_whole(file) as temporary:
        EXPORT_FORMATS[Path(file).suffix.lower()].write(picture, result, temporary)


def write_trajectory_json(result: PlanResult, file: str | Path) -> None:
    """Writes the trajectory as joint trajectories have it in ROS: names once, then a point a state.

    The joints are the tendons (displacement in m, tension in N as effort), the insertion (m) and the roll (rad), for
    which no effort is known: 0, as a controller takes it that adds efforts to its own.
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
                    "effort": [*path.tensions[index].tolist(), 0.0, 0.0],
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

    Raises:
        InputError: Fewer than one frame, no duration, a size that is not even and positive, or no shape to draw.
    """
    for place, size in (("width", width), ("height", height)):
        if size < 2 or size % 2:
            raise InputError(place, "an even number of pixels, 2 or more (video is coded in pairs of them)", size)
    if frames < 1:
        raise InputError("frames", "1 or more", frames)
    if not (math.isfinite(seconds) and seconds > 0.0):
        raise InputError("seconds", "a duration of more than 0 s", seconds)
    if not picture.known.any():
        raise InputError("picture", "a state whose shape is known", "none: an animation has nothing to move")
    renderer = SceneRenderer(picture, choose_camera(picture, width, height))
    known = np.flatnonzero(picture.known)
    times = picture.times[known]
    spread = np.linspace(times[0], times[-1], frames)
    states = known[np.searchsorted(times, spread - 1e-12).clip(0, len(known) - 1)]
    rate = max(1, round(frames / seconds))
    mp4 = Path(file).suffix.lower() == ".mp4"
    writer = animation.FFMpegWriter(fps=rate) if mp4 else animation.PillowWriter(fps=rate)
    with plots.plot_style():
        figure = plots.new_figure(width, height)
        title = figure_text(picture.title, 40)
        note = figure.text(0.02, 0.95, "", fontsize=13.0, fontweight="bold")
        with writer.saving(figure, str(file), figure.dpi):
            for state in states:
                image = renderer.render(np.array([state]), np.ones(1))
                shown = figure.figimage(raster.to_bytes(image))
                note.set_text(f"{title}   {picture.times[state]:.1f} s{_clearance_note(picture.clearance[state])}")
                writer.grab_frame()
                shown.remove()


def _clearance_note(clearance: FloatArray | float) -> str:
    return f"   clearance {1e3 * float(clearance):.2f} mm" if np.isfinite(clearance) else ""


@dataclass(frozen=True)
class ExportFormat:
    """A format that results and scenes are exported in.

    Attributes:
        ending: The ending of a file's name.
        write: Writes picture and result, which is None for a scenario, to a file.
        needs_result: Whether it has nothing to say of a scenario.
        program: The program that it needs; empty for none.
    """

    ending: str
    write: Callable[[Picture, Any, Path], None]
    needs_result: bool = False
    program: str = ""


EXPORT_FORMATS = {
    kind.ending: kind
    for kind in (
        ExportFormat(".png", lambda picture, _, file: write_png(picture, file)),
        ExportFormat(".glb", lambda picture, _, file: write_glb(picture, file)),
        ExportFormat(".gif", lambda picture, _, file: write_animation(picture, file)),
        ExportFormat(".mp4", lambda picture, _, file: write_animation(picture, file), program="ffmpeg"),
        ExportFormat(".json", lambda _, result, file: write_trajectory_json(result, file), needs_result=True),
        ExportFormat(".csv", lambda _, result, file: write_trajectory_csv(result, file), needs_result=True),
        ExportFormat(".npz", lambda _, result, file: write_shapes(result, file), needs_result=True),
    )
}
"""The formats by ending; a format is added here."""
