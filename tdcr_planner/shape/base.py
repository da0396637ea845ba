"""What every shape model offers: disk poses from tensions and loads, a domain, and a bound on its error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.robot import RobotSpec


@dataclass(frozen=True)
class DiskPoses:
    """The disks of a batch of shapes, base included.

    Attributes:
        positions: Disk centres, shape (n, d, 3), m, base frame.
        rotations: base_from_disk, shape (n, d, 3, 3).
        solved: Shape (n,); false where the model has no shape to offer (the reference did not converge). Poses of
            such a row must not be used.
    """

    positions: FloatArray
    rotations: FloatArray
    solved: BoolArray


@runtime_checkable
class ShapeModel(Protocol):
    """A map from tensions and loads to disk poses.

    Attributes:
        robot: The robot whose shape it gives.
        name: "learned", "reference" or "constant_curvature".
        error_bound: Bound on the position error of each disk against the reference, shape (d,), m; zeros for the
            reference itself. Constant curvature has no bound and states zeros: it is a baseline, not a safe model.
    """

    robot: RobotSpec
    name: str
    error_bound: FloatArray

    def disk_poses(
        self,
        tensions: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        tip_force: ArrayLike | None = None,
    ) -> DiskPoses:
        """Returns the disk poses of a batch.

        Args:
            tensions: Shape (n, t), N, one column a tendon in the robot file's order.
            gravity: Shape (3,) or (n, 3), m/s^2, base frame; None for none.
            tip_force: Shape (3,) or (n, 3), N, base frame, at the last disk; None for none.

        Raises:
            InputError: Wrong shape, NaN or negative tension.
            DomainError: A row lies outside the model's domain.
        """
        ...

    def in_domain(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> BoolArray:
        """Returns which rows lie inside the model's domain, shape (n,).

        Args:
            tensions: Shape (n, t), N.
            gravity: Shape (n, 3), m/s^2, base frame.
            tip_force: Shape (n, 3), N, base frame.
        """
        ...
