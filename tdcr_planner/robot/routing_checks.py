"""Checks of where the tendons of a version 2 robot start, end and run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.robot.faults import Faults, Place
from tdcr_planner.robot.tendon_list import end_disk_of
from tdcr_planner.robot.tendons import Tendon

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec

SAMPLES_PER_GAP = 24
MOST_TENDONS = 200


def check_ends(robot: RobotSpec, faults: Faults) -> None:
    """Notes every fault of where tendons start and end."""
    if not robot.tendon_tables:
        faults.add(("tendons",), "missing, and it is required: one or more [[tendons]]")
    if len(robot.tendon_tables) > MOST_TENDONS:
        faults.add(("tendons",), f"expected at most {MOST_TENDONS} tendons, got {len(robot.tendon_tables)}")
    for index, table in enumerate(robot.tendon_tables):
        place: Place = ("tendons", index)
        if table.segment is not None and table.segment > robot.segment_count:
            faults.add((*place, "segment"), f"expected a segment from 1 to {robot.segment_count}, got {table.segment}")
            continue
        if table.end_disk is not None and table.end_disk >= robot.disk_count:
            faults.add(
                (*place, "end_disk"),
                f"expected a disk from 1 to {robot.disk_count - 1}, the last, got {table.end_disk}",
            )
            continue
        end = end_disk_of(robot, table)
        if table.start_disk >= end:
            faults.add(
                (*place, "start_disk"),
                f"a tendon must start before the disk {end} at which it ends, got {table.start_disk}",
            )
        elif table.points_m is not None:
            _check_points_reach(robot, (*place, "points_m"), table.points_m, table.start_disk, end, faults)


def _check_points_reach(
    robot: RobotSpec,
    place: Place,
    points: tuple[tuple[float, float, float], ...],
    start_disk: int,
    end_disk: int,
    faults: Faults,
) -> None:
    start, end = float(robot.arc_lengths[start_disk]), float(robot.arc_lengths[end_disk])
    first, last = points[0][0], points[-1][0]
    tolerance = 1e-9 * robot.length
    if abs(first - start) > tolerance or abs(last - end) > tolerance:
        faults.add(
            place,
            f"arc lengths must run from disk {start_disk} at {start:g} m to disk {end_disk} at {end:g} m, got "
            f"{first:g} to {last:g} m; they count from the robot's base",
        )
        return
    widest = float(robot.disk_radii[start_disk : end_disk + 1].max())
    for row, (_, x, y) in enumerate(points):
        if math.hypot(x, y) >= widest:
            faults.add(
                place,
                f"a tendon must pass within its disks: below disk_radius_m = {widest:g}, got {math.hypot(x, y):g} m in "
                f"row {row + 1}; are x and y in mm?",
            )
            return


def check_routes(robot: RobotSpec, faults: Faults) -> None:
    """Notes every tendon that leaves the disks that it passes, or meets the backbone."""
    for index, tendon in enumerate(robot.tendons):
        _check_route(robot, ("tendons", index), tendon, faults)


def _check_route(robot: RobotSpec, place: Place, tendon: Tendon, faults: Faults) -> None:
    stops = robot.arc_lengths[tendon.start_disk : tendon.end_disk + 1]
    key = "points_m" if "tendons through points" in tendon.path.kinds else "radius_m"
    at_disks = np.linalg.norm(tendon.offsets(stops), axis=1)
    radii = robot.disk_radii[tendon.start_disk : tendon.end_disk + 1]
    worst = int(np.argmax(at_disks - radii))
    if at_disks[worst] >= radii[worst]:
        faults.add(
            (*place, key),
            f"a tendon must pass within its disks: below disk_radius_m = {radii[worst]:g} at disk "
            f"{tendon.start_disk + worst}, got {at_disks[worst]:g}",
        )
        return
    s, offsets = _dense_route(tendon, stops)
    distance = np.linalg.norm(offsets, axis=1)
    owner = np.clip(np.searchsorted(robot.segment_ends, s, side="left"), 0, robot.segment_count - 1)
    outside = distance - np.array([segment.disk_radius_m for segment in robot.segments])[owner]
    worst = int(np.argmax(outside))
    if tendon.between_disks == "channel" and outside[worst] >= 0.0:
        faults.add(
            (*place, key),
            f"a tendon must run within the robot: below disk_radius_m = {distance[worst] - outside[worst]:g} at "
            f"s = {s[worst]:g} m, got {distance[worst]:g}",
        )
        return
    thickness = robot.body.tendon_radius_m
    inside = np.maximum(robot.backbone_radius_at(s), thickness) - distance
    worst = int(np.argmax(inside))
    if inside[worst] >= 0.0:
        limit = inside[worst] + distance[worst]
        what = "body.tendon_radius_m" if limit == thickness else "the backbone's radius"
        faults.add(
            (*place, key),
            f"a tendon must run outside of the backbone: above {what} = {limit:g} at s = {s[worst]:g} m, got "
            f"{distance[worst]:g}",
        )


def _dense_route(tendon: Tendon, stops: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns arc lengths, shape (n,), and the offsets there, shape (n, 2), m, close together along a tendon."""
    fraction = np.arange(SAMPLES_PER_GAP) / SAMPLES_PER_GAP
    gaps = np.diff(stops)
    s = np.append((stops[:-1, None] + gaps[:, None] * fraction).reshape(-1), stops[-1])
    if tendon.between_disks == "channel":
        return s, tendon.offsets(s)
    ends = tendon.offsets(stops)
    chords = ends[:-1, None] + (ends[1:] - ends[:-1])[:, None] * fraction[None, :, None]
    return s, np.concatenate([chords.reshape(-1, 2), ends[-1:]])
