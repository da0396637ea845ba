"""The variational equations of the rod along a recorded shape, to the integrator's own order."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.chord import chord_balance, chord_path
from tdcr_planner.statics.cross_section import invert_hessian
from tdcr_planner.statics.options import OPTIONS
from tdcr_planner.statics.rod import RodArrays
from tdcr_planner.statics.small_matrices import invert
from tdcr_planner.statics.tension import TendonTension


@njit(**OPTIONS)
def invert_stage(
    rod: RodArrays, pulls: FloatArray, c: int, point: int, strain: FloatArray, inverse: FloatArray
) -> None:
    """Writes the derivative of the strain by the load at a stage point, shape (6, 6); zero in rigid steps."""
    if rod.rigid[c]:
        for i in range(6):
            for j in range(6):
                inverse[i, j] = 0.0
    elif rod.chords[c, point, 0] > 0.0:
        balance, jacobian = np.empty(6), np.empty((6, 6))
        chord_balance(
            strain, rod.stiffness[c, point], rod.rest_strain[c, point], rod.offsets[c, point], rod.slopes[c, point],
            pulls[c, point], rod.tendon_counts[c], rod.chords[c, point], strain, balance, jacobian,
        )  # fmt: skip
        invert(jacobian, inverse)
    else:
        invert_hessian(
            strain, rod.stiffness[c, point], rod.offsets[c, point], rod.slopes[c, point], pulls[c, point],
            rod.tendon_counts[c], inverse,
        )  # fmt: skip


@njit(**OPTIONS)
def variation_rate(
    rod: RodArrays,
    tension: TendonTension,
    c: int,
    point: int,
    stage: FloatArray,
    inverse: FloatArray,
    profiles: FloatArray,
    columns: FloatArray,
    rate: FloatArray,
    length_rate: FloatArray,
) -> None:
    """Writes the derivative of theta, delta M and delta p (base frame) at one stage, a column for each parameter.

    Args:
        rod: RodArrays.
        tension: The tensions along the tendons.
        c: The step.
        point: The stage point in it.
        stage: Load, strain and rotation of the stage, shape (21,).
        inverse: H^-1 at the stage, shape (6, 6).
        profiles: Force across the cut for a unit of each family of forces, shape (families,).
        columns: theta, delta M, delta p over M(0), tensions and forces, shape (9, 3 + t + 3 families).
        rate: Their derivatives, shape (9, 3 + t + 3 families); written.
        length_rate: Derivative of the path lengths' rate, shape (t, 3 + t + 3 families); written.
    """
    nx, ny, nz, mx, my, mz = stage[0], stage[1], stage[2], stage[3], stage[4], stage[5]
    vx, vy, vz, ux, uy, uz = stage[6], stage[7], stage[8], stage[9], stage[10], stage[11]
    rotation = stage[12:21].reshape((3, 3))
    tendons, count = rod.tendons.shape[1], rod.tendon_counts[c]
    half, along = rod.chords[c, point, 0], rod.chords[c, point, 1]
    f, e, g, pulled = np.empty(6), np.empty(6), np.empty(3), np.zeros((tendons, 7))
    for i in range(tendons):
        for k in range(columns.shape[1]):
            length_rate[i, k] = 0.0
    for row in range(count):
        i = rod.tendons[c, row]
        x, y, dx, dy = chord_path(half, along, rod.offsets[c, point, row], rod.slopes[c, point, row], stage[6:12])
        wx, wy, wz = vx - uz * y + dx, vy + uz * x + dy, vz + ux * y - uy * x
        scale = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
        wx, wy, wz = wx * scale, wy * scale, wz * scale
        pulled[i, 0], pulled[i, 1], pulled[i, 2] = wx, wy, wz
        pulled[i, 3], pulled[i, 4], pulled[i, 5] = y * wz, -x * wz, x * wy - y * wx
        pulled[i, 6] = tension.weights[c, point, row] if tension.friction.shape[0] > 0 else 1.0
    for k in range(columns.shape[1]):
        px = rotation[0, 0] * columns[0, k] + rotation[1, 0] * columns[1, k] + rotation[2, 0] * columns[2, k]
        py = rotation[0, 1] * columns[0, k] + rotation[1, 1] * columns[1, k] + rotation[2, 1] * columns[2, k]
        pz = rotation[0, 2] * columns[0, k] + rotation[1, 2] * columns[1, k] + rotation[2, 2] * columns[2, k]
        f[0], f[1], f[2] = ny * pz - nz * py, nz * px - nx * pz, nx * py - ny * px
        f[3] = my * pz - mz * py
        f[4] = mz * px - mx * pz
        f[5] = mx * py - my * px
        for j in range(3):
            f[3 + j] += rotation[0, j] * columns[3, k] + rotation[1, j] * columns[4, k] + rotation[2, j] * columns[5, k]
            g[j] = 0.0
        if 3 <= k < 3 + tendons:
            for j in range(6):
                f[j] -= pulled[k - 3, 6] * pulled[k - 3, j]
        elif k >= 3 + tendons:
            family, axis = (k - 3 - tendons) // 3, (k - 3 - tendons) % 3
            for j in range(3):
                g[j] = profiles[family] * rotation[axis, j]
                f[j] += g[j]
        for i in range(6):
            e[i] = 0.0
            for j in range(6):
                e[i] += inverse[i, j] * f[j]
        for row in range(count):
            i = rod.tendons[c, row]
            for j in range(6):
                length_rate[i, k] += pulled[i, j] * e[j]
        e[0] += py * vz - pz * vy
        e[1] += pz * vx - px * vz
        e[2] += px * vy - py * vx
        bx = ny * e[2] - nz * e[1] - vy * g[2] + vz * g[1]
        by = nz * e[0] - nx * e[2] - vz * g[0] + vx * g[2]
        bz = nx * e[1] - ny * e[0] - vx * g[1] + vy * g[0]
        for i in range(3):
            rate[i, k] = rotation[i, 0] * e[3] + rotation[i, 1] * e[4] + rotation[i, 2] * e[5]
            rate[3 + i, k] = rotation[i, 0] * bx + rotation[i, 1] * by + rotation[i, 2] * bz
            rate[6 + i, k] = rotation[i, 0] * e[0] + rotation[i, 1] * e[1] + rotation[i, 2] * e[2]


@njit(**OPTIONS)
def variations(
    rod: RodArrays,
    tension: TendonTension,
    record: FloatArray,
    profiles: FloatArray,
    at_disks: FloatArray,
    end: FloatArray,
    length_rates: FloatArray,
) -> None:
    """Integrates the variational equations along a recorded case by the classical Runge-Kutta method.

    Args:
        rod: RodArrays.
        tension: The tensions along the tendons.
        record: Of the case, shape (c, 4, 21), as `integrate` writes it.
        profiles: Force across the cut at the stage points of each step for a unit of each family of forces, shape
            (families, c, 3).
        at_disks: theta and delta p at the disks, shape (d, 6, 3 + t + 3 families); written.
        end: delta M(l), shape (3, 3 + t + 3 families); written.
        length_rates: Derivative of the tendons' path lengths, shape (t, 3 + t + 3 families); written.
    """
    count, tendons = at_disks.shape[2], rod.tendons.shape[1]
    y, trial = np.zeros((9, count)), np.empty((9, count))
    rate, total, length_rate = np.empty((9, count)), np.empty((9, count)), np.empty((tendons, count))
    inverse, profile = np.empty((6, 6)), np.empty(profiles.shape[0])
    for i in range(3):
        y[3 + i, i] = 1.0
    at_disks[0] = 0.0
    for i in range(tendons):
        for j in range(count):
            length_rates[i, j] = 0.0
    for c in range(rod.step_lengths.shape[0]):
        h = rod.step_lengths[c]
        for i in range(9):
            for j in range(count):
                trial[i, j] = total[i, j] = y[i, j]
        for stage in range(4):
            point = 0 if stage == 0 else (2 if stage == 3 else 1)
            for k in range(profiles.shape[0]):
                profile[k] = profiles[k, c, point]
            invert_stage(rod, tension.pulls, c, point, record[c, stage, 6:12], inverse)
            variation_rate(
                rod, tension, c, point, record[c, stage], inverse, profile, trial, rate, length_rate
            )  # fmt: skip
            share = h / 6.0 if stage in (0, 3) else h / 3.0
            reach = h if stage == 2 else 0.5 * h
            for i in range(9):
                for j in range(count):
                    total[i, j] += share * rate[i, j]
                    trial[i, j] = y[i, j] + reach * rate[i, j]
            for i in range(tendons):
                for j in range(count):
                    length_rates[i, j] += share * length_rate[i, j]
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
