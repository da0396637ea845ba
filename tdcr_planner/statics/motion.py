"""Rigid motions of an integration step: the exponential of a twist and the rate of a twist."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.options import INLINED


@njit(**INLINED)
def se3_exp(twist: FloatArray, rotation: FloatArray, position: FloatArray) -> None:
    """Writes the rigid motion exp(a, b) of a twist (angular a, linear b): rotation (3, 3) and position (3,)."""
    ax, ay, az, bx, by, bz = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
    x = ax * ax + ay * ay + az * az
    if x < 0.25:
        # Series of (1 - cos t)/t^2 and (t - sin t)/t^3 in x = t^2: the first term left out is below 1e-17.
        c2 = 0.5 - x * (
            1 / 24 - x * (1 / 720 - x * (1 / 40320 - x * (1 / 3628800 - x * (1 / 479001600 - x / 87178291200))))
        )
        c3 = 1 / 6 - x * (
            1 / 120 - x * (1 / 5040 - x * (1 / 362880 - x * (1 / 39916800 - x * (1 / 6227020800 - x / 1307674368000))))
        )
    else:
        t = np.sqrt(x)
        half = np.sin(0.5 * t)
        c2 = 2.0 * half * half / x
        c3 = (t - np.sin(t)) / (x * t)
    c1 = 1.0 - x * c3
    diagonal = 1.0 - x * c2
    rotation[0, 0] = diagonal + c2 * ax * ax
    rotation[0, 1] = c2 * ax * ay - c1 * az
    rotation[0, 2] = c2 * ax * az + c1 * ay
    rotation[1, 0] = c2 * ax * ay + c1 * az
    rotation[1, 1] = diagonal + c2 * ay * ay
    rotation[1, 2] = c2 * ay * az - c1 * ax
    rotation[2, 0] = c2 * ax * az - c1 * ay
    rotation[2, 1] = c2 * ay * az + c1 * ax
    rotation[2, 2] = diagonal + c2 * az * az
    dot = c3 * (ax * bx + ay * by + az * bz)
    position[0] = c1 * bx + c2 * (ay * bz - az * by) + dot * ax
    position[1] = c1 * by + c2 * (az * bx - ax * bz) + dot * ay
    position[2] = c1 * bz + c2 * (ax * by - ay * bx) + dot * az


@njit(**INLINED)
def dexp_inverse(twist: FloatArray, strain: FloatArray, slope: FloatArray) -> None:
    """Writes the rate of the twist, dexp^-1 of the strain up to the fourth order of a step.

    k = xi + [phi, xi] / 2 + [phi, [phi, xi]] / 12 for g' = g xi^ (Munthe-Kaas 1999; Iserles et al. 2000, sec. 2.4,
    with the sign of a left-invariant equation).
    """
    ax, ay, az, bx, by, bz = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
    vx, vy, vz, ux, uy, uz = strain[0], strain[1], strain[2], strain[3], strain[4], strain[5]
    px, py, pz = ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux
    qx = ay * vz - az * vy + by * uz - bz * uy
    qy = az * vx - ax * vz + bz * ux - bx * uz
    qz = ax * vy - ay * vx + bx * uy - by * ux
    slope[0] = ux + 0.5 * px + (ay * pz - az * py) / 12.0
    slope[1] = uy + 0.5 * py + (az * px - ax * pz) / 12.0
    slope[2] = uz + 0.5 * pz + (ax * py - ay * px) / 12.0
    slope[3] = vx + 0.5 * qx + (ay * qz - az * qy + by * pz - bz * py) / 12.0
    slope[4] = vy + 0.5 * qy + (az * qx - ax * qz + bz * px - bx * pz) / 12.0
    slope[5] = vz + 0.5 * qz + (ax * qy - ay * qx + bx * py - by * px) / 12.0
