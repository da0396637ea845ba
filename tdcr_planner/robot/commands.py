"""Checks of what a drive is told: tensions and displacements, a column a tendon."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray, check_array
from tdcr_planner.errors import InputError
from tdcr_planner.limits import snap

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec


def check_tensions(robot: RobotSpec, tensions: ArrayLike) -> FloatArray:
    """Returns tensions as shape (n, t), N, or raises InputError; see `RobotSpec.check_tensions`."""
    array = check_array("tensions", tensions, (None, robot.tendon_count))
    limits = robot.max_tensions
    array = snap(array, 0.0, np.where(np.isfinite(limits), limits, 1.0))
    if (array < 0.0).any():
        row, column = (int(i) for i in np.argwhere(array < 0.0)[0])
        raise InputError(
            "tensions",
            "tensions of 0 N or more (tendons only pull)",
            f"{array[row, column]:g} in row {row}, tendon {column}",
        )
    return array


def check_displacements(robot: RobotSpec, displacements: ArrayLike) -> FloatArray:
    """Returns displacements as shape (n, t), m, or raises InputError; see `RobotSpec.check_displacements`."""
    array = check_array("displacements", displacements, (None, robot.tendon_count))
    lengths = robot.rest_path_lengths
    if (array >= lengths).any():
        row, column = (int(i) for i in np.argwhere(array >= lengths)[0])
        raise InputError(
            "displacements",
            f"less than the {lengths[column]:g} m of the tendon inside the robot",
            f"{array[row, column]:g} m in row {row}, tendon {column}; are they in mm?",
        )
    return array
