"""The verification report: what the Cosserat reference says of each state of a path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class FrictionSpread:
    """How far friction moves the body along a path.

    Attributes:
        spread_m: The most that a disk moves against its place without friction, m.
        state: Index of the state at which it does.
        direction: How the tendons slide there, in words.
    """

    spread_m: float
    state: int
    direction: str


@dataclass(frozen=True)
class VerificationReport:
    """What the reference says of each of the k states of a path.

    Attributes:
        verified: True when every state converged to a stable shape, neighbouring states keep the clearance between
            them, and the robot's limits hold.
        message: Why it is not verified, naming the first failing state; empty when it is.
        converged: Shape (k,).
        residual: Residual of the reference, shape (k,), N m.
        deviation: Largest distance of a disk centre between the shape model's and the reference's shape, shape (k,), m;
            NaN where there is no shape to compare.
        clearance: Smallest distance of the body from a surface under the reference shape, shape (k,), m; negative when
            it touches or is on the wrong side, NaN where the reference has no shape.
        in_limits: Whether the limits on tension, tendon displacement and backbone strain are kept, shape (k,).
        positions: Reference disk centres, shape (k, d, 3), m, world frame.
        rotations: world_from_disk, shape (k, d, 3, 3).
        model_positions: Disk centres by the shape model, shape (k, d, 3), m, world frame; None without one.
        cause: "", "statics", "limits", "self_collision", "goal", "jump", "clearance" or "time".
        worst_state: Index of the state that failed, or of the smallest clearance.
        friction: How far friction moves the body; None for a robot without it, or where it was not judged.
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
    cause: str = ""
    worst_state: int = 0
    friction: FrictionSpread | None = None

    def __repr__(self) -> str:
        """Returns the verdict and the worst values; the arrays of a path are too long to read."""
        worst = ", ".join(f"{name}: {value:.3g}" for name, value in self.worst.items())
        return (
            f"VerificationReport(verified={self.verified}, states={self.states}, worst={{{worst}}}, "
            f"message={self.message!r})"
        )

    @property
    def states(self) -> int:
        """Number of states k."""
        return len(self.converged)

    @property
    def worst(self) -> dict[str, float]:
        """Largest residual (N m) and deviation (m) and smallest clearance (m) over the states, NaN where unknown."""
        return {
            "residual_nm": _extreme(self.residual, np.max),
            "deviation_m": _extreme(self.deviation, np.max),
            "clearance_m": _extreme(self.clearance, np.min),
        }


def _extreme(values: FloatArray, choose: Callable[[FloatArray], Any]) -> float:
    known = values[~np.isnan(values)]
    return float(choose(known)) if len(known) else float("nan")
