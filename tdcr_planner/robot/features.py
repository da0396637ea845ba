"""What a robot has that a version 1 file cannot say, by name, and refusing it where it is not known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.errors import InputError
from tdcr_planner.robot.tendon_list import last_disks

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec

FEATURES = (
    "helical tendons",
    "converging tendons",
    "tendons through points",
    "straight tendons between disks",
    "tendons that start beyond the base",
    "tendons that end inside a segment",
    "tendons not in the order of the segments",
    "tendons that do not surround the backbone on one circle",
    "friction",
    "displacement drive",
    "elastic transmission",
    "backlash",
    "uneven displacement limits",
    "no tension limit",
    "taper",
    "stiffness by axis",
    "rigid stretches",
    "disks at given places",
    "payload off the last disk's centre",
)
"""Every name that `RobotSpec.features` can hold."""


def features_of(robot: RobotSpec) -> frozenset[str]:
    """Returns the names of what a robot has that a version 1 file cannot say; see `RobotSpec.features`."""
    if robot.format == "tdcr-robot/1":
        return frozenset()
    return frozenset([*_of_tendons(robot), *_of_drive(robot), *_of_rod(robot)])


def _of_tendons(robot: RobotSpec) -> Iterator[str]:
    ends = set(last_disks(robot))
    straight = True
    for tendon in robot.tendons:
        yield from tendon.path.kinds
        straight = straight and tendon.straight_path is not None
        if tendon.between_disks == "straight":
            yield "straight tendons between disks"
        if tendon.start_disk > 0:
            yield "tendons that start beyond the base"
        if tendon.end_disk not in ends:
            yield "tendons that end inside a segment"
        if tendon.friction_coefficient > 0.0:
            yield "friction"
        if not np.isfinite(tendon.max_tension):
            yield "no tension limit"
    if (np.diff(robot.tendon_segments) < 0).any():
        yield "tendons not in the order of the segments"
    if straight:
        try:
            _ = robot.segment_circles
        except InputError:
            yield "tendons that do not surround the backbone on one circle"


def _of_drive(robot: RobotSpec) -> Iterator[str]:
    drive = robot.drive
    if drive.kind == "displacement":
        yield "displacement drive"
    if np.isfinite(drive.transmission_stiffness).any():
        yield "elastic transmission"
    if drive.backlash.any():
        yield "backlash"
    low, high = drive.max_displacement
    if (low != -high).any():
        yield "uneven displacement limits"


def _of_rod(robot: RobotSpec) -> Iterator[str]:
    for segment, rod in zip(robot.segments, robot.segment_backbones, strict=True):
        if rod.radius_points_m is not None:
            yield "taper"
        if not rod.is_isotropic:
            yield "stiffness by axis"
        if segment.rigid or rod.rigid_stretches_m:
            yield "rigid stretches"
        if segment.disk_positions_m is not None:
            yield "disks at given places"
    if robot.tip.mass_kg > 0.0 and any(robot.tip.offset_m):
        yield "payload off the last disk's centre"


def refuse_unknown(robot: RobotSpec, known: Iterable[str], who: str) -> None:
    """Refuses a robot that has what a part of the program does not know.

    Args:
        robot: The robot.
        known: The names, of `FEATURES`, of what that part knows.
        who: That part, for the message, such as "the planner".

    Raises:
        InputError: Names all that is not known.
    """
    unknown = sorted(robot.features - frozenset(known))
    if unknown:
        knows = f"what version 1 of the robot file can say{''.join(f', {name}' for name in sorted(known))}"
        raise InputError(f"robot {robot.name!r}", f"a robot that {who} knows ({knows})", ", ".join(unknown))
