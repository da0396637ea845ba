"""The tension along each tendon: constant without friction, by Coulomb's law with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.options import OPTIONS
from tdcr_planner.statics.rod import RodArrays


class TendonTension(NamedTuple):
    """Tensions at the stage points of each step, and what they follow from where tendons rub.

    Without friction the arrays after `pulls` are empty.

    Attributes:
        pulls: Tension at each stage point, shape (c, 3, t), N, columns as in `RodArrays.tendons`.
        weights: Derivative of `pulls` by the tendon's tension at the base, shape (c, 3, t).
        base: Tension of each tendon at the base, shape (t,), N.
        earlier: What `pulls` was before, shape (c, 3, t), N.
        angles: Angle that a tendon turns through where the step starts, from there to its middle, and to its end,
            shape (c, 3, t), rad. The first one of a tendon includes its way from the drive to the base.
        friction: Friction coefficient of each tendon, shape (t,).
        tangents: Direction of each tendon at the stage points, base frame, shape (c, 3, t, 3).
    """

    pulls: FloatArray
    weights: FloatArray
    base: FloatArray
    earlier: FloatArray
    angles: FloatArray
    friction: FloatArray
    tangents: FloatArray


@njit(**OPTIONS)
def frictionless_tension(rod: RodArrays) -> TendonTension:
    """Returns room for the tensions of one case without friction."""
    steps, total = rod.tendons.shape
    none = np.empty((0, 3, total))
    return TendonTension(
        np.zeros((steps, 3, total)), none, np.zeros(total), none, none, np.empty(0), np.empty((0, 3, total, 3))
    )


@njit(**OPTIONS)
def fill_tension(rod: RodArrays, tensions: FloatArray, tension: TendonTension) -> None:
    """Writes tensions that are the same all along, shape (t,), N."""
    for i in range(tensions.shape[0]):
        tension.base[i] = tensions[i]
    for c in range(rod.tendons.shape[0]):
        for column in range(rod.tendon_counts[c]):
            value = tensions[rod.tendons[c, column]]
            for point in range(3):
                tension.pulls[c, point, column] = value
