"""Compiled kernels of the rod: the strain of a cross-section, a sweep from base to tip, the solution of a case.

Strain is (v, u), six numbers in the body frame; load is (n, m), the force and moment across the cut in the body frame.
docs/theory.md derives every equation used here. Arrays are copied number by number: numba compiles the assignment of
whole arrays to code that checks and words mismatches of their shapes, which takes longer to compile than the kernels.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.rod import RodArrays

OPTIONS: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "arcp", "nsz"},
}

STRAIN_TOLERANCE = 1e-12
STRAIN_ITERATIONS = 60

CONVERGED, UNSTABLE, LIMIT_POINT, NOT_CONVERGED = 0, 1, 2, 3

NEWTON_LIMIT = 12
SWEEP_LIMIT = 2000
CONTRACTION = 0.5
CAUTIOUS_CONTRACTION = 0.25
# A branch that follows on loses its derivative at a limit point: det dM(l)/dM(0), 1 for a rod without loads, is zero.
LIMIT_DETERMINANT = 0.1
SMALLEST_LOAD_STEP = 2e-5
LONG_LOAD_STEP = 1.0 / 16.0
LARGEST_MOMENT = 1e6


@njit(**OPTIONS)
def strain_hessian(
    strain: FloatArray, stiffness: FloatArray, offsets: FloatArray, tau: FloatArray, first: int, inverse: FloatArray
) -> None:
    """Writes the inverse of the 6 x 6 Hessian of the cross-section energy at a strain into `inverse`."""
    vx, vy, vz, ux, uy, uz = strain[0], strain[1], strain[2], strain[3], strain[4], strain[5]
    a00, a11, a22 = stiffness[0], stiffness[1], stiffness[2]
    a01 = a02 = a12 = 0.0
    d00, d11, d22 = stiffness[3], stiffness[4], stiffness[5]
    d01 = d02 = d12 = 0.0
    b00 = b01 = b02 = b10 = b11 = b12 = b20 = b21 = b22 = 0.0
    for i in range(first, tau.shape[0]):
        tension = tau[i]
        if tension == 0.0:
            continue
        rx, ry = offsets[i, 0], offsets[i, 1]
        wx, wy, wz = vx - uz * ry, vy + uz * rx, vz + ux * ry - uy * rx
        scale = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
        tx, ty, tz = wx * scale, wy * scale, wz * scale
        c = tension * scale
        p00, p11, p22 = c * (1.0 - tx * tx), c * (1.0 - ty * ty), c * (1.0 - tz * tz)
        p01, p02, p12 = -c * tx * ty, -c * tx * tz, -c * ty * tz
        a00 += p00
        a11 += p11
        a22 += p22
        a01 += p01
        a02 += p02
        a12 += p12
        q0, q1, q2 = rx * p01 - ry * p00, rx * p11 - ry * p01, rx * p12 - ry * p02
        b00 += ry * p02
        b10 += ry * p12
        b20 += ry * p22
        b01 -= rx * p02
        b11 -= rx * p12
        b21 -= rx * p22
        b02 += q0
        b12 += q1
        b22 += q2
        d00 += ry * ry * p22
        d01 -= rx * ry * p22
        d11 += rx * rx * p22
        d02 += ry * q2
        d12 -= rx * q2
        d22 += rx * q1 - ry * q0
    # Schur complement on the stiff (v) block.
    g00, g01, g02 = a11 * a22 - a12 * a12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
    g11, g12, g22 = a00 * a22 - a02 * a02, a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
    det = 1.0 / (a00 * g00 + a01 * g01 + a02 * g02)
    g00, g01, g02, g11, g12, g22 = g00 * det, g01 * det, g02 * det, g11 * det, g12 * det, g22 * det
    x00, x01, x02 = (
        g00 * b00 + g01 * b10 + g02 * b20,
        g00 * b01 + g01 * b11 + g02 * b21,
        g00 * b02 + g01 * b12 + g02 * b22,
    )
    x10, x11, x12 = (
        g01 * b00 + g11 * b10 + g12 * b20,
        g01 * b01 + g11 * b11 + g12 * b21,
        g01 * b02 + g11 * b12 + g12 * b22,
    )
    x20, x21, x22 = (
        g02 * b00 + g12 * b10 + g22 * b20,
        g02 * b01 + g12 * b11 + g22 * b21,
        g02 * b02 + g12 * b12 + g22 * b22,
    )
    d00 -= b00 * x00 + b10 * x10 + b20 * x20
    d01 -= b00 * x01 + b10 * x11 + b20 * x21
    d02 -= b00 * x02 + b10 * x12 + b20 * x22
    d11 -= b01 * x01 + b11 * x11 + b21 * x21
    d12 -= b01 * x02 + b11 * x12 + b21 * x22
    d22 -= b02 * x02 + b12 * x12 + b22 * x22
    s00, s01, s02 = d11 * d22 - d12 * d12, d02 * d12 - d01 * d22, d01 * d12 - d02 * d11
    s11, s12, s22 = d00 * d22 - d02 * d02, d01 * d02 - d00 * d12, d00 * d11 - d01 * d01
    det = 1.0 / (d00 * s00 + d01 * s01 + d02 * s02)
    s00, s01, s02, s11, s12, s22 = s00 * det, s01 * det, s02 * det, s11 * det, s12 * det, s22 * det
    y00, y01, y02 = (
        x00 * s00 + x01 * s01 + x02 * s02,
        x00 * s01 + x01 * s11 + x02 * s12,
        x00 * s02 + x01 * s12 + x02 * s22,
    )
    y10, y11, y12 = (
        x10 * s00 + x11 * s01 + x12 * s02,
        x10 * s01 + x11 * s11 + x12 * s12,
        x10 * s02 + x11 * s12 + x12 * s22,
    )
    y20, y21, y22 = (
        x20 * s00 + x21 * s01 + x22 * s02,
        x20 * s01 + x21 * s11 + x22 * s12,
        x20 * s02 + x21 * s12 + x22 * s22,
    )
    inverse[0, 0] = g00 + y00 * x00 + y01 * x01 + y02 * x02
    inverse[0, 1] = inverse[1, 0] = g01 + y00 * x10 + y01 * x11 + y02 * x12
    inverse[0, 2] = inverse[2, 0] = g02 + y00 * x20 + y01 * x21 + y02 * x22
    inverse[1, 1] = g11 + y10 * x10 + y11 * x11 + y12 * x12
    inverse[1, 2] = inverse[2, 1] = g12 + y10 * x20 + y11 * x21 + y12 * x22
    inverse[2, 2] = g22 + y20 * x20 + y21 * x21 + y22 * x22
    inverse[0, 3] = inverse[3, 0] = -y00
    inverse[0, 4] = inverse[4, 0] = -y01
    inverse[0, 5] = inverse[5, 0] = -y02
    inverse[1, 3] = inverse[3, 1] = -y10
    inverse[1, 4] = inverse[4, 1] = -y11
    inverse[1, 5] = inverse[5, 1] = -y12
    inverse[2, 3] = inverse[3, 2] = -y20
    inverse[2, 4] = inverse[4, 2] = -y21
    inverse[2, 5] = inverse[5, 2] = -y22
    inverse[3, 3] = s00
    inverse[3, 4] = inverse[4, 3] = s01
    inverse[3, 5] = inverse[5, 3] = s02
    inverse[4, 4] = s11
    inverse[4, 5] = inverse[5, 4] = s12
    inverse[5, 5] = s22


@njit(**OPTIONS)
def solve_strain(
    load: FloatArray,
    strain: FloatArray,
    stiffness: FloatArray,
    rest: FloatArray,
    offsets: FloatArray,
    tau: FloatArray,
    first: int,
    inverse: FloatArray,
    refresh: bool,
    length: float,
) -> bool:
    """Solves the six equations of a cross-section for its strain.

    Newton's method whose matrix is kept from a neighbouring cross-section (`refresh` false) while it contracts well,
    and computed afresh when asked or when it does not. The energy behind the equations is strictly convex, so there is
    one solution to go to. A load that would shorten a tendon's path to nothing has none, and is reported.

    Returns:
        Whether it converged; `strain` holds the result, `inverse` the matrix last used.
    """
    vx, vy, vz, ux, uy, uz = strain[0], strain[1], strain[2], strain[3], strain[4], strain[5]
    before = np.inf
    for _ in range(STRAIN_ITERATIONS):
        if refresh:
            strain[0], strain[1], strain[2], strain[3], strain[4], strain[5] = vx, vy, vz, ux, uy, uz
            strain_hessian(strain, stiffness, offsets, tau, first, inverse)
            refresh = False
        f0 = stiffness[0] * (vx - rest[0]) - load[0]
        f1 = stiffness[1] * (vy - rest[1]) - load[1]
        f2 = stiffness[2] * (vz - rest[2]) - load[2]
        f3 = stiffness[3] * (ux - rest[3]) - load[3]
        f4 = stiffness[4] * (uy - rest[4]) - load[4]
        f5 = stiffness[5] * (uz - rest[5]) - load[5]
        for i in range(first, tau.shape[0]):
            tension = tau[i]
            if tension == 0.0:
                continue
            rx, ry = offsets[i, 0], offsets[i, 1]
            wx, wy, wz = vx - uz * ry, vy + uz * rx, vz + ux * ry - uy * rx
            scale = tension / np.sqrt(wx * wx + wy * wy + wz * wz)
            wx *= scale
            wy *= scale
            wz *= scale
            f0 += wx
            f1 += wy
            f2 += wz
            f3 += ry * wz
            f4 -= rx * wz
            f5 += rx * wy - ry * wx
        d0 = (
            inverse[0, 0] * f0
            + inverse[0, 1] * f1
            + inverse[0, 2] * f2
            + inverse[0, 3] * f3
            + inverse[0, 4] * f4
            + inverse[0, 5] * f5
        )
        d1 = (
            inverse[1, 0] * f0
            + inverse[1, 1] * f1
            + inverse[1, 2] * f2
            + inverse[1, 3] * f3
            + inverse[1, 4] * f4
            + inverse[1, 5] * f5
        )
        d2 = (
            inverse[2, 0] * f0
            + inverse[2, 1] * f1
            + inverse[2, 2] * f2
            + inverse[2, 3] * f3
            + inverse[2, 4] * f4
            + inverse[2, 5] * f5
        )
        d3 = (
            inverse[3, 0] * f0
            + inverse[3, 1] * f1
            + inverse[3, 2] * f2
            + inverse[3, 3] * f3
            + inverse[3, 4] * f4
            + inverse[3, 5] * f5
        )
        d4 = (
            inverse[4, 0] * f0
            + inverse[4, 1] * f1
            + inverse[4, 2] * f2
            + inverse[4, 3] * f3
            + inverse[4, 4] * f4
            + inverse[4, 5] * f5
        )
        d5 = (
            inverse[5, 0] * f0
            + inverse[5, 1] * f1
            + inverse[5, 2] * f2
            + inverse[5, 3] * f3
            + inverse[5, 4] * f4
            + inverse[5, 5] * f5
        )
        size = abs(d0) + abs(d1) + abs(d2) + length * (abs(d3) + abs(d4) + abs(d5))
        if not size < 1e12:
            return False
        vx -= d0
        vy -= d1
        vz -= d2
        ux -= d3
        uy -= d4
        uz -= d5
        rate = size / before
        if size < 1e-11 or (before < np.inf and rate < 0.1 and size * rate < STRAIN_TOLERANCE):
            strain[0], strain[1], strain[2], strain[3], strain[4], strain[5] = vx, vy, vz, ux, uy, uz
            return True
        if rate > 0.1:
            refresh = True
        before = size
    return False


@njit(**OPTIONS)
def exponential(twist: FloatArray, rotation: FloatArray, position: FloatArray) -> None:
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


@njit(**OPTIONS)
def pulled_back(twist: FloatArray, strain: FloatArray, slope: FloatArray) -> None:
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


@njit(**OPTIONS)
def load_at(
    rotation: FloatArray,
    position: FloatArray,
    weighted: FloatArray,
    sigma: float,
    force: FloatArray,
    weight: FloatArray,
    moment: FloatArray,
    load: FloatArray,
) -> None:
    """Writes the body-frame load at a point of a step from the load at its start, all in the start's frame.

    n = Q^T (n0 - w sigma), m = Q^T (m0 - d x n0 + q x w), q the integral of sigma p' over the step so far.
    """
    dx, dy, dz = position[0], position[1], position[2]
    nx, ny, nz = force[0] - sigma * weight[0], force[1] - sigma * weight[1], force[2] - sigma * weight[2]
    mx = moment[0] - dy * force[2] + dz * force[1] + weighted[1] * weight[2] - weighted[2] * weight[1]
    my = moment[1] - dz * force[0] + dx * force[2] + weighted[2] * weight[0] - weighted[0] * weight[2]
    mz = moment[2] - dx * force[1] + dy * force[0] + weighted[0] * weight[1] - weighted[1] * weight[0]
    for j in range(3):
        load[j] = rotation[0, j] * nx + rotation[1, j] * ny + rotation[2, j] * nz
        load[3 + j] = rotation[0, j] * mx + rotation[1, j] * my + rotation[2, j] * mz


@njit(**OPTIONS)
def predict(load: FloatArray, previous: FloatArray, inverse: FloatArray, strain: FloatArray) -> None:
    """Moves the strain along the linearised equations from the previous load to this one."""
    for i in range(6):
        change = 0.0
        for j in range(6):
            change += inverse[i, j] * (load[j] - previous[j])
        strain[i] += change
    for j in range(6):
        previous[j] = load[j]


@njit(**OPTIONS)
def rate_of_variation(
    load: FloatArray, strain: FloatArray, inverse: FloatArray, angle: FloatArray, moment: FloatArray, rate: FloatArray
) -> None:
    """Writes the arc-length derivative of variations of rotation and moment, body components, a column each.

    With (dv, du) = H^-1 (n x phi, mu + m x phi): phi' = du, mu' = n x (phi x v + dv); both derivatives are those of
    the world-frame vectors, expressed in the body frame.

    Args:
        load: Shape (6,).
        strain: Shape (6,).
        inverse: H^-1, shape (6, 6).
        angle: phi, variation of the rotation, shape (3, c).
        moment: mu, variation of the moment across the cut, shape (3, c).
        rate: Shape (6, c), phi' over mu'; written.
    """
    nx, ny, nz, mx, my, mz = load[0], load[1], load[2], load[3], load[4], load[5]
    vx, vy, vz = strain[0], strain[1], strain[2]
    for c in range(angle.shape[1]):
        px, py, pz = angle[0, c], angle[1, c], angle[2, c]
        f0, f1, f2 = ny * pz - nz * py, nz * px - nx * pz, nx * py - ny * px
        f3 = moment[0, c] + my * pz - mz * py
        f4 = moment[1, c] + mz * px - mx * pz
        f5 = moment[2, c] + mx * py - my * px
        for i in range(3):
            k = 3 + i
            rate[i, c] = (
                inverse[k, 0] * f0
                + inverse[k, 1] * f1
                + inverse[k, 2] * f2
                + inverse[k, 3] * f3
                + inverse[k, 4] * f4
                + inverse[k, 5] * f5
            )
        ex = (
            inverse[0, 0] * f0
            + inverse[0, 1] * f1
            + inverse[0, 2] * f2
            + inverse[0, 3] * f3
            + inverse[0, 4] * f4
            + inverse[0, 5] * f5
            + py * vz
            - pz * vy
        )
        ey = (
            inverse[1, 0] * f0
            + inverse[1, 1] * f1
            + inverse[1, 2] * f2
            + inverse[1, 3] * f3
            + inverse[1, 4] * f4
            + inverse[1, 5] * f5
            + pz * vx
            - px * vz
        )
        ez = (
            inverse[2, 0] * f0
            + inverse[2, 1] * f1
            + inverse[2, 2] * f2
            + inverse[2, 3] * f3
            + inverse[2, 4] * f4
            + inverse[2, 5] * f5
            + px * vy
            - py * vx
        )
        rate[3, c] = ny * ez - nz * ey
        rate[4, c] = nz * ex - nx * ez
        rate[5, c] = nx * ey - ny * ex


@njit(**OPTIONS)
def positive_spectrum(numerator: FloatArray, denominator: FloatArray) -> bool:
    """Returns whether every eigenvalue of numerator @ denominator^-1 (3 x 3) has a positive real part.

    Routh-Hurwitz on the characteristic polynomial; false where the denominator is singular.
    """
    inverse = np.empty((3, 3))
    det = invert3(denominator, inverse)
    if det == 0.0:
        return False
    q = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            q[i, j] = (
                numerator[i, 0] * inverse[0, j] + numerator[i, 1] * inverse[1, j] + numerator[i, 2] * inverse[2, j]
            )
    first = q[0, 0] + q[1, 1] + q[2, 2]
    second = (
        q[0, 0] * q[1, 1]
        - q[0, 1] * q[1, 0]
        + q[0, 0] * q[2, 2]
        - q[0, 2] * q[2, 0]
        + q[1, 1] * q[2, 2]
        - q[1, 2] * q[2, 1]
    )
    third = (
        q[0, 0] * (q[1, 1] * q[2, 2] - q[1, 2] * q[2, 1])
        - q[0, 1] * (q[1, 0] * q[2, 2] - q[1, 2] * q[2, 0])
        + q[0, 2] * (q[1, 0] * q[2, 1] - q[1, 1] * q[2, 0])
    )
    return first > 0.0 and third > 0.0 and first * second > third


@njit(**OPTIONS)
def invert3(matrix: FloatArray, inverse: FloatArray) -> float:
    """Writes the inverse of a 3 x 3 matrix by its adjugate and returns the determinant (0 leaves it unwritten)."""
    c00 = matrix[1, 1] * matrix[2, 2] - matrix[1, 2] * matrix[2, 1]
    c01 = matrix[1, 2] * matrix[2, 0] - matrix[1, 0] * matrix[2, 2]
    c02 = matrix[1, 0] * matrix[2, 1] - matrix[1, 1] * matrix[2, 0]
    det = matrix[0, 0] * c00 + matrix[0, 1] * c01 + matrix[0, 2] * c02
    if det == 0.0 or not np.isfinite(det):
        return 0.0
    s = 1.0 / det
    inverse[0, 0] = c00 * s
    inverse[1, 0] = c01 * s
    inverse[2, 0] = c02 * s
    inverse[0, 1] = (matrix[0, 2] * matrix[2, 1] - matrix[0, 1] * matrix[2, 2]) * s
    inverse[1, 1] = (matrix[0, 0] * matrix[2, 2] - matrix[0, 2] * matrix[2, 0]) * s
    inverse[2, 1] = (matrix[0, 1] * matrix[2, 0] - matrix[0, 0] * matrix[2, 1]) * s
    inverse[0, 2] = (matrix[0, 1] * matrix[1, 2] - matrix[0, 2] * matrix[1, 1]) * s
    inverse[1, 2] = (matrix[0, 2] * matrix[1, 0] - matrix[0, 0] * matrix[1, 2]) * s
    inverse[2, 2] = (matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]) * s
    return det


@njit(**OPTIONS)
def sweep(
    rod: RodArrays,
    tau: FloatArray,
    forces: FloatArray,
    weights: FloatArray,
    base_moment: FloatArray,
    with_variations: bool,
    positions: FloatArray,
    rotations: FloatArray,
    end_moment: FloatArray,
    angle: FloatArray,
    moment: FloatArray,
    record: FloatArray,
) -> tuple[bool, bool]:
    """Integrates the rod from base to tip for a given moment at the base.

    Runge-Kutta-Munthe-Kaas of fourth order on SE(3), in the frame of each step's start.

    Args:
        rod: RodArrays.
        tau: Tensions, shape (t,), N.
        forces: Force across the cut just behind the start of each step, shape (c, 3), N.
        weights: Dead load per length in each segment, shape (k, 3), N/m.
        base_moment: M(0), shape (3,), N m.
        with_variations: Whether to integrate the variations with M(0) as well.
        positions: Disk centres, shape (d, 3), m; written.
        rotations: Disk rotations, shape (d, 3, 3); written.
        end_moment: M(l), shape (3,), N m; written.
        angle: d theta(l) / d M(0), shape (3, 3); written.
        moment: d M(l) / d M(0), shape (3, 3); written.
        record: Load (6), strain (6) and rotation (9) at each Runge-Kutta stage, shape (c, 4, 21); written. Shape
            (0, 4, 21) keeps no record.

    Returns:
        Whether every cross-section was solved, and whether no conjugate point was met (true without variations).
    """
    load, previous, strain = np.empty(6), np.empty(6), np.empty(6)
    inverse = np.empty((6, 6))
    slope, total, twist = np.empty(6), np.empty(6), np.empty(6)
    Q, d, weighted, weighted_sum = np.empty((3, 3)), np.empty(3), np.zeros(3), np.zeros(3)
    R, Rm = np.eye(3), np.empty((3, 3))
    p, M = np.zeros(3), base_moment.copy()
    n0, w0, m0 = np.empty(3), np.zeros(3), np.empty(3)
    phi, mu, rate = np.empty((3, 3)), np.empty((3, 3)), np.empty((6, 3))
    before = np.empty((3, 3))
    stable = True
    if with_variations:
        for i in range(3):
            for j in range(3):
                angle[i, j] = 0.0
                moment[i, j] = 1.0 if i == j else 0.0
    for i in range(3):
        positions[0, i] = 0.0
        for j in range(3):
            rotations[0, i, j] = R[i, j]
    segment = -1
    length = rod.length[0]
    for c in range(rod.step_lengths.shape[0]):
        h = rod.step_lengths[c]
        enters = rod.step_segments[c] != segment
        segment = rod.step_segments[c]
        stiffness, rest, first = rod.stiffness[segment], rod.rest_strain[segment], rod.first_tendon[segment]
        loaded = False
        for j in range(3):
            n0[j] = R[0, j] * forces[c, 0] + R[1, j] * forces[c, 1] + R[2, j] * forces[c, 2]
            m0[j] = R[0, j] * M[0] + R[1, j] * M[1] + R[2, j] * M[2]
            w0[j] = R[0, j] * weights[segment, 0] + R[1, j] * weights[segment, 1] + R[2, j] * weights[segment, 2]
            load[j] = n0[j]
            load[3 + j] = m0[j]
            weighted_sum[j] = 0.0
            weighted[j] = 0.0
            loaded = loaded or weights[segment, j] != 0.0
        for stage in range(4):
            sigma = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            if stage > 0:
                for j in range(6):
                    twist[j] = sigma * slope[j]
                exponential(twist, Q, d)
                load_at(Q, d, weighted, sigma, n0, w0, m0, load)
            if stage == 0 and enters:
                if c == 0:
                    for j in range(6):
                        strain[j] = rest[j]
                for j in range(6):
                    previous[j] = load[j]
            else:
                predict(load, previous, inverse, strain)
            fresh = stage == 1 or (stage == 0 and enters)
            if not solve_strain(load, strain, stiffness, rest, rod.offsets, tau, first, inverse, fresh, length):
                return False, False
            if record.shape[0] > 0:
                for j in range(6):
                    record[c, stage, j] = load[j]
                    record[c, stage, 6 + j] = strain[j]
                for i in range(3):
                    for j in range(3):
                        record[c, stage, 12 + 3 * i + j] = (
                            R[i, j] if stage == 0 else R[i, 0] * Q[0, j] + R[i, 1] * Q[1, j] + R[i, 2] * Q[2, j]
                        )
            if stage == 0:
                for j in range(3):
                    slope[j] = strain[3 + j]
                    slope[3 + j] = strain[j]
                for j in range(6):
                    total[j] = slope[j] / 6.0
            else:
                pulled_back(twist, strain, slope)
                share = 1.0 / 6.0 if stage == 3 else 1.0 / 3.0
                for j in range(6):
                    total[j] += share * slope[j]
                if loaded:
                    # q' = sigma Q v at this stage; q at the next one.
                    reach = h if stage == 2 else 0.5 * h
                    for j in range(3):
                        q = sigma * (Q[j, 0] * strain[0] + Q[j, 1] * strain[1] + Q[j, 2] * strain[2])
                        weighted_sum[j] += share * h * q
                        weighted[j] = reach * q
            if stage == 2 and with_variations:
                for i in range(3):
                    for j in range(3):
                        Rm[i, j] = R[i, 0] * Q[0, j] + R[i, 1] * Q[1, j] + R[i, 2] * Q[2, j]
                for i in range(3):
                    for j in range(3):
                        before[i, j] = angle[i, j]
                        phi[i, j] = Rm[0, i] * angle[0, j] + Rm[1, i] * angle[1, j] + Rm[2, i] * angle[2, j]
                        mu[i, j] = Rm[0, i] * moment[0, j] + Rm[1, i] * moment[1, j] + Rm[2, i] * moment[2, j]
                rate_of_variation(load, strain, inverse, phi, mu, rate)
                for i in range(3):
                    for j in range(3):
                        phi[i, j] += 0.5 * h * rate[i, j]
                        mu[i, j] += 0.5 * h * rate[3 + i, j]
                rate_of_variation(load, strain, inverse, phi, mu, rate)
                for i in range(3):
                    for j in range(3):
                        angle[i, j] += h * (Rm[i, 0] * rate[0, j] + Rm[i, 1] * rate[1, j] + Rm[i, 2] * rate[2, j])
                        moment[i, j] += h * (Rm[i, 0] * rate[3, j] + Rm[i, 1] * rate[4, j] + Rm[i, 2] * rate[5, j])
                if c > 0 and stable:
                    stable = positive_spectrum(angle, before)
        for j in range(6):
            twist[j] = h * total[j]
        exponential(twist, Q, d)
        # M(end) = M - (p(end) - p) x N + q x w, in the frame of the step's start.
        load[0] = m0[0] - d[1] * n0[2] + d[2] * n0[1] + weighted_sum[1] * w0[2] - weighted_sum[2] * w0[1]
        load[1] = m0[1] - d[2] * n0[0] + d[0] * n0[2] + weighted_sum[2] * w0[0] - weighted_sum[0] * w0[2]
        load[2] = m0[2] - d[0] * n0[1] + d[1] * n0[0] + weighted_sum[0] * w0[1] - weighted_sum[1] * w0[0]
        for i in range(3):
            p[i] += R[i, 0] * d[0] + R[i, 1] * d[1] + R[i, 2] * d[2]
            M[i] = R[i, 0] * load[0] + R[i, 1] * load[1] + R[i, 2] * load[2]
        for i in range(3):
            x, y, z = R[i, 0], R[i, 1], R[i, 2]
            for j in range(3):
                R[i, j] = x * Q[0, j] + y * Q[1, j] + z * Q[2, j]
        disk = rod.step_disks[c]
        if disk >= 0:
            for i in range(3):
                positions[disk, i] = p[i]
                for j in range(3):
                    rotations[disk, i, j] = R[i, j]
    for i in range(3):
        end_moment[i] = M[i]
    if with_variations and stable:
        stable = positive_spectrum(moment, angle)
    return np.isfinite(M[0] + M[1] + M[2]), stable


@njit(**OPTIONS)
def variation_rate(
    rod: RodArrays,
    stage: FloatArray,
    inverse: FloatArray,
    first: int,
    profiles: FloatArray,
    columns: FloatArray,
    rate: FloatArray,
    rotation: FloatArray,
) -> None:
    """Writes the derivative of theta, delta M and delta p (base frame) at one stage, a column for each parameter.

    Args:
        rod: RodArrays.
        stage: Load, strain and rotation of the stage, shape (21,).
        inverse: H^-1 at the stage, shape (6, 6).
        first: First tendon still present.
        profiles: Force across the cut for a unit of each family of forces, shape (families,).
        columns: theta, delta M, delta p over M(0), tensions and forces, shape (9, 3 + t + 3 families).
        rate: Their derivatives, shape (9, 3 + t + 3 families); written.
        rotation: Work space, shape (3, 3).
    """
    nx, ny, nz, mx, my, mz = stage[0], stage[1], stage[2], stage[3], stage[4], stage[5]
    vx, vy, vz, ux, uy, uz = stage[6], stage[7], stage[8], stage[9], stage[10], stage[11]
    for i in range(3):
        for j in range(3):
            rotation[i, j] = stage[12 + 3 * i + j]
    tendons = rod.offsets.shape[0]
    f, e, g = np.empty(6), np.empty(6), np.empty(3)
    for c in range(columns.shape[1]):
        px = rotation[0, 0] * columns[0, c] + rotation[1, 0] * columns[1, c] + rotation[2, 0] * columns[2, c]
        py = rotation[0, 1] * columns[0, c] + rotation[1, 1] * columns[1, c] + rotation[2, 1] * columns[2, c]
        pz = rotation[0, 2] * columns[0, c] + rotation[1, 2] * columns[1, c] + rotation[2, 2] * columns[2, c]
        f[0], f[1], f[2] = ny * pz - nz * py, nz * px - nx * pz, nx * py - ny * px
        f[3] = my * pz - mz * py
        f[4] = mz * px - mx * pz
        f[5] = mx * py - my * px
        for j in range(3):
            f[3 + j] += rotation[0, j] * columns[3, c] + rotation[1, j] * columns[4, c] + rotation[2, j] * columns[5, c]
            g[j] = 0.0
        if 3 <= c < 3 + tendons:
            i = c - 3
            if i >= first:
                rx, ry = rod.offsets[i, 0], rod.offsets[i, 1]
                wx, wy, wz = vx - uz * ry, vy + uz * rx, vz + ux * ry - uy * rx
                scale = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
                wx, wy, wz = wx * scale, wy * scale, wz * scale
                f[0] -= wx
                f[1] -= wy
                f[2] -= wz
                f[3] -= ry * wz
                f[4] += rx * wz
                f[5] -= rx * wy - ry * wx
        elif c >= 3 + tendons:
            family, axis = (c - 3 - tendons) // 3, (c - 3 - tendons) % 3
            for j in range(3):
                g[j] = profiles[family] * rotation[axis, j]
                f[j] += g[j]
        for i in range(6):
            e[i] = 0.0
            for j in range(6):
                e[i] += inverse[i, j] * f[j]
        e[0] += py * vz - pz * vy
        e[1] += pz * vx - px * vz
        e[2] += px * vy - py * vx
        bx = ny * e[2] - nz * e[1] - vy * g[2] + vz * g[1]
        by = nz * e[0] - nx * e[2] - vz * g[0] + vx * g[2]
        bz = nx * e[1] - ny * e[0] - vx * g[1] + vy * g[0]
        for i in range(3):
            rate[i, c] = rotation[i, 0] * e[3] + rotation[i, 1] * e[4] + rotation[i, 2] * e[5]
            rate[3 + i, c] = rotation[i, 0] * bx + rotation[i, 1] * by + rotation[i, 2] * bz
            rate[6 + i, c] = rotation[i, 0] * e[0] + rotation[i, 1] * e[1] + rotation[i, 2] * e[2]


@njit(**OPTIONS)
def variations(
    rod: RodArrays, tau: FloatArray, record: FloatArray, profiles: FloatArray, at_disks: FloatArray, end: FloatArray
) -> None:
    """Integrates the variational equations along a recorded case by the classical Runge-Kutta method.

    Args:
        rod: RodArrays.
        tau: Tensions, shape (t,), N.
        record: From `record_case`, shape (c, 4, 21).
        profiles: Force across the cut at the start of each step and its decrease per length, for a unit of each
            family of forces, shape (families, c, 2).
        at_disks: theta and delta p at the disks, shape (d, 6, 3 + t + 3 families); written.
        end: delta M(l), shape (3, 3 + t + 3 families); written.
    """
    count = at_disks.shape[2]
    y, trial = np.zeros((9, count)), np.empty((9, count))
    rate, total = np.empty((9, count)), np.empty((9, count))
    inverse, rotation = np.empty((6, 6)), np.empty((3, 3))
    profile = np.empty(profiles.shape[0])
    for i in range(3):
        y[3 + i, i] = 1.0
    at_disks[0] = 0.0
    for c in range(rod.step_lengths.shape[0]):
        h, segment = rod.step_lengths[c], rod.step_segments[c]
        first = rod.first_tendon[segment]
        for i in range(9):
            for j in range(count):
                trial[i, j] = total[i, j] = y[i, j]
        for stage in range(4):
            sigma = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            for k in range(profiles.shape[0]):
                profile[k] = profiles[k, c, 0] - sigma * profiles[k, c, 1]
            strain_hessian(record[c, stage, 6:12], rod.stiffness[segment], rod.offsets, tau, first, inverse)
            variation_rate(rod, record[c, stage], inverse, first, profile, trial, rate, rotation)
            share = h / 6.0 if stage in (0, 3) else h / 3.0
            reach = h if stage == 2 else 0.5 * h
            for i in range(9):
                for j in range(count):
                    total[i, j] += share * rate[i, j]
                    trial[i, j] = y[i, j] + reach * rate[i, j]
        for i in range(9):
            for j in range(count):
                y[i, j] = total[i, j]
        disk = rod.step_disks[c]
        if disk >= 0:
            for i in range(3):
                for j in range(count):
                    at_disks[disk, i, j] = y[i, j]
                    at_disks[disk, 3 + i, j] = y[6 + i, j]
    for i in range(3):
        for j in range(count):
            end[i, j] = y[3 + i, j]


@njit(**OPTIONS)
def shoot_exactly(
    rod: RodArrays,
    tau: FloatArray,
    forces: FloatArray,
    weights: FloatArray,
    base_moment: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
    end: FloatArray,
    moment: FloatArray,
    record: FloatArray,
    at_disks: FloatArray,
) -> tuple[bool, bool]:
    """Integrates the rod and its variations with M(0), the latter to the integrator's own order; see `sweep`.

    Near a buckling load dM(l)/dM(0) is nearly singular, and the second-order variations of `sweep` do not suffice.

    Args:
        rod: RodArrays.
        tau: As for `sweep`.
        forces: As for `sweep`.
        weights: As for `sweep`.
        base_moment: As for `sweep`.
        positions: As for `sweep`.
        rotations: As for `sweep`.
        end: M(l); written.
        moment: dM(l)/dM(0), shape (3, 3); written.
        record: Shape (c, 4, 21); written.
        at_disks: Variations at the disks, shape (d, 6, 3); written.

    Returns:
        Whether every cross-section was solved, and whether the shape is stable.
    """
    ok, _ = sweep(rod, tau, forces, weights, base_moment, False, positions, rotations, end, moment, moment, record)
    if not ok:
        return False, False
    variations(rod, tau, record, np.empty((0, forces.shape[0], 2)), at_disks, moment)
    stable = positive_spectrum(moment, at_disks[-1, :3])
    for disk in range(2, at_disks.shape[0]):
        stable = stable and positive_spectrum(at_disks[disk, :3], at_disks[disk - 1, :3])
    return True, stable


@njit(**OPTIONS)
def newton(
    rod: RodArrays,
    tau: FloatArray,
    forces: FloatArray,
    weights: FloatArray,
    tip_moment: FloatArray,
    base_moment: FloatArray,
    tolerance: float,
    cautious: bool,
    long: bool,
    positions: FloatArray,
    rotations: FloatArray,
) -> tuple[bool, float, int, bool, float]:
    """Newton's method on M(0), given up as soon as it does not contract.

    Contraction from the first step on keeps it on the branch of its starting point (Deuflhard 2011, ch. 5). A cautious
    run asks for more of it and ends at a stable shape or not at all; after a long step every shape on the way has to be
    stable too. What that refuses only shorter steps can decide.

    Returns:
        Whether it converged, residual in N m, sweeps made, whether the equilibrium is stable, determinant of
        dM(l)/dM(0); `base_moment`, `positions` and `rotations` hold the result.
    """
    limit = CAUTIOUS_CONTRACTION if cautious else CONTRACTION
    end, trial, delta = np.empty(3), base_moment.copy(), np.zeros(3)
    angle, moment, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    record = np.empty((0 if long else forces.shape[0], 4, 21))
    at_disks = np.empty((positions.shape[0], 6, 3))
    sweeps, size, residual = 0, np.inf, np.inf
    while True:
        if long:
            ok, stable = sweep(rod, tau, forces, weights, trial, True, positions, rotations, end, angle, moment, record)
        else:
            ok, stable = shoot_exactly(
                rod, tau, forces, weights, trial, positions, rotations, end, moment, record, at_disks
            )
        sweeps += 1
        if not ok or (long and not stable):
            return False, residual, sweeps, False, 0.0
        for j in range(3):
            end[j] -= tip_moment[j]
        residual = np.sqrt(end[0] ** 2 + end[1] ** 2 + end[2] ** 2)
        if residual > tolerance and sweeps > 1:
            natural = 0.0
            for i in range(3):
                natural += (inverse[i, 0] * end[0] + inverse[i, 1] * end[1] + inverse[i, 2] * end[2]) ** 2
            if not natural <= limit**2 * size:
                return False, residual, sweeps, False, 0.0
        for j in range(3):
            base_moment[j] = trial[j]
        determinant = invert3(moment, inverse)
        if residual <= tolerance:
            break
        if sweeps > NEWTON_LIMIT or determinant == 0.0:
            return False, residual, sweeps, False, 0.0
        size = 0.0
        for i in range(3):
            delta[i] = inverse[i, 0] * end[0] + inverse[i, 1] * end[1] + inverse[i, 2] * end[2]
            trial[i] = base_moment[i] - delta[i]
            size += delta[i] ** 2
        if not size < LARGEST_MOMENT:
            return False, residual, sweeps, False, 0.0
    if long and abs(determinant) < LIMIT_DETERMINANT:
        record = np.empty((forces.shape[0], 4, 21))
        ok, stable = shoot_exactly(
            rod, tau, forces, weights, base_moment, positions, rotations, end, moment, record, at_disks
        )
        sweeps += 1
        determinant = invert3(moment, inverse)
    return stable or not cautious, residual, sweeps, stable, determinant


@njit(**OPTIONS)
def unloaded_tangent(
    rod: RodArrays,
    tau: FloatArray,
    forces: FloatArray,
    weights: FloatArray,
    tip_moment: FloatArray,
    tangent: FloatArray,
) -> bool:
    """Writes the derivative of M(0) with the load fraction at the unloaded shape: M_tip + the integral of p' x N.

    Without loads M is zero along the rod and the strain constant in each segment, so that the shape is known.

    Returns:
        Whether the cross-section of every segment was solved.
    """
    strain, zero, inverse, twist = np.empty(6), np.zeros(6), np.empty((6, 6)), np.empty(6)
    R, Q, d = np.eye(3), np.empty((3, 3)), np.empty(3)
    for j in range(3):
        tangent[j] = tip_moment[j]
    segment = -1
    for c in range(rod.step_lengths.shape[0]):
        h = rod.step_lengths[c]
        if rod.step_segments[c] != segment:
            segment = rod.step_segments[c]
            for j in range(6):
                strain[j] = rod.rest_strain[segment, j]
            if not solve_strain(
                zero,
                strain,
                rod.stiffness[segment],
                rod.rest_strain[segment],
                rod.offsets,
                tau,
                rod.first_tendon[segment],
                inverse,
                True,
                rod.length[0],
            ):
                return False
            for j in range(3):
                twist[j] = h * strain[3 + j]
                twist[3 + j] = h * strain[j]
            exponential(twist, Q, d)
        dx = R[0, 0] * d[0] + R[0, 1] * d[1] + R[0, 2] * d[2]
        dy = R[1, 0] * d[0] + R[1, 1] * d[1] + R[1, 2] * d[2]
        dz = R[2, 0] * d[0] + R[2, 1] * d[1] + R[2, 2] * d[2]
        fx = forces[c, 0] - 0.5 * h * weights[segment, 0]
        fy = forces[c, 1] - 0.5 * h * weights[segment, 1]
        fz = forces[c, 2] - 0.5 * h * weights[segment, 2]
        tangent[0] += dy * fz - dz * fy
        tangent[1] += dz * fx - dx * fz
        tangent[2] += dx * fy - dy * fx
        for i in range(3):
            x, y, z = R[i, 0], R[i, 1], R[i, 2]
            for j in range(3):
                R[i, j] = x * Q[0, j] + y * Q[1, j] + z * Q[2, j]
    return True


@njit(**OPTIONS)
def follow_branch(
    rod: RodArrays,
    tau: FloatArray,
    forces: FloatArray,
    weights: FloatArray,
    tip_moment: FloatArray,
    base_moment: FloatArray,
    tolerance: float,
    first_step: float,
    positions: FloatArray,
    rotations: FloatArray,
) -> tuple[int, float, int, float]:
    """Follows the equilibrium from the unloaded shape to the full loads.

    Returns:
        Status code, residual in N m, sweeps made, fraction of the loads reached.
    """
    scaled_forces, scaled_weights, scaled_tip = np.zeros_like(forces), np.zeros_like(weights), np.zeros(3)
    tangent, last, guess = np.zeros(3), np.zeros(3), np.zeros(3)
    if not unloaded_tangent(rod, tau, forces, weights, tip_moment, tangent):
        return NOT_CONVERGED, np.inf, 0, 0.0
    sweeps = 0
    fraction, step = 0.0, first_step
    residual, determinant, on_stable = np.inf, 1.0, True
    while True:
        target = min(1.0, fraction + step)
        for j in range(3):
            guess[j] = last[j] + tangent[j] * (target - fraction)
            scaled_tip[j] = target * tip_moment[j]
        for j in range(3):
            for c in range(forces.shape[0]):
                scaled_forces[c, j] = target * forces[c, j]
            for k in range(weights.shape[0]):
                scaled_weights[k, j] = target * weights[k, j]
        # A stable branch may turn unstable only within the smallest step: anything longer could have left it.
        cautious = on_stable and step > 2.0 * SMALLEST_LOAD_STEP
        long = on_stable and step > LONG_LOAD_STEP
        converged, residual, made, stable, found = newton(
            rod, tau, scaled_forces, scaled_weights, scaled_tip, guess, tolerance, cautious, long, positions, rotations
        )
        sweeps += made
        if converged:
            if target == 1.0:
                for j in range(3):
                    base_moment[j] = guess[j]
                return (CONVERGED if stable else UNSTABLE), residual, sweeps, 1.0
            for j in range(3):
                tangent[j] = (guess[j] - last[j]) / (target - fraction)
                last[j] = guess[j]
            fraction, determinant, on_stable = target, found, stable
            if made <= 4:
                step *= 2.0
        else:
            step = 0.5 * min(step, 1.0 - fraction)
            if step < SMALLEST_LOAD_STEP or sweeps > SWEEP_LIMIT:
                return (
                    (LIMIT_POINT if abs(determinant) < LIMIT_DETERMINANT else NOT_CONVERGED),
                    residual,
                    sweeps,
                    fraction,
                )


@njit(**OPTIONS)
def solve_cases(
    rod: RodArrays,
    tensions: FloatArray,
    gravity: FloatArray,
    tip_force: FloatArray,
    tip_moment: FloatArray,
    distributed: FloatArray,
    disk_forces: FloatArray,
    guesses: FloatArray,
    warm: bool,
    tolerance: float,
    first_step: float,
    start: int,
    stop: int,
    positions: FloatArray,
    rotations: FloatArray,
    base_moments: FloatArray,
    residuals: FloatArray,
    codes: IntArray,
    sweeps: IntArray,
    fractions: FloatArray,
) -> None:
    """Solves the cases from start to stop, each by itself, and writes its results into the rows of the outputs."""
    steps, segments = rod.step_lengths.shape[0], rod.stiffness.shape[0]
    forces, weights = np.empty((steps, 3)), np.empty((segments, 3))
    for case in range(start, stop):
        tau = tensions[case]
        scale = load_profile(
            rod, gravity[case], tip_force[case], tip_moment[case], distributed[case],
            disk_forces[case if disk_forces.shape[0] > 1 else 0], forces, weights,
        )  # fmt: skip
        stiffness = rod.stiffness[0, 3] / rod.length[0]
        level = max(tolerance * scale, 1e-13 * stiffness)
        moment = guesses[case]
        done = False
        total = 0
        if warm and np.isfinite(moment[0] + moment[1] + moment[2]):
            converged, residual, total, stable, _ = newton(
                rod, tau, forces, weights, tip_moment[case], moment, level, True, True, positions[case], rotations[case]
            )
            if converged and stable:
                done = True
                for j in range(3):
                    base_moments[case, j] = moment[j]
                residuals[case] = residual
                codes[case] = CONVERGED
                fractions[case] = 1.0
        if not done:
            code, residual, made, fraction = follow_branch(
                rod, tau, forces, weights, tip_moment[case], base_moments[case], level, first_step,
                positions[case], rotations[case],
            )  # fmt: skip
            total += made
            codes[case] = code
            residuals[case] = residual
            fractions[case] = fraction
            if code in (LIMIT_POINT, NOT_CONVERGED):
                positions[case] = np.nan
                rotations[case] = np.nan
                base_moments[case] = np.nan
        sweeps[case] = total


@njit(**OPTIONS)
def load_profile(
    rod: RodArrays,
    gravity: FloatArray,
    tip_force: FloatArray,
    tip_moment: FloatArray,
    distributed: FloatArray,
    disk_forces: FloatArray,
    forces: FloatArray,
    weights: FloatArray,
) -> float:
    """Writes the force across the cut behind the start of each step and the dead load per length of each segment.

    Returns:
        The scale of the moment that the loads can exert: length times the largest cut force, plus the tip moment, N m.
    """
    total = np.zeros(3)
    for k in range(weights.shape[0]):
        for j in range(3):
            weights[k, j] = rod.weight_per_length[k] * gravity[j] + distributed[j]
    for j in range(3):
        total[j] = tip_force[j]
    largest = 0.0
    for c in range(forces.shape[0] - 1, -1, -1):
        disk = rod.step_disks[c]
        size = 0.0
        for j in range(3):
            if disk >= 0:
                total[j] += rod.disk_masses[disk] * gravity[j] + disk_forces[disk, j]
            total[j] += rod.step_lengths[c] * weights[rod.step_segments[c], j]
            forces[c, j] = total[j]
            size += total[j] ** 2
        largest = max(largest, size)
    moment = np.sqrt(tip_moment[0] ** 2 + tip_moment[1] ** 2 + tip_moment[2] ** 2)
    return np.sqrt(largest) * rod.length[0] + moment


@njit(**OPTIONS)
def record_cases(
    rod: RodArrays,
    tensions: FloatArray,
    gravity: FloatArray,
    tip_force: FloatArray,
    tip_moment: FloatArray,
    distributed: FloatArray,
    disk_forces: FloatArray,
    converged: BoolArray,
    base_moments: FloatArray,
    record: FloatArray,
) -> None:
    """Integrates solved cases again and keeps what happens at every Runge-Kutta stage, record (n, c, 4, 21)."""
    steps, disks = rod.step_lengths.shape[0], rod.disk_masses.shape[0]
    forces, weights = np.empty((steps, 3)), np.empty((rod.stiffness.shape[0], 3))
    positions, rotations = np.empty((disks, 3)), np.empty((disks, 3, 3))
    end, angle, moment = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for case in range(tensions.shape[0]):
        if not converged[case]:
            record[case] = np.nan
            continue
        point = disk_forces[case if disk_forces.shape[0] > 1 else 0]
        load_profile(rod, gravity[case], tip_force[case], tip_moment[case], distributed[case], point, forces, weights)
        sweep(
            rod,
            tensions[case],
            forces,
            weights,
            base_moments[case],
            False,
            positions,
            rotations,
            end,
            angle,
            moment,
            record[case],
        )


@njit(**OPTIONS)
def variations_of_cases(
    rod: RodArrays,
    tensions: FloatArray,
    converged: BoolArray,
    record: FloatArray,
    profiles: FloatArray,
    at_disks: FloatArray,
    end: FloatArray,
) -> None:
    """Integrates the variational equations of every case with an equilibrium; see `variations`."""
    for case in range(tensions.shape[0]):
        if converged[case]:
            variations(rod, tensions[case], record[case], profiles, at_disks[case], end[case])
