"""Measured shapes from a test bench: reading their file and refusing what cannot have been measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.table import MeasuredTable, axes_of, read_table
from tdcr_planner.errors import FormatError
from tdcr_planner.learning.dataset import Cases
from tdcr_planner.learning.loads import LARGEST_GRAVITY_M_S2, LARGEST_LOAD_RATIO, load_ratio
from tdcr_planner.robot import RobotSpec


@dataclass(frozen=True)
class MeasuredShapes:
    """Tracked points of a real robot.

    Attributes:
        path: The CSV file.
        cases: Tensions and loads, n of them.
        disks: Indices of the tracked disks, shape (k,).
        positions: Their centres, shape (n, k, 3), m, base frame; NaN where a marker was not seen.
    """

    path: Path
    cases: Cases
    disks: tuple[int, ...]
    positions: FloatArray


def read_measured_shapes(path: str | Path, robot: RobotSpec) -> MeasuredShapes:
    """Returns the measured shapes in a CSV file.

    One row a shape, with a header. Columns, in any order:

    - `tension_1_n` ... one a tendon, in the robot file's order, N, as in trajectory.csv; or, when there is a
      `tension_0_n`, counted from 0;
    - `disk_<i>_x_m`, `disk_<i>_y_m`, `disk_<i>_z_m` for one or more disks i from 1 to d - 1, m, base frame; an empty
      field where the marker was not seen;
    - optional `gravity_x_m_s2`, `gravity_y_m_s2`, `gravity_z_m_s2`, base frame (else no gravity);
    - optional `tip_force_x_n`, `tip_force_y_n`, `tip_force_z_n`, base frame (else none).

    Raises:
        FormatError: Columns are missing or unknown, a field is no finite number, a tension is negative or far beyond
            its limit, or positions or loads are beyond this robot, as they are in the wrong unit.
    """
    table = read_table(path)
    tendons = _tension_columns(table.header, robot)
    disks = _check_columns(path, table.header, tendons, robot)
    tensions = table.numbers(tendons)
    loads = []
    for names in (axes_of("gravity_{}_m_s2"), axes_of("tip_force_{}_n")):
        loads.append(table.numbers(names) if names[0] in table.header else np.zeros((len(table.rows), 3)))
    names = [name for disk in disks for name in axes_of(f"disk_{disk}_{{}}_m")]
    positions = table.numbers(names, may_be_empty=True).reshape(len(table.rows), len(disks), 3)
    _check_values(table, tendons, tensions, positions, disks, robot)
    gravity, tip_force = loads
    _check_loads(table, gravity, tip_force, robot)
    return MeasuredShapes(Path(path), Cases(tensions, gravity, tip_force), disks, positions)


def _tension_columns(header: tuple[str, ...], robot: RobotSpec) -> list[str]:
    """Returns the names of the tensions' columns in the tendons' order, counted as the file counts them."""
    first = 0 if "tension_0_n" in header else 1
    return [f"tension_{first + tendon}_n" for tendon in range(robot.tendon_count)]


def _check_columns(path: str | Path, header: tuple[str, ...], tensions: list[str], robot: RobotSpec) -> tuple[int, ...]:
    """Returns the tracked disks, or says which columns are missing, doubled or unknown."""
    optional = [axes_of("gravity_{}_m_s2"), axes_of("tip_force_{}_n")]
    tracked = {disk: axes_of(f"disk_{disk}_{{}}_m") for disk in range(1, robot.disk_count)}
    present = set(header)
    missing = [name for name in tensions if name not in present]
    for group in [*optional, *tracked.values()]:
        if present.intersection(group):
            missing += [name for name in group if name not in present]
    if missing:
        raise FormatError(path, f"missing columns: {', '.join(missing)}")
    known = {*tensions, *(name for group in [*optional, *tracked.values()] for name in group)}
    unknown = [name for name in header if name not in known]
    if unknown:
        raise FormatError(
            path,
            f"unknown column; expected {tensions[0]} to {tensions[-1]}, disk_1_x_m to disk_{robot.disk_count - 1}_z_m, "
            f"{', '.join(optional[0] + optional[1])}",
            unknown[0] or "empty column name",
        )
    disks = tuple(disk for disk, names in tracked.items() if names[0] in present)
    if not disks:
        raise FormatError(path, "missing columns: no disk is tracked, expected for example disk_1_x_m, _y_m, _z_m")
    return disks


def _check_values(
    table: MeasuredTable,
    tendons: list[str],
    tensions: FloatArray,
    positions: FloatArray,
    disks: tuple[int, ...],
    robot: RobotSpec,
) -> None:
    """Finds what no robot can do: pushing tendons, tensions far over their limits, points out of reach or all at 0."""
    limits = 2.0 * robot.max_tensions
    wrong = np.argwhere((tensions < 0.0) | (tensions > limits))
    if len(wrong):
        row, column = wrong[0]
        raise FormatError(
            table.path,
            f"expected 0 to {limits[column] / 2.0:g} N, got {tensions[row, column]:g}; is the unit newton?",
            table.place(int(row), tendons[column]),
        )
    reach = robot.arc_lengths[list(disks)]
    distance = np.linalg.norm(positions, axis=2)
    far = np.argwhere(distance > 1.05 * reach + robot.disk_radii[list(disks)])
    if len(far):
        row, column = far[0]
        raise FormatError(
            table.path,
            f"disk {disks[column]} is {distance[row, column]:g} m from the base, and the robot reaches "
            f"{reach[column]:g} m there; is the unit metre and the frame the base frame?",
            table.place(int(row)),
        )
    seen = np.isfinite(distance)
    if not seen.any():
        raise FormatError(table.path, "no marker was seen in any row")
    if np.nanmax(distance / reach) < 0.01:
        raise FormatError(
            table.path,
            f"all points lie within {np.nanmax(distance):g} m of the base of a robot of {robot.length:g} m; "
            "is the unit metre?",
        )


def _check_loads(table: MeasuredTable, gravity: FloatArray, tip_force: FloatArray, robot: RobotSpec) -> None:
    """Finds gravity that no bench stands in, and forces under which stiffness would hardly count."""
    pull, force = np.linalg.norm(gravity, axis=1), np.linalg.norm(tip_force, axis=1)
    for row in np.flatnonzero(pull > LARGEST_GRAVITY_M_S2)[:1]:
        problem = f"expected a gravity of at most {LARGEST_GRAVITY_M_S2:g} m/s^2, got {pull[row]:g}; is the unit m/s^2?"
        raise FormatError(table.path, problem, table.place(int(row)))
    for row in np.flatnonzero(load_ratio(robot, pull, force) > LARGEST_LOAD_RATIO)[:1]:
        problem = f"a tip force of {force[row]:g} N is far beyond what this robot carries; is the unit newton?"
        raise FormatError(table.path, problem, table.place(int(row)))
