"""The hash of all that decides a robot's shape, by which a shape model knows its robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tdcr_planner.files import sha256_of_json
from tdcr_planner.robot.backbone import Backbone
from tdcr_planner.robot.drive import DriveTable
from tdcr_planner.robot.segments import Segment
from tdcr_planner.robot.tendon_list import end_disk_of
from tdcr_planner.robot.tendons import TendonTable

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec

_NO_MECHANICS_OF_SEGMENTS = {
    "disk_radius_m",
    "disk_thickness_m",
    "max_tension_n",
    "pretension_n",
    "tendon_axial_stiffness_n",
    "max_tendon_displacement_m",
}
_NO_MECHANICS_OF_DRIVE = {"max_displacement_m", "spool_radius_m"}


def mechanics_hash(robot: RobotSpec) -> str:
    """Returns the SHA-256 over all that decides a robot's shape; see `RobotSpec.mechanics_hash`."""
    return sha256_of_json(_in_full(robot) if robot.features or not _says_version_1(robot) else _as_version_1(robot))


def _says_version_1(robot: RobotSpec) -> bool:
    """Returns whether the keys of version 1 say all of the mechanics of a robot without features."""
    measured = [
        rod
        for rod in robot.segment_backbones
        if any(getattr(rod, key) not in (None, ()) for key in Backbone.only_version_2)
    ]
    return not measured and all(segment.disk_masses_kg is None for segment in robot.segments)


def _as_version_1(robot: RobotSpec) -> dict[str, Any]:
    """Returns the mechanics of a robot in the keys of a version 1 file."""
    excluded = _NO_MECHANICS_OF_SEGMENTS | {"backbone", *Segment.only_version_2}
    segments = [segment.model_dump(exclude=excluded) for segment in robot.segments]
    if robot.format == "tdcr-robot/2":
        for index, segment in enumerate(segments):
            tables = [robot.tendon_tables[i] for i in np.flatnonzero(robot.tendon_segments == index)]
            segment["tendon_circle_radius_m"] = tables[0].radius_m
            segment["tendon_angles_deg"] = tuple(table.angle_deg for table in tables)
    rod_excluded = {"max_strain", *Backbone.only_version_2}
    return {
        "backbones": [rod.model_dump(exclude=rod_excluded) for rod in robot.segment_backbones],
        "segments": segments,
        "tip": {"mass_kg": robot.tip.mass_kg},
    }


def _in_full(robot: RobotSpec) -> dict[str, Any]:
    """Returns the mechanics of a version 2 robot.

    What the drive and the tendons' stretch do counts where displacement is commanded; commanded tensions act alike.
    """
    displaced = robot.drive.kind == "displacement"
    drive = (robot.drive_table or DriveTable()).model_dump(exclude=_NO_MECHANICS_OF_DRIVE)
    return {
        "backbones": [rod.model_dump(exclude={"max_strain"}) for rod in robot.segment_backbones],
        "segments": [
            {"length_m": segment.length_m, "disks": segment.disk_places.tolist(), "rigid": segment.rigid}
            for segment in robot.segments
        ],
        "disk_masses": robot.disk_masses.tolist(),
        "tendons": [_tendon_in_full(robot, table, displaced) for table in robot.tendon_tables],
        "drive": drive if displaced else {"kind": "tension"},
        "tip": robot.tip.model_dump(),
    }


def _tendon_in_full(robot: RobotSpec, table: TendonTable, displaced: bool) -> dict[str, Any]:
    content = table.model_dump(exclude={"segment", "end_disk", "max_tension_n"})
    content["end_disk"] = end_disk_of(robot, table)
    content["turns"] = table.turns or 0.0
    content["end_radius_m"] = table.radius_m if table.end_radius_m is None else table.end_radius_m
    if not displaced:
        del content["axial_stiffness_n"]
    return content
