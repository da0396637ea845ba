"""The states of a result as files: trajectory.csv, a row a state, and shapes.npz with every disk pose."""

from __future__ import annotations

import csv
import logging
import math
import os
from pathlib import Path

import numpy as np

from tdcr_planner.array_schema import ArraySchema, ArraySpec, read_arrays
from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError
from tdcr_planner.files import sha256_of_file
from tdcr_planner.planning.coordinates import drive_key
from tdcr_planner.query.result import PlanResult

_log = logging.getLogger(__name__)

MOST_STATES = 10_000_000
"""Of a path: verification solves some thousand a second, so that more would take hours."""

# NaN: a state without a shape.
_SHAPES = ArraySchema(
    "shapes.npz",
    {
        "arc_lengths_m": ArraySpec("float64", ("disks",), low=0.0),
        "time_s": ArraySpec("float64", ("path states",), low=0.0),
        "converged": ArraySpec("boolean", ("states",)),
        "positions_m": ArraySpec("float64", ("states", "disks", 3), may_be_nan=True),
        "rotations": ArraySpec("float64", ("states", "disks", 3, 3), low=-1.01, high=1.01, may_be_nan=True),
        "model_positions_m": ArraySpec("float64", ("states", "disks", 3), may_be_nan=True, required=False),
    },
    {"path states": MOST_STATES},
)


def trajectory_table(result: PlanResult) -> tuple[list[str], FloatArray]:
    """Returns the columns of the trajectory, units in their names, and its rows, shape (k, columns)."""
    robot = result.scenario.robot
    names = ["time_s", "insertion_m", "roll_deg"]
    key = drive_key(robot)
    if key.startswith("bending"):
        unit = key[-1]
        names += [f"bending_{segment + 1}_{axis}_{unit}" for segment in range(robot.segment_count) for axis in "xy"]
    names += [f"tension_{tendon + 1}_n" for tendon in range(robot.tendon_count)]
    names += [f"tendon_displacement_{tendon + 1}_m" for tendon in range(robot.tendon_count)]
    names += ["tip_x_m", "tip_y_m", "tip_z_m"]
    path = result.path
    if path is None:
        return names, np.zeros((0, len(names)))
    columns = [
        path.times[:, None],
        path.insertion[:, None],
        np.rad2deg(path.roll)[:, None],
        *([path.bending.reshape(len(path), -1)] if key.startswith("bending") else []),
        path.tensions,
        path.tendon_displacements,
        path.tip_positions,
    ]
    return names, np.concatenate(columns, axis=1)


def write_trajectory_csv(result: PlanResult, file: str | Path) -> None:
    """Writes trajectory.csv: a header with units, then a row a state; a result without a path has the header alone.

    A number that is not known is an empty field.
    """
    names, rows = trajectory_table(result)
    with Path(file).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([repr(value) if math.isfinite(value) else "" for value in row] for row in rows.tolist())


def write_shapes(result: PlanResult, file: str | Path) -> None:
    """Writes shapes.npz: every verified state's disk poses in the world frame; zero states without a verification.

    Its arrays: `arc_lengths_m` (d,), `time_s` (k,), `converged` (k,), `positions_m` (k, d, 3), `rotations`
    (k, d, 3, 3) world_from_disk, and `model_positions_m` (k, d, 3) of the shape model where one was compared.
    """
    report, robot = result.verification, result.scenario.robot
    count = robot.disk_count
    arrays = {
        "arc_lengths_m": robot.arc_lengths,
        "time_s": np.zeros(0) if result.path is None else result.path.times,
        "converged": np.zeros(0, dtype=np.bool_) if report is None else report.converged,
        "positions_m": np.zeros((0, count, 3)) if report is None else report.positions,
        "rotations": np.zeros((0, count, 3, 3)) if report is None else report.rotations,
    }
    if report is not None and report.model_positions is not None:
        arrays["model_positions_m"] = report.model_positions
    np.savez_compressed(file, allow_pickle=False, **arrays)


def read_shapes(file: Path, digest: str, count: int, disks: int) -> dict[str, FloatArray]:
    """Returns the poses of shapes.npz, or NaN poses with a warning where the file is missing.

    Args:
        file: The file.
        digest: The SHA-256 that it should have.
        count: Number of states k.
        disks: Number of disks d.

    Raises:
        FormatError: It is another file than the one that was written with the result, or holds other shapes.
    """
    if not os.path.lexists(file):
        _log.warning("%s: no such file; shapes are left out", file)
        return {
            "positions_m": np.full((count, disks, 3), np.nan),
            "rotations": np.full((count, disks, 3, 3), np.nan),
        }
    if sha256_of_file(file) != digest:
        raise FormatError(file, "belongs to another result than the result.json beside it, or is damaged")
    shapes, _ = read_arrays(file, _SHAPES, {"states": count, "disks": disks})
    return shapes
