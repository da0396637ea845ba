"""What the robot file says of its drive, as the statics need it: arrays for compiled code, and play."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.batch import rest_lengths
from tdcr_planner.statics.drive import DriveArrays
from tdcr_planner.statics.rod import RodArrays


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
