"""Dead loads on the rod: gravity, forces and moments at the tip, along the backbone and at the disks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray, check_array, check_batch
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.cut_loads import LoadBatch


@dataclass(frozen=True)
class RodLoads:
    """The loads of n cases, all dead (fixed in direction) and in the base frame.

    Attributes:
        gravity: Shape (n, 3), m/s^2.
        tip_force: Shape (n, 3), N, at the centre of the last disk.
        tip_moment: Shape (n, 3), N m, at the last disk.
        distributed_force: Shape (n, 3), N per metre of backbone.
        distributed_moment: Shape (n, 3), N m per metre of backbone.
        disk_forces: Shape (n, d, 3), N at each disk centre, or (0, d, 3) for none.
        disk_moments: Shape (n, d, 3), N m at each disk, or (0, d, 3) for none.
    """

    gravity: FloatArray
    tip_force: FloatArray
    tip_moment: FloatArray
    distributed_force: FloatArray
    distributed_moment: FloatArray
    disk_forces: FloatArray
    disk_moments: FloatArray

    @property
    def batch(self) -> LoadBatch:
        """The same for compiled code."""
        none = np.zeros((1, *self.disk_forces.shape[1:]))
        return LoadBatch(
            gravity=self.gravity,
            tip_force=self.tip_force,
            tip_moment=self.tip_moment,
            distributed_force=self.distributed_force,
            distributed_moment=self.distributed_moment,
            disk_forces=self.disk_forces if len(self.disk_forces) else none,
            disk_moments=self.disk_moments if len(self.disk_moments) else none,
        )

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
    *,
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike | None = None,
    tip_moment: ArrayLike | None = None,
    distributed_force: ArrayLike | None = None,
    distributed_moment: ArrayLike | None = None,
    disk_forces: ArrayLike | None = None,
    disk_moments: ArrayLike | None = None,
) -> RodLoads:
    """Returns checked loads for a batch of `count` cases; None is no load.

    Raises:
        InputError: A load has the wrong shape or is not finite.
    """

    def vectors(name: str, value: ArrayLike | None) -> FloatArray:
        return writable(check_batch(name, value, count, 3))

    def at_disks(name: str, value: ArrayLike | None) -> FloatArray:
        if value is None:
            return np.zeros((0, robot.disk_count, 3))
        return writable(check_array(name, value, (count, robot.disk_count, 3)))

    return RodLoads(
        gravity=vectors("gravity", gravity),
        tip_force=vectors("tip_force", tip_force),
        tip_moment=vectors("tip_moment", tip_moment),
        distributed_force=vectors("distributed_force", distributed_force),
        distributed_moment=vectors("distributed_moment", distributed_moment),
        disk_forces=at_disks("disk_forces", disk_forces),
        disk_moments=at_disks("disk_moments", disk_moments),
    )


def writable(array: FloatArray) -> FloatArray:
    """Returns the array, or a copy of a read-only one: for numba that is another type, hence another compilation."""
    return array if array.flags.writeable else array.copy()
