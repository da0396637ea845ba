"""The strain of a cross-section from the force and moment across it and the tensions of its tendons."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.options import INLINED, OPTIONS

STRAIN_TOLERANCE = 1e-12
STRAIN_ITERATIONS = 60


@njit(**OPTIONS)
def invert_hessian(
    strain: FloatArray,
    stiffness: FloatArray,
    offsets: FloatArray,
    slopes: FloatArray,
    pulls: FloatArray,
    count: int,
    inverse: FloatArray,
) -> None:
    """Writes the inverse of the 6 x 6 Hessian of the cross-section energy at a strain, by blocks.

    Args:
        strain: (v, u), shape (6,).
        stiffness: Diagonals of Kse and Kbt, shape (6,).
        offsets: r of each tendon, shape (t, 2), m.
        slopes: r' of each tendon, shape (t, 2).
        pulls: Tension of each tendon, shape (t,), N.
        count: Number of tendons.
        inverse: Shape (6, 6); written.
    """
    vx, vy, vz, ux, uy, uz = strain[0], strain[1], strain[2], strain[3], strain[4], strain[5]
    a00, a11, a22 = stiffness[0], stiffness[1], stiffness[2]
    a01 = a02 = a12 = 0.0
    d00, d11, d22 = stiffness[3], stiffness[4], stiffness[5]
    d01 = d02 = d12 = 0.0
    b00 = b01 = b02 = b10 = b11 = b12 = b20 = b21 = b22 = 0.0
    for i in range(count):
        tension = pulls[i]
        if tension == 0.0:
            continue
        rx, ry = offsets[i, 0], offsets[i, 1]
        wx, wy, wz = vx - uz * ry + slopes[i, 0], vy + uz * rx + slopes[i, 1], vz + ux * ry - uy * rx
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


@njit(**INLINED)
def solve_strain(
    load: FloatArray,
    strain: FloatArray,
    stiffness: FloatArray,
    rest: FloatArray,
    offsets: FloatArray,
    slopes: FloatArray,
    pulls: FloatArray,
    count: int,
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
            invert_hessian(strain, stiffness, offsets, slopes, pulls, count, inverse)
            refresh = False
        f0 = stiffness[0] * (vx - rest[0]) - load[0]
        f1 = stiffness[1] * (vy - rest[1]) - load[1]
        f2 = stiffness[2] * (vz - rest[2]) - load[2]
        f3 = stiffness[3] * (ux - rest[3]) - load[3]
        f4 = stiffness[4] * (uy - rest[4]) - load[4]
        f5 = stiffness[5] * (uz - rest[5]) - load[5]
        for i in range(count):
            tension = pulls[i]
            if tension == 0.0:
                continue
            rx, ry = offsets[i, 0], offsets[i, 1]
            wx, wy, wz = vx - uz * ry + slopes[i, 0], vy + uz * rx + slopes[i, 1], vz + ux * ry - uy * rx
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


@njit(**INLINED)
def predict(load: FloatArray, previous: FloatArray, inverse: FloatArray, strain: FloatArray) -> None:
    """Moves the strain along the linearised equations from the previous load to this one."""
    for i in range(6):
        change = 0.0
        for j in range(6):
            change += inverse[i, j] * (load[j] - previous[j])
        strain[i] += change
    for j in range(6):
        previous[j] = load[j]
