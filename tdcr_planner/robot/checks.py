"""Checks of a whole robot: parts that would stand in one another, tendons outside of their disks, impossible limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.robot.backbone import Backbone
from tdcr_planner.robot.drive_checks import check_counts, check_drive_limits
from tdcr_planner.robot.faults import Faults, Place
from tdcr_planner.robot.routing_checks import check_ends, check_routes

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec


def check_robot(robot: RobotSpec) -> None:
    """Raises ValueError, or pydantic's ValidationError with the place of each fault, for a robot impossible."""
    _check_cross_sections(robot)
    if robot.format == "tdcr-robot/1":
        _check_tendon_circles(robot)
        return
    for check in (
        _check_rods,
        _check_last_disk,
        check_ends,
        check_counts,
        check_routes,
        check_drive_limits,
        _check_bends,
    ):
        faults = Faults()
        check(robot, faults)
        faults.raise_if_any("RobotSpec")


def _check_cross_sections(robot: RobotSpec) -> None:
    for index, (segment, backbone) in enumerate(zip(robot.segments, robot.segment_backbones, strict=True)):
        if backbone.radius_m >= segment.disk_radius_m:
            raise ValueError(
                f"segments[{index + 1}]: the backbone's radius_m must be below disk_radius_m = "
                f"{segment.disk_radius_m:g}, got {backbone.radius_m:g}: a backbone is narrower than its disks; is it "
                "in mm?"
            )


def _check_tendon_circles(robot: RobotSpec) -> None:
    """Refuses tendon circles of a version 1 robot inside of the backbone or outside of the disks that they pass."""
    for index, (segment, backbone) in enumerate(zip(robot.segments, robot.segment_backbones, strict=True)):
        name = f"segments[{index + 1}]"
        for other, passing in enumerate(robot.segments[index:], index):
            tendons, circle = f"segments[{other + 1}].tendon_circle_radius_m", passing.tendon_circle_radius_m or 0.0
            if circle <= backbone.radius_m:
                raise ValueError(
                    f"{tendons} must be above the backbone's radius_m = {backbone.radius_m:g} in {name}, got "
                    f"{circle:g}: tendons run outside of the backbone"
                )
            if circle >= segment.disk_radius_m:
                raise ValueError(
                    f"{tendons} must be below disk_radius_m = {segment.disk_radius_m:g} of {name}, got {circle:g}: "
                    "tendons pass the disks of all segments before their own"
                )
        own = segment.tendon_circle_radius_m or 0.0
        if robot.body.tendon_radius_m >= own:
            raise ValueError(
                f"body.tendon_radius_m must be below tendon_circle_radius_m = {own:g} of {name}, got "
                f"{robot.body.tendon_radius_m:g}: a tendon does not reach the backbone's axis"
            )


def _check_rods(robot: RobotSpec, faults: Faults) -> None:
    """Refuses taper points and rigid stretches that lie beyond the rod, and rigid stretches within rigid segments."""
    rods: list[tuple[Place, Backbone, float, str]] = [
        (("backbone",), robot.backbone, robot.length, "the robot's length")
    ]
    for index, segment in enumerate(robot.segments):
        if segment.backbone is not None:
            rods.append((("segments", index, "backbone"), segment.backbone, segment.length_m, "length_m"))
    for place, rod, length, what in rods:
        for key, ends in (
            ("radius_points_m", [s for s, _ in rod.radius_points_m or ()]),
            ("rigid_stretches_m", [end for _, end in rod.rigid_stretches_m]),
        ):
            if ends and max(ends) > length * (1.0 + 1e-9):
                faults.add((*place, key), f"arc lengths must be at most {what} = {length:g} m, got {max(ends):g}")
    for index, (segment, rod) in enumerate(zip(robot.segments, robot.segment_backbones, strict=True)):
        if not segment.rigid:
            continue
        start = 0.0 if segment.backbone is not None else float(robot.segment_starts[index])
        for low, high in rod.rigid_stretches_m:
            if low < start + segment.length_m and high > start:
                faults.add(
                    ("segments", index, "rigid"),
                    f"the segment is rigid as a whole and rigid_stretches_m overlaps it with [{low:g}, {high:g}]; "
                    "leave one of them out",
                )


def _check_last_disk(robot: RobotSpec, faults: Faults) -> None:
    last = robot.segments[-1]
    if last.disk_positions_m is not None and last.disk_places[-1] != last.length_m:
        faults.add(
            ("segments", len(robot.segments) - 1, "disk_positions_m"),
            f"the robot's last disk is its tip and must stand at length_m = {last.length_m:g}, got "
            f"{last.disk_places[-1]:g}",
        )


def _check_bends(robot: RobotSpec, faults: Faults) -> None:
    ends = robot.joins
    middles = 0.5 * (ends + np.concatenate([[0.0], ends[:-1]]))
    if robot.rigid_at(middles).all():
        faults.add(("segments",), "rigid all along: a robot needs a stretch that bends")
