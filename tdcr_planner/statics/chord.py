"""The cross-section of a rod whose tendons run straight from disk to disk: offsets that follow the bend of the gap.

The part of the tendon between two disks is a chord. Its point in a cross-section lies off the place r0 that a channel
would give by g q, with q = u x (v + u x r0 + 2 r0') the curvature vector of the channel and

    g = (A^2 - B^2)/2 (1 - |u|^2 (A^2 - 5 B^2)/12),    A = h/2, B = arc length from the gap's middle,

which is the chord of a circular arc up to the fourth power of the gap's bend angle.
"""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.cross_section import STRAIN_ITERATIONS, STRAIN_TOLERANCE
from tdcr_planner.statics.options import OPTIONS
from tdcr_planner.statics.small_matrices import invert


@njit(**OPTIONS)
def chord_path(
    half: float, along: float, offset: FloatArray, slope: FloatArray, strain: FloatArray
) -> tuple[float, float, float, float]:
    """Returns offset x, y and their slopes of a tendon; those given where it runs in a channel (`half` is 0)."""
    x, y, dx, dy = offset[0], offset[1], slope[0], slope[1]
    if half > 0.0:
        ux, uy, uz = strain[3], strain[4], strain[5]
        bend = ux * ux + uy * uy
        gain = 0.5 * (half * half - along * along)
        lessening = 1.0 - bend * (half * half - 5.0 * along * along) / 12.0
        wx, wy, wz = 2.0 * dx - uz * y, 2.0 * dy + uz * x, 1.0 + ux * y - uy * x
        qx, qy = uy * wz - uz * wy, uz * wx - ux * wz
        g = gain * lessening
        dg = -along * lessening + gain * bend * along * (5.0 / 6.0)
        x, y, dx, dy = x + g * qx, y + g * qy, dx + dg * qx, dy + dg * qy
    return x, y, dx, dy


@njit(**OPTIONS)
def chord_balance(
    strain: FloatArray,
    stiffness: FloatArray,
    rest: FloatArray,
    offsets: FloatArray,
    slopes: FloatArray,
    pulls: FloatArray,
    count: int,
    chord: FloatArray,
    load: FloatArray,
    balance: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Writes what is left over of the six equations of the cross-section, shape (6,), and its derivative, (6, 6)."""
    half, along = chord[0], chord[1]
    vx, vy, vz, ux, uy, uz = strain[0], strain[1], strain[2], strain[3], strain[4], strain[5]
    bend = ux * ux + uy * uy
    gain = 0.5 * (half * half - along * along)
    loss = (half * half - 5.0 * along * along) / 12.0
    g = gain * (1.0 - bend * loss)
    dg = -along * (1.0 - bend * loss) + gain * bend * along * (5.0 / 6.0)
    g_bend, dg_bend = -2.0 * gain * loss, 2.0 * along * loss + gain * along * (5.0 / 3.0)
    F, dF, turned, spin = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(6):
        balance[i] = stiffness[i] * (strain[i] - rest[i]) - load[i]
        for j in range(6):
            jacobian[i, j] = stiffness[i] if i == j else 0.0
    for tendon in range(count):
        if pulls[tendon] == 0.0:
            continue
        x0, y0, dx0, dy0 = offsets[tendon, 0], offsets[tendon, 1], slopes[tendon, 0], slopes[tendon, 1]
        ax, ay, az = 2.0 * dx0 - uz * y0, 2.0 * dy0 + uz * x0, 1.0 + ux * y0 - uy * x0
        qx, qy = uy * az - uz * ay, uz * ax - ux * az
        x, y = x0 + g * qx, y0 + g * qy
        wx = vx - uz * y + dx0 + dg * qx
        wy = vy + uz * x + dy0 + dg * qy
        wz = vz + ux * y - uy * x
        scale = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
        tx, ty, tz = wx * scale, wy * scale, wz * scale
        c = pulls[tendon] * scale
        F[0], F[1], F[2] = pulls[tendon] * tx, pulls[tendon] * ty, pulls[tendon] * tz
        balance[0] += F[0]
        balance[1] += F[1]
        balance[2] += F[2]
        balance[3] += y * F[2]
        balance[4] -= x * F[2]
        balance[5] += x * F[1] - y * F[0]
        for j in range(6):
            mx = my = 0.0
            for k in range(3):
                turned[k] = 1.0 if j == k else 0.0
                spin[k] = 1.0 if j == 3 + k else 0.0
            if j >= 3:
                sx, sy, sz = spin[0], spin[1], spin[2]
                bx, by, bz = -sz * y0, sz * x0, sx * y0 - sy * x0
                dqx = sy * az - sz * ay + uy * bz - uz * by
                dqy = sz * ax - sx * az + uz * bx - ux * bz
                along_bend = ux * sx + uy * sy
                mx, my = g * dqx + g_bend * along_bend * qx, g * dqy + g_bend * along_bend * qy
                turned[0] = -sz * y - uz * my + dg * dqx + dg_bend * along_bend * qx
                turned[1] = sz * x + uz * mx + dg * dqy + dg_bend * along_bend * qy
                turned[2] = sx * y - sy * x + ux * my - uy * mx
            dot = tx * turned[0] + ty * turned[1] + tz * turned[2]
            dF[0] = c * (turned[0] - tx * dot)
            dF[1] = c * (turned[1] - ty * dot)
            dF[2] = c * (turned[2] - tz * dot)
            jacobian[0, j] += dF[0]
            jacobian[1, j] += dF[1]
            jacobian[2, j] += dF[2]
            jacobian[3, j] += y * dF[2] + my * F[2]
            jacobian[4, j] -= x * dF[2] + mx * F[2]
            jacobian[5, j] += x * dF[1] - y * dF[0] + mx * F[1] - my * F[0]


@njit(**OPTIONS)
def solve_chord_strain(
    load: FloatArray,
    strain: FloatArray,
    stiffness: FloatArray,
    rest: FloatArray,
    offsets: FloatArray,
    slopes: FloatArray,
    pulls: FloatArray,
    count: int,
    chord: FloatArray,
    inverse: FloatArray,
    length: float,
) -> bool:
    """Solves the six equations of a cross-section between two disks for its strain by Newton's method.

    Returns:
        Whether it converged; `strain` holds the result, `inverse` the inverse of the derivative there.
    """
    balance, jacobian = np.empty(6), np.empty((6, 6))
    for _ in range(STRAIN_ITERATIONS):
        chord_balance(strain, stiffness, rest, offsets, slopes, pulls, count, chord, load, balance, jacobian)
        if not invert(jacobian, inverse):
            return False
        size = 0.0
        for i in range(6):
            step = 0.0
            for j in range(6):
                step += inverse[i, j] * balance[j]
            strain[i] -= step
            size += abs(step) * (1.0 if i < 3 else length)
        if not size < 1e12:
            return False
        if size < 1e3 * STRAIN_TOLERANCE:
            return True
    return False
