"""The unloaded robot as one arc a segment: what tendons alone make of it, with slack and with friction's history."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.calibration.kernels import ArcArrays, solve_sequence_of_arcs
from tdcr_planner.robot import RobotSpec

PRESLIDING = 5e-4
"""Displacement over which friction builds up when a tendon turns round, in lengths of the robot."""
STIFFEST_SPRING_N_M = 1e6
"""Stands for a rigid tendon on a rigid transmission: at 100 N it gives 0.1 mm."""


@dataclass(frozen=True, eq=False)
class ArcShapes:
    """Shapes of a sequence of n states.

    Attributes:
        bends: Bend towards x and y of the segment's frame (1/m) and stretch of each segment, shape (n, 3 m).
        tensions: Tension of each tendon at the base, shape (n, t), N.
        changes: Length of each tendon along the robot less that along the straight one, shape (n, t), m.
        solved: Whether each state has an equilibrium that was found, shape (n,).
        positions: Disk centres, shape (n, d, 3), m, base frame.
        rotations: base_from_disk, shape (n, d, 3, 3).
    """

    bends: FloatArray
    tensions: FloatArray
    changes: FloatArray
    solved: BoolArray
    positions: FloatArray
    rotations: FloatArray


def arc_arrays(robot: RobotSpec) -> ArcArrays:
    """Returns what the kernel needs of a robot with straight tendons and one stiffness a segment."""
    lengths = np.array([segment.length_m for segment in robot.segments])
    gaps = np.array([segment.length_m / segment.disks for segment in robot.segments])
    rods = robot.segment_backbones
    stiffness = np.array([[rod.stiffness_bending_torsion[0], rod.stiffness_shear_extension[2]] for rod in rods])
    straight = np.array([tendon.between_disks == "straight" for tendon in robot.tendons])
    friction = np.array([tendon.friction_coefficient for tendon in robot.tendons])
    sheath = np.array([tendon.sheath_angle for tendon in robot.tendons])
    return ArcArrays(
        lengths=lengths,
        stiffness=stiffness,
        gaps=np.where(straight[:, None], gaps, 0.0),
        ends=robot.tendon_segments,
        offsets=np.ascontiguousarray(robot.tendon_offsets[:, :2]),
        spring=springs_of(robot),
        friction=np.stack([friction * sheath, friction], axis=1),
        presliding=np.array([PRESLIDING * robot.length]),
    )


def springs_of(robot: RobotSpec) -> FloatArray:
    """Returns the stiffness of each tendon with its transmission, shape (t,), N/m; 0 with tension drive."""
    if robot.drive.kind == "tension":
        return np.zeros(robot.tendon_count)
    with np.errstate(divide="ignore"):
        give = 1.0 / robot.drive.transmission_stiffness + robot.rest_path_lengths / robot.tendon_stiffnesses
        return np.asarray(np.minimum(1.0 / give, STIFFEST_SPRING_N_M))


def solve_arcs(
    robot: RobotSpec, displacements: FloatArray, tensions: FloatArray, start: FloatArray | None = None
) -> ArcShapes:
    """Returns the shapes of a sequence of states without loads.

    The strains of a segment are uniform where no outside load acts (docs/theory.md), so each segment is an arc. The
    energy of backbone, tendons and transmission is stationary; a tendon that would push is slack. Between two disks a
    tendon runs along the arc, or along its chord. Friction scales the tension by exp(+-(mu times the angle from the
    drive on)) where the tendon slides (capstan: Euler 1769), and by less where it has not slid since it turned round.

    Args:
        robot: A robot with straight tendons and one stiffness a segment.
        displacements: Shape (n, t), m, in the order in time; zeros with tension drive.
        tensions: Tension of each tendon at displacement 0 in the straight robot, shape (n, t), N: pretension, or what
            the drive sets.
        start: Bends to start from, shape (n, 3 m); None starts each state at the one before.
    """
    count, tendons = displacements.shape
    width = 3 * robot.segment_count
    bends = np.zeros((count, width)) if start is None else start.copy()
    at_base, changes, solved = np.zeros((count, tendons)), np.zeros((count, tendons)), np.zeros(count)
    solve_sequence_of_arcs(
        arc_arrays(robot), displacements, tensions, start is not None, bends, at_base, changes, solved
    )
    positions, rotations = poses_of_arcs(robot, bends)
    return ArcShapes(bends, at_base, changes, solved > 0.5, positions, rotations)


def poses_of_arcs(robot: RobotSpec, bends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns centres, shape (n, d, 3), m, and rotations, (n, d, 3, 3), of all disks in the base frame."""
    count = len(bends)
    positions, rotations = np.zeros((count, robot.disk_count, 3)), np.zeros((count, robot.disk_count, 3, 3))
    rotation, origin = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
    rotations[:, 0] = rotation
    disk = 0
    for index, segment in enumerate(robot.segments):
        x, y, stretch = bends[:, 3 * index : 3 * index + 3].T
        for place in segment.disk_places:
            disk += 1
            step, turn = _arc(x, y, place, 1.0 + stretch)
            positions[:, disk] = origin + np.einsum("nij,nj->ni", rotation, step)
            rotations[:, disk] = rotation @ turn
        rotation, origin = rotations[:, disk], positions[:, disk]
    return positions, rotations


def _arc(x: FloatArray, y: FloatArray, length: float, stretch: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the pose at the end of arcs that bend by x and y per length, 1/m: a plane arc of angle hypot(x, y) l."""
    bend = np.hypot(x, y)
    angle = bend * length
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    across = np.where(small, 0.5 * angle, (1.0 - np.cos(safe)) / safe)
    along = np.where(small, 1.0, np.sin(safe) / safe)
    towards = np.where(small[:, None], 0.0, np.stack([x, y], axis=1) / np.where(bend > 0.0, bend, 1.0)[:, None])
    step = np.zeros((len(x), 3))
    step[:, :2] = (stretch * length * across)[:, None] * towards
    step[:, 2] = stretch * length * along
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.broadcast_to(np.eye(3), (len(x), 3, 3)).copy()
    turn[:, :2, :2] += (cosine - 1.0)[:, None, None] * towards[:, :, None] * towards[:, None, :]
    turn[:, :2, 2] = sine[:, None] * towards
    turn[:, 2, :2] = -sine[:, None] * towards
    turn[:, 2, 2] = cosine
    return step, turn
