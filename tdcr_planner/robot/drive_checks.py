"""Checks of the drive of a version 2 robot: counts, pretension and displacement against the tendons."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from tdcr_planner.robot.drive import PER_TENDON, DriveTable
from tdcr_planner.robot.faults import Faults, Place, name_of
from tdcr_planner.robot.tendons import Tendon

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec


def check_counts(robot: RobotSpec, faults: Faults) -> None:
    """Notes every list of the drive that has not as many values as there are tendons, and tension limits left out."""
    count, table = len(robot.tendon_tables), robot.drive_table or DriveTable()
    for key in PER_TENDON:
        values = getattr(table, key)
        if values is not None and len(values) not in (1, count):
            faults.add(("drive", key), f"expected one for all tendons or one for each of {count}, got {len(values)}")
    for index, said in enumerate(robot.tendon_tables):
        if table.kind == "tension" and said.max_tension_n is None:
            faults.add(("tendons", index, "max_tension_n"), "missing, and it is required with tension drive")


def check_drive_limits(robot: RobotSpec, faults: Faults) -> None:
    """Notes the first tendon that cannot take the drive's pretension or displacement."""
    for index, tendon in enumerate(robot.tendons):
        _check_limits(("tendons", index), tendon, tendon.rest_length(robot.arc_lengths), faults)
        if faults:
            return


def _check_limits(place: Place, tendon: Tendon, length: float, faults: Faults) -> None:
    if tendon.pretension >= tendon.max_tension:
        faults.add(
            ("drive", "pretension_n"),
            f"must be below max_tension_n = {tendon.max_tension:g} of {name_of(place)}, got {tendon.pretension:g}",
        )
    low, high = tendon.max_displacement
    if high < math.inf and max(-low, high) >= length:
        faults.add(
            ("drive", "max_displacement_m"),
            f"must be below the length {length:g} m of {name_of(place)} inside the robot, got [{low:g}, {high:g}]; "
            "is it in mm?",
        )
