"""What no test bench can have measured: wrong units, another robot's numbers, time that runs backwards."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.calibration.table import MeasuredTable
from tdcr_planner.errors import FormatError
from tdcr_planner.robot import RobotSpec

LARGEST_GRAVITY_M_S2 = 100.0
"""Ten times the Earth's."""
LARGEST_FORCE_N = 1000.0
LARGEST_TENSION_RATIO = 2.0
"""Tensions of more than this many times the robot's limit are another robot's, or in another unit."""
LONGEST_GAP = 50.0
"""Between two states, in median intervals: what moved the tendons in a longer gap is not known."""
LEAST_SPREAD = 0.01
"""Of the positions, in lengths of the robot: less is no motion, or another unit."""
MARKER_ROOM = 0.5
"""How far beyond the tip a marker may be, in lengths of the robot."""


def check_constant(table: MeasuredTable, name: str) -> None:
    """Refuses a column whose values differ."""
    values = table.numbers([name])[:, 0]
    for row in np.flatnonzero(values != values[0])[:1]:
        raise FormatError(
            table.path,
            f"expected the same as in the first row, {values[0]:g}, got {values[row]:g}: calibration needs a base that "
            "stands still",
            table.place(int(row), name),
        )


def check_times(table: MeasuredTable, times: FloatArray) -> None:
    """Refuses times that do not increase."""
    for row in np.flatnonzero(np.diff(times) <= 0.0)[:1] + 1:
        raise FormatError(
            table.path,
            f"expected a time after that of the row before, {times[row - 1]:.6f} s, got {times[row]:.6f} s: the rows "
            "must be in the order in time, since friction depends on it",
            table.place(int(row), "time_s"),
        )


def check_gaps(table: MeasuredTable, times: FloatArray) -> None:
    """Refuses a sequence in which the motion of a long time is missing."""
    intervals = np.diff(times)
    longest = LONGEST_GAP * np.median(intervals) if len(intervals) else 0.0
    for row in np.flatnonzero(intervals > longest)[:1]:
        raise FormatError(
            table.path,
            f"no state for {intervals[row]:.4g} s before this one, expected at most {longest:.4g} s "
            f"({LONGEST_GAP:g} median intervals): friction depends on how the robot came here; calibrate the parts by "
            "themselves, or leave friction out of --fit",
            table.place(int(row) + 1, "time_s"),
        )


def check_actuation(table: MeasuredTable, robot: RobotSpec, displacements: FloatArray, tensions: FloatArray) -> None:
    """Refuses displacements beyond a tendon's length, tensions that push, and tensions far beyond the limits."""
    lengths = robot.rest_path_lengths
    for row, column in np.argwhere(np.abs(displacements) >= lengths)[:1]:
        raise FormatError(
            table.path,
            f"expected less than the {lengths[column]:g} m of the tendon inside the robot, got "
            f"{displacements[row, column]:g}; is it in mm?",
            table.place(int(row), f"tendon_displacement_{column + 1}_m"),
        )
    limits = LARGEST_TENSION_RATIO * robot.max_tensions
    with np.errstate(invalid="ignore"):
        wrong = np.argwhere((tensions < 0.0) | (tensions > limits))
    for row, column in wrong[:1]:
        raise FormatError(
            table.path,
            f"expected 0 to {limits[column] / LARGEST_TENSION_RATIO:g} N, got {tensions[row, column]:g}; is the unit "
            "newton, and is it this robot?",
            table.place(int(row), f"tension_{column + 1}_n"),
        )
    if not np.ptp(displacements, axis=0).any() and not np.nanmax(np.ptp(tensions, axis=0), initial=0.0):
        raise FormatError(table.path, "no tendon moves in any row: there is nothing to calibrate from")


def check_positions(
    table: MeasuredTable, robot: RobotSpec, positions: FloatArray, points: IntArray, *, base_is_known: bool
) -> None:
    """Refuses points that this robot does not reach, and points that hardly move, as they are in a wrong unit.

    Args:
        table: The file.
        robot: The robot.
        positions: Shape (n, k, 3), m.
        points: Disk of each point, -1 for tip and marker, shape (k,).
        base_is_known: Whether the positions are in the base frame.
    """
    seen = np.isfinite(positions).all(axis=2)
    if not seen.any():
        raise FormatError(table.path, "no point was seen in any row")
    room = np.where(points < 0, MARKER_ROOM * robot.length, robot.disk_radii.max())
    reach = 1.05 * robot.arc_lengths[points] + room
    centre = np.zeros(3) if base_is_known else np.median(positions[seen], axis=0)
    limits = reach if base_is_known else 2.0 * reach
    distance = np.linalg.norm(positions - centre, axis=2)
    for row, column in np.argwhere(distance > limits)[:1]:
        where = "the base" if base_is_known else "the median of all points"
        frame = " and the frame the base frame (else fit the base, too)" if base_is_known else ""
        raise FormatError(
            table.path,
            f"a point is {distance[row, column]:g} m from {where}, and the robot reaches {limits[column]:g} m; is the "
            f"unit metre{frame}?",
            table.place(int(row)),
        )
    spread = np.nanmax(positions, axis=0) - np.nanmin(positions, axis=0)
    if spread.max() < LEAST_SPREAD * robot.length:
        raise FormatError(
            table.path,
            f"all points move within {spread.max():g} m, on a robot of {robot.length:g} m; is the unit metre?",
        )


def check_loads(table: MeasuredTable, gravity: FloatArray, tip_force: FloatArray) -> None:
    """Refuses gravity that no bench stands in, and forces that no such robot carries."""
    for name, values, largest, unit in (
        ("gravity", gravity, LARGEST_GRAVITY_M_S2, "m/s^2"),
        ("tip force", tip_force, LARGEST_FORCE_N, "N"),
    ):
        size = np.linalg.norm(values, axis=1)
        for row in np.flatnonzero(size > largest)[:1]:
            raise FormatError(
                table.path,
                f"expected a {name} of at most {largest:g} {unit}, got {size[row]:g}; is the unit {unit}?",
                table.place(int(row)),
            )
