"""Simulated measurements: what a test bench would have shown of a robot whose parameters are known."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.data import MeasuredStates
from tdcr_planner.calibration.forward import Forward, Mechanics, UnloadedMechanics
from tdcr_planner.calibration.table import MeasuredTable, axes_of
from tdcr_planner.files import write_file_whole

INTERVAL_S = 0.5
WAVES = 5


def smooth_motion(tendons: int, count: int, size: float, random: np.random.Generator) -> FloatArray:
    """Returns a motion that starts and ends at rest, shape (count, t): for each tendon a sum of sines.

    Args:
        tendons: Number of tendons t.
        count: Number of states.
        size: Root mean square of the motion of a tendon over many motions, in m or N times the square root of 2.
        random: Generator of the sizes.
    """
    phase = np.linspace(0.0, 2.0 * np.pi, count)[:, None]
    motion = np.zeros((count, tendons))
    for wave in range(1, WAVES + 1):
        motion += random.normal(size=tendons) * np.sin(wave * phase)
    return np.asarray(size / np.sqrt(WAVES) * motion)


def commanded_states(bench: Bench, commands: FloatArray, *, point: str = "tip") -> MeasuredStates:
    """Returns states of which nothing but the actuation is known, without loads.

    Args:
        bench: The robot on its bench.
        commands: Displacements, m, or tensions, N, as the robot's drive has it, shape (n, t).
        point: "tip" or "marker".
    """
    count = len(commands)
    displaced = bench.drives_displacement
    return MeasuredStates(
        table=MeasuredTable(Path("commands"), (), (), ()),
        displacements=commands if displaced else np.zeros_like(commands),
        tensions=np.full_like(commands, np.nan) if displaced else commands,
        points=np.array([-1]),
        is_marker=(point == "marker",),
        positions=np.full((count, 1, 3), np.nan),
        times=INTERVAL_S * np.arange(count, dtype=np.float64),
        timed=True,
        gravity=np.zeros((count, 3)),
        tip_force=np.zeros((count, 3)),
        patterns=(),
    )


def write_simulated(
    path: Path,
    bench: Bench,
    commands: FloatArray,
    noise_m: float,
    random: np.random.Generator,
    *,
    point: str = "tip",
    mechanics: Mechanics | None = None,
) -> Path:
    """Writes a CSV file of what a bench would have measured, and returns its path.

    A state without a stable shape has empty positions, as a point that was not seen.

    Args:
        path: The file.
        bench: The robot on its bench, as it really is.
        commands: Displacements, m, or tensions, N, as the robot's drive has it, shape (n, t).
        noise_m: Standard deviation of each coordinate.
        random: Generator of the noise.
        point: "tip" or "marker".
        mechanics: What solves the shapes; None for arcs.
    """
    states = commanded_states(bench, commands, point=point)
    points = Forward(states, mechanics or UnloadedMechanics()).points(bench)[:, 0]
    kind, unit = ("tendon_displacement", "m") if bench.drives_displacement else ("tension", "n")
    header = ["time_s", *(f"{kind}_{index + 1}_{unit}" for index in range(commands.shape[1]))]
    rows = np.column_stack([states.times, commands, points + noise_m * random.normal(size=points.shape)])
    with write_file_whole(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*header, *axes_of(f"{point}_{{}}_m")])
        writer.writerows([[f"{value:.9g}" if np.isfinite(value) else "" for value in row] for row in rows])
    return path
