"""The drive: what moves the tendons, by tension or by displacement, and its limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from tdcr_planner.arrays import FloatArray, check_array
from tdcr_planner.errors import InputError
from tdcr_planner.files import FileModel
from tdcr_planner.robot.fields import NotNegativePerTendon, PositivePerTendon, RangePerTendon

DriveKind = Literal["tension", "displacement"]


class DriveTable(FileModel):
    """The [drive] table of a version 2 file; each number stands for all tendons, or there is one a tendon.

    Attributes:
        kind: What the drive sets: "tension" or "displacement".
        transmission_stiffness_n_m: Stiffness of what lies between drive and base; None for a stiff one.
        pretension_n: Tension of every tendon in the straight unloaded robot.
        backlash_m: Play between drive and tendon.
        max_displacement_m: Lowest and highest displacement; None for no limit.
        spool_radius_m: Radius of the spool on which the tendon winds; None where displacement is commanded.
    """

    kind: DriveKind = "tension"
    transmission_stiffness_n_m: PositivePerTendon | None = None
    pretension_n: NotNegativePerTendon = (0.0,)
    backlash_m: NotNegativePerTendon = (0.0,)
    max_displacement_m: RangePerTendon | None = None
    spool_radius_m: PositivePerTendon | None = None

    @model_validator(mode="after")
    def _check_ranges(self) -> DriveTable:
        for low, high in self.max_displacement_m or ():
            if not low <= 0.0 <= high or low == high:
                raise ValueError(
                    f"max_displacement_m must be [lowest, highest] and hold 0, where the robot is straight, "
                    f"got [{low:g}, {high:g}]"
                )
        return self


PER_TENDON = ("transmission_stiffness_n_m", "pretension_n", "backlash_m", "max_displacement_m", "spool_radius_m")
"""Keys of [drive] that hold one value or one a tendon."""


@dataclass(frozen=True, eq=False)
class Drive:
    """The drive as mechanics needs it; the same for files of both versions, t tendons.

    Attributes:
        kind: "tension" or "displacement".
        transmission_stiffness: Shape (t,), N/m; infinite for a stiff transmission.
        pretension: Tension in the straight unloaded robot, shape (t,), N.
        backlash: Shape (t,), m.
        max_displacement: Lowest and highest displacement, each of shape (t,), m; infinite where there is no limit.
        spool_radius: Shape (t,), m; None where the file states none.
    """

    kind: DriveKind
    transmission_stiffness: FloatArray
    pretension: FloatArray
    backlash: FloatArray
    max_displacement: tuple[FloatArray, FloatArray]
    spool_radius: FloatArray | None = None

    def spool_angles(self, displacements: ArrayLike) -> FloatArray:
        """Returns the angles of the spools that pull displacements, shape (n, t), rad, of displacements (n, t), m.

        Raises:
            InputError: The robot's file states no spool radius, or the shape is wrong.
        """
        if self.spool_radius is None:
            raise InputError("drive", "a robot whose [drive] states spool_radius_m", "one without")
        return np.asarray(check_array("displacements", displacements, (None, len(self.backlash))) / self.spool_radius)


def drive_of_table(table: DriveTable, count: int) -> Drive:
    """Returns the drive that a [drive] table describes, for a number of tendons."""

    def spread(values: tuple[float, ...] | None, default: float) -> FloatArray:
        array = np.array([default] if values is None else values, dtype=np.float64)
        return np.array(np.broadcast_to(array, count))

    ranges = np.array(table.max_displacement_m or ((-np.inf, np.inf),))
    low, high = np.broadcast_to(ranges, (count, 2)).T.copy()
    return Drive(
        kind=table.kind,
        transmission_stiffness=spread(table.transmission_stiffness_n_m, np.inf),
        pretension=spread(table.pretension_n, 0.0),
        backlash=spread(table.backlash_m, 0.0),
        max_displacement=(low, high),
        spool_radius=None if table.spool_radius_m is None else spread(table.spool_radius_m, 0.0),
    )
