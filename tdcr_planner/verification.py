"""Verification: the Cosserat reference on every state of a path, independent of the model that found it."""

from __future__ import annotations

from dataclasses import dataclass

from tdcr_planner.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class VerificationReport:
    """What the reference says of each of the k states of a path.

    Attributes:
        verified: True when every state converged, keeps the clearance and respects the tension limits.
        message: Why it is not verified, naming the first failing state; empty when it is.
        converged: Shape (k,).
        residual: Residual of the reference, shape (k,), N m.
        deviation: Largest distance of a disk centre between the shape model's and the reference's shape, shape (k,), m;
            NaN where no shape model was compared.
        clearance: Smallest distance of the body from a surface under the reference shape, shape (k,), m; negative when
            it touches or is on the wrong side.
        in_limits: Whether tensions (and the robot's other limits) are kept, shape (k,).
        positions: Reference disk centres, shape (k, d, 3), m, world frame.
        rotations: world_from_disk, shape (k, d, 3, 3).
        model_positions: Disk centres by the shape model, shape (k, d, 3), m, world frame; None without one.
    """

    verified: bool
    message: str
    converged: BoolArray
    residual: FloatArray
    deviation: FloatArray
    clearance: FloatArray
    in_limits: BoolArray
    positions: FloatArray
    rotations: FloatArray
    model_positions: FloatArray | None = None

    @property
    def states(self) -> int:
        """Number of states k."""
        return len(self.converged)
