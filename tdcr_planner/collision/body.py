"""The robot's body as solids: a cylinder for each disk, capsules or a sleeve between disks, the shaft."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray, IntArray, check_array, check_positive
from tdcr_planner.compiled import njit
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec, Tendon

# Sine of the angle between two unit vectors below which rounding decides the rest of it.
PARALLEL = 1e-9


class Kind(IntEnum):
    """What a solid stands for; decides where it stands in a state."""

    DISK = 0
    BACKBONE = 1
    TENDON = 2
    SLEEVE = 3
    SHAFT = 4


@dataclass(frozen=True)
class Shaft:
    """The straight shaft that follows the base as it is inserted.

    Attributes:
        radius_m: Its radius.
        start: The point that it comes from, shape (3,), m, world frame; it ends at the base.
    """

    radius_m: float
    start: ArrayLike


class BodyArrays(NamedTuple):
    """The body as arrays for compiled code: a row a solid, tip first; solids of a part stand together.

    Attributes:
        kind: `Kind` of each solid, shape (m,).
        station: The disk k of a solid: disk k, the gap between disk k-1 and disk k, or 0 for the shaft, shape (m,).
        offset: Where a tendon passes the disks, disk frame, shape (m, 3), m; zeros otherwise.
        radius: Radius with the margin, shape (m,), m.
        half: Half length of a disk, or what is added to half the chord of the others, shape (m,), m, with the margin.
        round_ends: True for a capsule, false for a cylinder, shape (m,).
        part_first: First solid of each part, shape (q + 1,), the last entry m.
        part_offset: Largest distance of a part's tendons from the backbone, shape (q,), m.
        part_radius: Largest radius of a gap's solids, or for a disk the radius of the ball about it, shape (q,), m.
        part_arc: Arc length of each part's middle, shape (q,), m; below 0 for the shaft.
        shaft_start: Shape (3,), m, world frame.
    """

    kind: IntArray
    station: IntArray
    offset: FloatArray
    radius: FloatArray
    half: FloatArray
    round_ends: IntArray
    part_first: IntArray
    part_offset: FloatArray
    part_radius: FloatArray
    part_arc: FloatArray
    shaft_start: FloatArray


class RobotBody:
    """The solids that stand for a robot, each grown by its margin.

    Disk k >= 1 is a cylinder about its own z axis. Gap k between disks k-1 and k holds a capsule for the backbone and
    one for each tendon that passes it, or a cylinder of the disks' radius for a sleeve. A gap's margin is the larger of
    its two disks'. Disk 0 is the clamp and has no body; the shaft ends there.

    The backbone's capsule covers the arc between the disks, not only its chord: its radius holds the sagitta of the
    largest curvature that the tendons can cause.

    Attributes:
        robot: The robot.
        margins: Shape (d,), m.
        shaft: The shaft, or None.
        part_names: "disk 20", "gap 20", ..., "disk 1", "gap 1", "shaft": tip first, the order of every answer.
        part_radii: Distance from a part's middle that covers it, margin included, shape (q,), m.
        arrays: The solids for compiled code.
    """

    def __init__(self, robot: RobotSpec, margins: ArrayLike | None = None, shaft: Shaft | None = None) -> None:
        """Builds the solids.

        Args:
            robot: The robot.
            margins: Shape (d,), m, how much each disk and the gap before it grow on all sides; None for none.
            shaft: The shaft behind the base; None to leave it out.
        """
        self.robot = robot
        self.shaft = shaft
        values = np.zeros(robot.disk_count) if margins is None else margins
        self.margins = check_array("margins", values, (robot.disk_count,))
        if (self.margins < 0.0).any():
            disk = int(np.argmax(self.margins < 0.0))
            raise InputError("margins", "0 m or more for every disk", f"{self.margins[disk]:g} for disk {disk}")
        start = np.zeros(3) if shaft is None else check_array("shaft.start", shaft.start, (3,))
        self.part_names: tuple[str, ...] = ()
        self.arrays = self._build(start)

    def with_margins(self, margins: ArrayLike) -> RobotBody:
        """Returns the same body grown by other margins, shape (d,), m."""
        return RobotBody(self.robot, margins, self.shaft)

    def part_margins(self, margins: FloatArray) -> FloatArray:
        """Returns margins of disks, shape (d,), m, as those of parts in the order of `part_names`, shape (q,), m."""
        disks = np.arange(self.robot.disk_count - 1, 0, -1)
        gaps = np.maximum(margins[disks - 1], margins[disks])
        parts = np.stack([margins[disks], gaps], axis=1).reshape(-1)
        return parts if self.shaft is None else np.append(parts, margins[0])

    def _build(self, shaft_start: FloatArray) -> BodyArrays:
        robot, names = self.robot, []
        rows: list[tuple[int, int, tuple[float, float, float], float, float, int]] = []
        first, arcs = [], []
        origin = (0.0, 0.0, 0.0)
        for disk in range(robot.disk_count - 1, 0, -1):
            margin = float(self.margins[disk])
            names.append(f"disk {disk}")
            first.append(len(rows))
            arcs.append(float(robot.arc_lengths[disk]))
            half = 0.5 * float(robot.disk_thicknesses[disk]) + margin
            rows.append((Kind.DISK, disk, origin, float(robot.disk_radii[disk]) + margin, half, 0))
            names.append(f"gap {disk}")
            first.append(len(rows))
            arcs.append(0.5 * float(robot.arc_lengths[disk - 1] + robot.arc_lengths[disk]))
            rows += self._gap_rows(disk)
        if self.shaft is not None:
            names.append("shaft")
            first.append(len(rows))
            arcs.append(-1.0)
            margin = float(self.margins[0])
            rows.append((Kind.SHAFT, 0, origin, check_positive("shaft.radius_m", self.shaft.radius_m) + margin, 0.0, 0))
        self.part_names = tuple(names)
        kind, station, offset, radius, half_length, ends = zip(*rows, strict=True)
        reach = [
            np.hypot(radius[i], half_length[i]) if kind[i] == Kind.DISK else max(radius[i:j])
            for i, j in zip(first, [*first[1:], len(rows)], strict=True)
        ]
        across = np.maximum.reduceat(np.linalg.norm(np.array(offset, dtype=np.float64), axis=1), first)
        return BodyArrays(
            kind=np.array([int(k) for k in kind]),
            station=np.array(station),
            offset=np.array(offset, dtype=np.float64),
            radius=np.array(radius, dtype=np.float64),
            half=np.array(half_length, dtype=np.float64),
            round_ends=np.array(ends),
            part_first=np.array([*first, len(rows)]),
            part_offset=across,
            part_radius=np.array(reach, dtype=np.float64),
            part_arc=np.array(arcs, dtype=np.float64),
            shaft_start=shaft_start,
        )

    def _gap_rows(self, disk: int) -> list[tuple[int, int, tuple[float, float, float], float, float, int]]:
        robot = self.robot
        margin = float(max(self.margins[disk - 1], self.margins[disk]))
        segment = int(robot.disk_segments[disk])
        spacing = float(robot.arc_lengths[disk] - robot.arc_lengths[disk - 1])
        turn = largest_curvature(robot, segment) * spacing
        origin = (0.0, 0.0, 0.0)
        if robot.body.between_disks == "sleeve":
            radius = float(max(robot.disk_radii[disk], robot.disk_radii[disk - 1]))
            # The rims of two disks that lean by half the turn each stand out over the ends of the chord by this much.
            overhang = radius * math.sin(min(turn, math.pi) / 2.0)
            return [(Kind.SLEEVE, disk, origin, radius + margin, overhang + margin, 0)]
        sagitta = spacing * min(turn, math.pi) / 8.0
        backbone = robot.segment_backbones[segment].radius_m + sagitta
        rows = [(int(Kind.BACKBONE), disk, origin, backbone + margin, 0.0, 1)]
        if robot.body.between_disks == "tendons":
            for tendon in robot.tendons:
                if tendon.start_disk < disk <= tendon.end_disk:
                    (x, y), stray = _between(tendon, robot.arc_lengths[disk - 1 : disk + 1])
                    radius = robot.body.tendon_radius_m + stray + margin
                    rows.append((int(Kind.TENDON), disk, (x, y, 0.0), radius, 0.0, 1))
        return rows


def _between(tendon: Tendon, ends: FloatArray) -> tuple[tuple[float, float], float]:
    """Returns a tendon's mean offset between two disks, m, and how far it strays from there at most, m.

    A capsule at the mean offset that is wider by the stray holds the tendon, whether it runs straight or along its
    path: its offsets lie within a circle about their mean.
    """
    path = tendon.straight_path
    if path is not None:
        return (path.radius * math.cos(path.angle), path.radius * math.sin(path.angle)), 0.0
    offsets = tendon.offsets(np.linspace(ends[0], ends[1], 9))
    middle = 0.5 * (offsets.max(axis=0) + offsets.min(axis=0))
    stray = float(np.linalg.norm(offsets - middle, axis=1).max())
    return (float(middle[0]), float(middle[1])), stray


def largest_curvature(robot: RobotSpec, segment: int) -> float:
    """Returns the curvature that the tendons passing a segment cause at full tension, at most, 1/m.

    The moments of all segments' tendons that pass are added as if they pointed the same way, and the rest curvature
    is added to them.
    """
    moment = 0.0
    if any(tendon.straight_path is None for tendon in robot.tendons):
        for tendon in robot.tendons:
            if tendon.segment >= segment:
                offsets = tendon.offsets(np.linspace(tendon.start_arc_length, tendon.end_arc_length, 65))
                moment += tendon.max_tension * float(np.linalg.norm(offsets, axis=1).max())
    else:
        moment = _straight_moment(robot, segment)
    backbone = robot.segment_backbones[segment]
    return moment / backbone.stiffness_bending_torsion[0] + float(np.linalg.norm(backbone.rest_curvature_1_m))


def _straight_moment(robot: RobotSpec, segment: int) -> float:
    """Returns the moment that straight tendons passing a segment cause at full tension, at most, N m."""
    moment = 0.0
    for index in range(segment, robot.segment_count):
        present = robot.tendon_segments == index
        if not present.any():
            continue
        # A bending vector is longest when two tendons, or one, pull fully; all of them fully bounds it simply.
        angles = np.sort(np.mod(robot.tendon_angles[present], 2.0 * np.pi))
        gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
        farthest = max(1.0, float((2.0 * np.cos(gaps / 2.0)).max()), 0.5 * (len(angles) - 1))
        moment += farthest * float(robot.max_tensions[present].max()) * float(robot.tendon_radii[present].max())
    return moment


@njit(cache=True, nogil=True)
def place_solid(body, index, positions, rotations, centre, axis):  # type: ignore[no-untyped-def]
    """Writes a solid's centre, shape (3,), m, and unit axis, shape (3,), for one state; returns its half length, m.

    Args:
        body: `BodyArrays`.
        index: The solid.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).
        centre: Where to write the centre.
        axis: Where to write the axis.

    Returns:
        The half length of the core; below 0 for a shaft that is not out.
    """
    kind, k = body.kind[index], body.station[index]
    if kind == 0:
        for a in range(3):
            centre[a] = positions[k, a]
            axis[a] = rotations[k, a, 2]
        return body.half[index]
    square = 0.0
    along = 0.0
    for a in range(3):
        if kind == 4:
            low, high = body.shaft_start[a], positions[0, a]
        else:
            low, high = positions[k - 1, a], positions[k, a]
            if kind == 2:
                for b in range(2):
                    low += rotations[k - 1, a, b] * body.offset[index, b]
                    high += rotations[k, a, b] * body.offset[index, b]
        centre[a] = 0.5 * (low + high)
        axis[a] = high - low
        square += axis[a] * axis[a]
        along += axis[a] * rotations[k, a, 2]
    length = math.sqrt(square)
    if kind == 4 and along <= 0.0:
        return -1.0
    if length > 0.0:
        for a in range(3):
            axis[a] /= length
    else:
        axis[0], axis[1], axis[2] = 0.0, 0.0, 1.0
    return 0.5 * length + body.half[index]


@njit(cache=True, nogil=True)
def across(axis):  # type: ignore[no-untyped-def]
    """Returns two unit vectors at right angles to a unit axis and to each other (Duff et al. 2017)."""
    sign = math.copysign(1.0, axis[2])
    a = -1.0 / (sign + axis[2])
    b = axis[0] * axis[1] * a
    return (1.0 + sign * axis[0] ** 2 * a, sign * b, -sign * axis[0]), (b, sign + axis[1] ** 2 * a, -axis[1])


@njit(cache=True, nogil=True)
def towards_rim(axis, nx, ny, nz, along):  # type: ignore[no-untyped-def]
    """Returns the unit vector at right angles to a unit axis that leans most towards a unit normal.

    Zero where axis and normal are parallel up to rounding: all of the rim is as near then. The length is that of the
    vector itself: 1 - along^2 loses it to rounding where the two are nearly parallel.

    Args:
        axis: Shape (3,).
        nx: The normal.
        ny: The normal.
        nz: The normal.
        along: Their scalar product.
    """
    x, y, z = nx - along * axis[0], ny - along * axis[1], nz - along * axis[2]
    length = math.sqrt(x * x + y * y + z * z)
    if length < PARALLEL:
        return 0.0, 0.0, 0.0
    return x / length, y / length, z / length


@njit(cache=True, nogil=True)
def place_solids(body, positions, rotations):  # type: ignore[no-untyped-def]
    """Returns centres (m, 3), world_from_solid rotations (m, 3, 3) and half lengths (m,) of all solids for one state.

    The third column of a rotation is the solid's axis; the other two are any that complete it.
    """
    total = len(body.kind)
    centres = np.empty((total, 3))
    frames = np.empty((total, 3, 3))
    halves = np.empty(total)
    axis = np.empty(3)
    for i in range(total):
        halves[i] = place_solid(body, i, positions, rotations, centres[i], axis)
        first, second = across(axis)
        for r in range(3):
            frames[i, r, 0], frames[i, r, 1], frames[i, r, 2] = first[r], second[r], axis[r]
    return centres, frames, halves


@njit(cache=True, nogil=True)
def part_ball(body, part, positions, rotations, centre):  # type: ignore[no-untyped-def]
    """Writes the middle of a part and returns the radius of a ball about it that holds the part, m; -1 for a shaft."""
    first = body.part_first[part]
    k = body.station[first]
    kind = body.kind[first]
    if kind == 0:
        centre[0], centre[1], centre[2] = positions[k, 0], positions[k, 1], positions[k, 2]
        return body.part_radius[part]
    if kind == 4:
        return -1.0
    square, low, high = 0.0, 0.0, 0.0
    for a in range(3):
        edge = positions[k, a] - positions[k - 1, a]
        centre[a] = 0.5 * (positions[k, a] + positions[k - 1, a])
        square += edge * edge
        low += edge * rotations[k - 1, a, 2]
        high += edge * rotations[k, a, 2]
    if kind == 3:
        return math.sqrt((0.5 * math.sqrt(square) + body.half[first]) ** 2 + body.radius[first] ** 2)
    # A hole at offset c of a disk that leans by an angle b from the chord lies within
    # sqrt(chord^2 / 4 + c^2 + chord c sin b) of the chord's middle.
    cosine = max(0.0, min(low, high))
    lean = math.sqrt(max(0.0, square - cosine * cosine))
    c = body.part_offset[part]
    return math.sqrt(0.25 * square + c * c + lean * c) + body.part_radius[part]
