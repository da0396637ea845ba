"""The list of a robot's tendons, from the segments of a version 1 file or the tables of a version 2 file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.robot.paths import polar_path
from tdcr_planner.robot.tendons import Tendon, TendonTable, infinite_if_none

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec


def tendons_of_segments(robot: RobotSpec) -> tuple[Tendon, ...]:
    """Returns the tendons of a version 1 robot, segment by segment: straight, frictionless, from the base."""
    tendons: list[Tendon] = []
    end_disk = 0
    for index, segment in enumerate(robot.segments):
        end_disk += segment.disks
        end = float(robot.arc_lengths[end_disk])
        limit = infinite_if_none(segment.max_tendon_displacement_m)
        for angle in segment.tendon_angles_deg or ():
            tendons.append(
                Tendon(
                    segment=index,
                    start_disk=0,
                    end_disk=end_disk,
                    start_arc_length=0.0,
                    end_arc_length=end,
                    path=polar_path(0.0, end, angle, segment.tendon_circle_radius_m or 0.0, None, 0.0),
                    between_disks="channel",
                    friction_coefficient=0.0,
                    sheath_angle=0.0,
                    axial_stiffness=infinite_if_none(segment.tendon_axial_stiffness_n),
                    max_tension=infinite_if_none(segment.max_tension_n),
                    max_displacement=(-limit, limit),
                    pretension=segment.pretension_n,
                )
            )
    return tuple(tendons)


def last_disks(robot: RobotSpec) -> list[int]:
    """Returns the last disk of each segment."""
    return [int(disk) for disk in np.cumsum([segment.disks for segment in robot.segments])]


def end_disk_of(robot: RobotSpec, table: TendonTable) -> int:
    """Returns the disk at which a tendon ends."""
    if table.end_disk is not None:
        return table.end_disk
    assert table.segment is not None
    return last_disks(robot)[table.segment - 1]


def tendons_of_tables(robot: RobotSpec) -> tuple[Tendon, ...]:
    """Returns the tendons of a version 2 robot in the order of its file."""
    drive = robot.drive
    low, high = drive.max_displacement
    tendons = []
    for index, table in enumerate(robot.tendon_tables):
        end_disk = end_disk_of(robot, table)
        start, end = float(robot.arc_lengths[table.start_disk]), float(robot.arc_lengths[end_disk])
        tendons.append(
            Tendon(
                segment=int(robot.disk_segments[end_disk]),
                start_disk=table.start_disk,
                end_disk=end_disk,
                start_arc_length=start,
                end_arc_length=end,
                path=table.path(start, end),
                between_disks=table.between_disks,
                friction_coefficient=table.friction_coefficient,
                sheath_angle=math.radians(table.sheath_angle_deg),
                axial_stiffness=infinite_if_none(table.axial_stiffness_n),
                max_tension=infinite_if_none(table.max_tension_n),
                max_displacement=(float(low[index]), float(high[index])),
                pretension=float(drive.pretension[index]),
            )
        )
    return tuple(tendons)
