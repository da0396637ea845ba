"""Dead loads on the rod: gravity, forces and moments at the tip, along the backbone and at the disks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray, check_array, check_batch
from tdcr_planner.robot import RobotSpec


@dataclass(frozen=True)
class RodLoads:
    """The loads of n cases, all dead (fixed in direction) and in the base frame.

    Attributes:
        gravity: Shape (n, 3), m/s^2.
        tip_force: Shape (n, 3), N, at the centre of the last disk.
        tip_moment: Shape (n, 3), N m, at the last disk.
        distributed_force: Shape (n, 3), N per metre of backbone.
        disk_forces: Shape (n, d, 3), N at each disk centre, or (0, d, 3) for none.
    """

    gravity: FloatArray
    tip_force: FloatArray
    tip_moment: FloatArray
    distributed_force: FloatArray
    disk_forces: FloatArray

    def point_forces(self, robot: RobotSpec) -> FloatArray:
        """Returns the force on each disk, weight and payload included, shape (n, d, 3), N."""
        masses = robot.disk_masses.copy()
        masses[-1] += robot.tip.mass_kg
        forces = masses[None, :, None] * self.gravity[:, None, :]
        forces[:, -1] += self.tip_force
        if len(self.disk_forces):
            forces = forces + self.disk_forces
        return forces


def check_loads(
    robot: RobotSpec,
    count: int,
    gravity: ArrayLike | None,
    tip_force: ArrayLike | None,
    tip_moment: ArrayLike | None,
    distributed_force: ArrayLike | None,
    disk_forces: ArrayLike | None,
) -> RodLoads:
    """Returns checked loads for a batch of `count` cases; None is no load.

    Raises:
        InputError: A load has the wrong shape or is not finite.
    """
    if disk_forces is None:
        forces = np.zeros((0, robot.disk_count, 3))
    else:
        forces = check_array("disk_forces", disk_forces, (count, robot.disk_count, 3))
    return RodLoads(
        gravity=writable(check_batch("gravity", gravity, count, 3)),
        tip_force=writable(check_batch("tip_force", tip_force, count, 3)),
        tip_moment=writable(check_batch("tip_moment", tip_moment, count, 3)),
        distributed_force=writable(check_batch("distributed_force", distributed_force, count, 3)),
        disk_forces=writable(forces),
    )


def writable(array: FloatArray) -> FloatArray:
    """Returns the array, or a copy of a read-only one: for numba that is another type, hence another compilation."""
    return array if array.flags.writeable else array.copy()
