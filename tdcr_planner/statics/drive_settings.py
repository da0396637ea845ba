"""What the robot file says of its drive, as the statics need it: arrays for compiled code, and play."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import rest_lengths
from tdcr_planner.statics.drive import DriveArrays
from tdcr_planner.statics.friction import Actuation
from tdcr_planner.statics.rod import RodArrays

HISTORIES = {"pull": 0.0, "release": 1e300}
"""What a tendon had before, N, so that it slides towards the drive, or away from it."""


def drive_arrays(robot: RobotSpec, rod: RodArrays) -> DriveArrays:
    """Returns what lies between a robot's drive and its tendons' paths.

    The pretension counts with displacement drive only: with tension drive it is part of the tensions that are set.
    """
    return DriveArrays(
        compliance=1.0 / robot.drive.transmission_stiffness,
        stretch=1.0 / robot.tendon_stiffnesses,
        pretension=rest_tensions(robot),
        rest_lengths=np.asarray(rest_lengths(rod)),
    )


def rest_tensions(robot: RobotSpec) -> FloatArray:
    """Returns the tension of each tendon at zero displacement in the rest shape, shape (t,), N."""
    return np.where(robot.drive.kind == "displacement", robot.drive.pretension, 0.0)


def dead_band(robot: RobotSpec, displacements: FloatArray) -> FloatArray:
    """Returns the displacements behind the play of the drive, which takes its first half each way, shape (n, t), m."""
    half = 0.5 * robot.drive.backlash
    return np.asarray(displacements - np.clip(displacements, -half, half))


def play(robot: RobotSpec, displacements: FloatArray) -> FloatArray:
    """Returns the displacements behind the play of the drive along a motion, shape (k, t), m.

    The tendon follows the drive where the play is taken up, and stands where it is not. The motion starts in the middle
    of the play at zero.
    """
    half = 0.5 * robot.drive.backlash
    followed, place = np.empty_like(displacements), np.zeros(displacements.shape[1])
    for row, drive in enumerate(displacements):
        place = np.clip(place, drive - half, drive + half)
        followed[row] = place
    return followed


def actuation_of(robot: RobotSpec, rod: RodArrays, displaced: bool) -> Actuation:
    """Returns how a robot's tendons are driven and how they rub."""
    return Actuation(
        drive=drive_arrays(robot, rod),
        friction=np.array([tendon.friction_coefficient for tendon in robot.tendons]),
        sheath_angles=np.array([tendon.sheath_angle for tendon in robot.tendons]),
        displaced=np.array([displaced]),
    )


def histories_of(robot: RobotSpec, friction: str | Sequence[str]) -> FloatArray:
    """Returns the history of each tendon that slides as named, shape (t,), N.

    Raises:
        InputError: A name is neither "pull" nor "release", or there is not one a tendon.
    """
    names = [friction] * robot.tendon_count if isinstance(friction, str) else list(friction)
    if len(names) != robot.tendon_count:
        raise InputError("friction", f"one name, or {robot.tendon_count}, one a tendon", f"{len(names)} names")
    for name in names:
        if name not in HISTORIES:
            raise InputError("friction", " or ".join(repr(known) for known in HISTORIES), repr(name))
    return np.array([HISTORIES[name] for name in names])
