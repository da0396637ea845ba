"""Measured states of a real robot: reading their file, in the order in time, with everything named that is missing."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.calibration import checks
from tdcr_planner.calibration.table import MeasuredTable, axes_of, read_table
from tdcr_planner.errors import FormatError, nearest_name
from tdcr_planner.robot import RobotSpec

_GRAVITY, _TIP_FORCE = axes_of("gravity_{}_m_s2"), axes_of("tip_force_{}_n")
_TIP, _MARKER = axes_of("tip_{}_m"), axes_of("marker_{}_m")
_OTHER = ("time_s", "pattern", "insertion_m", "roll_deg", *_GRAVITY, *_TIP_FORCE)
_DISK = re.compile(r"disk_(\d+)_([xyz])_m")
_TENDON = re.compile(r"(tension|tendon_displacement)_(\d+)_(n|m)")


@dataclass(frozen=True)
class MeasuredStates:
    """States of a robot on a test bench, n of them in the order in time, t tendons, k tracked points.

    Attributes:
        table: The file.
        displacements: Tendon displacements, shape (n, t), m; zeros where the drive sets tensions.
        tensions: Tensions, shape (n, t), N: what the drive has set, or with displacement drive what sensors have
            measured (NaN where they have not).
        points: Disk of each tracked point; the marker counts as on the last disk, shape (k,).
        is_marker: Whether a tracked point is the marker, of which the place in the last disk's frame may be fitted,
            shape (k,).
        positions: Of the tracked points, shape (n, k, 3), m, NaN where one was not seen.
        times: Shape (n,), s from the first state; counts of states where the file has no time.
        timed: Whether the file has times.
        gravity: Shape (n, 3), m/s^2, base frame.
        tip_force: Shape (n, 3), N, base frame.
        patterns: Name of the pattern of motion to which each state belongs; empty where the file has none.
    """

    table: MeasuredTable
    displacements: FloatArray
    tensions: FloatArray
    points: IntArray
    is_marker: tuple[bool, ...]
    positions: FloatArray
    times: FloatArray
    timed: bool
    gravity: FloatArray
    tip_force: FloatArray
    patterns: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def path(self) -> Path:
        """The CSV file."""
        return self.table.path

    def point_names(self) -> list[str]:
        """Returns the name of each tracked point."""
        return [
            "marker" if marker else f"disk {disk}" for disk, marker in zip(self.points, self.is_marker, strict=True)
        ]


def read_measured_states(path: str | Path, robot: RobotSpec, *, base_is_known: bool = True) -> MeasuredStates:
    """Returns the measured states in a CSV file, a row a state in the order in time.

    Columns, in any order:

    - `tendon_displacement_1_m` ... one a tendon, for a robot with displacement drive, or `tension_1_n` ... for one
      with tension drive, counted from 1 as in trajectory.csv, or from 0 when there is a number 0. With displacement
      drive `tension_1_n` ... are measured tensions, and may be empty;
    - one or more of `tip_x_m, _y_m, _z_m` (centre of the last disk), `disk_<k>_x_m` ..., `marker_x_m` ...: m, base
      frame; empty where a point was not seen;
    - optional `time_s`, `pattern`, `gravity_x_m_s2` ..., `tip_force_x_n` ..., and of trajectory.csv `insertion_m`
      and `roll_deg`, which must stay the same.

    Args:
        path: The file.
        robot: The robot that was measured.
        base_is_known: Whether positions are in the base frame; else in a frame of the measuring system.

    Raises:
        FormatError: Columns are missing or unknown, a field is no finite number, times run backwards, or values are
            beyond this robot, as they are in a wrong unit or of another robot.
    """
    table = read_table(path)
    _check_known(table, robot)
    drive = _actuation(table, robot)
    points, is_marker, names = _points(table)
    positions = table.numbers(names, may_be_empty=True).reshape(len(table.rows), len(points), 3)
    timed = "time_s" in table.header
    times = table.numbers(["time_s"])[:, 0] if timed else np.arange(float(len(table.rows)))
    gravity, tip_force = (
        table.numbers(group) if group[0] in table.header else np.zeros((len(table.rows), 3))
        for group in (_GRAVITY, _TIP_FORCE)
    )
    for name in ("insertion_m", "roll_deg"):
        if name in table.header:
            checks.check_constant(table, name)
    if timed:
        checks.check_times(table, times)
    displacements, tensions = drive
    checks.check_actuation(table, robot, displacements, tensions)
    checks.check_positions(table, robot, positions, points, base_is_known=base_is_known)
    checks.check_loads(table, gravity, tip_force)
    patterns = tuple(table.texts("pattern")) if "pattern" in table.header else ()
    return MeasuredStates(
        table,
        displacements,
        tensions,
        points,
        is_marker,
        positions,
        times - times[0],
        timed,
        gravity,
        tip_force,
        patterns,
    )


def _check_known(table: MeasuredTable, robot: RobotSpec) -> None:
    """Refuses unknown columns, vectors of which a component is missing, and more tendons than the robot has."""
    known = {*_OTHER, *_TIP, *_MARKER}
    for name in table.header:
        disk, tendon = _DISK.fullmatch(name), _TENDON.fullmatch(name)
        if disk and not 1 <= int(disk[1]) < robot.disk_count:
            raise FormatError(table.path, f"expected disks 1 to {robot.disk_count - 1}, the robot's own", name)
        if not (disk or tendon or name in known):
            examples = {*known, "tension_1_n", "tendon_displacement_1_m", "disk_1_x_m"}
            raise FormatError(
                table.path, f"unknown column; {nearest_name(name, examples)}", name or "empty column name"
            )
    groups = [_GRAVITY, _TIP_FORCE, _TIP, _MARKER]
    groups += [axes_of(f"disk_{disk}_{{}}_m") for disk in range(1, robot.disk_count)]
    missing = [name for group in groups if set(group) & set(table.header) for name in group if name not in table.header]
    if missing:
        raise FormatError(table.path, f"missing columns: {', '.join(missing)}")


def _tendon_columns(table: MeasuredTable, robot: RobotSpec, kind: str) -> list[str]:
    """Returns the columns of one kind, in the tendons' order; none where the file has none of that kind."""
    found = [match for match in map(_TENDON.fullmatch, table.header) if match and match[1] == kind]
    if not found:
        return []
    unit = "n" if kind == "tension" else "m"
    first = 0 if any(int(match[2]) == 0 for match in found) else 1
    names = [f"{kind}_{first + tendon}_{unit}" for tendon in range(robot.tendon_count)]
    missing = [name for name in names if name not in table.header]
    if missing:
        raise FormatError(
            table.path, f"missing columns: {', '.join(missing)}: robot {robot.name!r} has {len(names)} tendons"
        )
    extra = [match[0] for match in found if match[0] not in names]
    if extra:
        raise FormatError(
            table.path,
            f"robot {robot.name!r} has {len(names)} tendons, {names[0]} to {names[-1]}; is this another robot's?",
            extra[0],
        )
    return names


def _actuation(table: MeasuredTable, robot: RobotSpec) -> tuple[FloatArray, FloatArray]:
    by_displacement = robot.drive.kind == "displacement"
    wanted = "tendon_displacement" if by_displacement else "tension"
    names = _tendon_columns(table, robot, wanted)
    if not names:
        unit = "m" if by_displacement else "n"
        raise FormatError(
            table.path,
            f"missing columns: {wanted}_1_{unit} to {wanted}_{robot.tendon_count}_{unit}, what the drive of robot "
            f"{robot.name!r} sets ([drive] kind = {robot.drive.kind!r})",
        )
    values = table.numbers(names)
    if not by_displacement:
        return np.zeros_like(values), values
    sensors = _tendon_columns(table, robot, "tension")
    measured = table.numbers(sensors, may_be_empty=True) if sensors else np.full_like(values, np.nan)
    return values, measured


def _points(table: MeasuredTable) -> tuple[IntArray, tuple[bool, ...], list[str]]:
    """Returns disk and kind of each tracked point, and their columns."""
    disks = sorted({int(match[1]) for match in map(_DISK.fullmatch, table.header) if match})
    points, is_marker = list(disks), [False] * len(disks)
    names = [name for disk in disks for name in axes_of(f"disk_{disk}_{{}}_m")]
    for group, marker in ((_TIP, False), (_MARKER, True)):
        if group[0] in table.header:
            points.append(-1)
            is_marker.append(marker)
            names += group
    if not points:
        raise FormatError(
            table.path,
            f"missing columns: no point is tracked, expected for example {', '.join(_TIP)} or {', '.join(_MARKER)}",
        )
    return np.array(points, dtype=np.int64), tuple(is_marker), names
