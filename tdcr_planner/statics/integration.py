"""One integration of the rod from base to tip, with the variations by which the shooting method corrects its start."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.chord import chord_path, solve_chord_strain
from tdcr_planner.statics.cross_section import predict, solve_strain
from tdcr_planner.statics.cut_loads import CutLoads, added_moment_rate, load_at
from tdcr_planner.statics.motion import dexp_inverse, se3_exp
from tdcr_planner.statics.options import INLINED, OPTIONS
from tdcr_planner.statics.rod import RodArrays
from tdcr_planner.statics.small_matrices import negative_eigenvalues, positive_spectrum
from tdcr_planner.statics.tension import TendonTension, slide, start_sliding, turn, write_tangents


@njit(**OPTIONS)
def integrate(
    rod: RodArrays,
    loads: CutLoads,
    tension: TendonTension,
    base_moment: FloatArray,
    with_variations: bool,
    positions: FloatArray,
    rotations: FloatArray,
    end_moment: FloatArray,
    angle: FloatArray,
    moment: FloatArray,
    lengths: FloatArray,
    length_rates: FloatArray,
    record: FloatArray,
) -> tuple[bool, int]:
    """Integrates the rod from base to tip for a given moment at the base.

    Runge-Kutta-Munthe-Kaas of fourth order on SE(3), in the frame of each step's start.

    Args:
        rod: RodArrays.
        loads: The case's loads.
        tension: The tensions along the tendons.
        base_moment: M(0), shape (3,), N m.
        with_variations: Whether to integrate the variations as well.
        positions: Disk centres, shape (d, 3), m; written.
        rotations: Disk rotations, shape (d, 3, 3); written.
        end_moment: M(l) less the moment that the payload exerts, shape (3,), N m; written.
        angle: Derivative of the rotation theta(l) by M(0), and by the tensions where there are more than 3 columns,
            shape (3, k); written.
        moment: Derivative of `end_moment`, shape (3, k); written.
        lengths: Length of each tendon's path and the integral of its tension along it, shape (2, t), m and N m;
            written. Shape (0, t) for none.
        length_rates: Derivative of the path lengths, shape (t, k); written. Shape (0, k) for none.
        record: Load (6), strain (6) and rotation (9) at each Runge-Kutta stage, shape (c, 4, 21); written. Shape
            (0, 4, 21) keeps no record.

    Returns:
        Whether every cross-section was solved, and the number of unstable modes found on the way (0 without
        variations). With 3 columns counting stops at the first one.
    """
    load, previous, strain = np.empty(6), np.empty(6), np.empty(6)
    inverse = np.empty((6, 6))
    slope, total, twist = np.empty(6), np.empty(6), np.empty(6)
    Q, d, added, added_sum, added_rate = np.empty((3, 3)), np.empty(3), np.zeros(3), np.zeros(3), np.zeros(3)
    R, Rm = np.eye(3), np.empty((3, 3))
    p, M = np.zeros(3), base_moment.copy()
    n0, m0, l0, W = np.empty(3), np.empty(3), np.zeros(3), np.zeros((3, 3))
    columns = angle.shape[1]
    phi, mu, rate, before = np.empty((3, 3)), np.empty((3, 3)), np.empty((6, 3)), np.empty((3, 3))
    # For more columns than those of M(0): their body components and rates, and what the step's tendons do.
    room, pulled = np.empty((12, columns)), np.empty((rod.tendons.shape[1], 7))
    has_lengths, rubs, has_record = lengths.shape[0] > 0, tension.friction.shape[0] > 0, record.shape[0] > 0
    modes = 0
    begun = False
    start_integration(positions, rotations, angle, moment, with_variations, lengths, length_rates)
    length = rod.length[0]
    if rubs:
        start_sliding(tension)
    for c in range(rod.step_lengths.shape[0]):
        h, rigid, count, half_gap = rod.step_lengths[c], rod.rigid[c], rod.tendon_counts[c], rod.chords[c, 0, 0]
        enters = rod.joins[c] or (c > 0 and rod.rigid[c - 1])
        loaded = start_step(loads, c, R, M, n0, m0, l0, W)
        if rubs:
            slide(rod, tension, c)
        for j in range(3):
            load[j], load[3 + j] = n0[j], m0[j]
            added_sum[j] = added[j] = 0.0
        for stage in range(4):
            point = 0 if stage == 0 else (2 if stage == 3 else 1)
            sigma = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            if stage > 0:
                for j in range(6):
                    twist[j] = sigma * slope[j]
                se3_exp(twist, Q, d)
                load_at(Q, d, added, W[point], n0, m0, load)
            if c == 0 and stage == 0:
                for j in range(6):
                    strain[j] = rod.rest_strain[0, 0, j]
            if rigid:
                for i in range(6):
                    strain[i] = rod.rest_strain[c, point, i]
                    for j in range(6):
                        inverse[i, j] = 0.0
            else:
                fresh = stage == 0 and enters
                if fresh:
                    for j in range(6):
                        previous[j] = load[j]
                else:
                    predict(load, previous, inverse, strain)
                if half_gap > 0.0:
                    if not solve_chord_strain(
                        load, strain, rod.stiffness[c, point], rod.rest_strain[c, point], rod.offsets[c, point],
                        rod.slopes[c, point], tension.pulls[c, point], count, rod.chords[c, point], inverse, length,
                    ):  # fmt: skip
                        return False, modes
                elif not solve_strain(
                    load, strain, rod.stiffness[c, point], rod.rest_strain[c, point], rod.offsets[c, point],
                    rod.slopes[c, point], tension.pulls[c, point], count, inverse, fresh or stage == 1, length,
                ):  # fmt: skip
                    return False, modes
            if has_record:
                for j in range(6):
                    record[c, stage, j] = load[j]
                    record[c, stage, 6 + j] = strain[j]
                for i in range(3):
                    for j in range(3):
                        record[c, stage, 12 + 3 * i + j] = (
                            R[i, j] if stage == 0 else R[i, 0] * Q[0, j] + R[i, 1] * Q[1, j] + R[i, 2] * Q[2, j]
                        )
            if rubs and stage != 1:
                write_tangents(rod, tension, c, point, strain)
            fraction = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
            if has_lengths:
                add_lengths(rod, tension, c, point, strain, fraction * h, lengths)
            if stage == 0:
                for j in range(3):
                    slope[j] = strain[3 + j]
                    slope[3 + j] = strain[j]
                    added[j] = -0.5 * h * l0[j]
                    added_sum[j] = -fraction * h * l0[j]
                for j in range(6):
                    total[j] = slope[j] / 6.0
            else:
                dexp_inverse(twist, strain, slope)
                for j in range(6):
                    total[j] += fraction * slope[j]
                if loaded:
                    added_moment_rate(Q, strain, W[point], l0, added_rate)
                    for j in range(3):
                        added_sum[j] += fraction * h * added_rate[j]
                        added[j] = (h if stage == 2 else 0.5 * h) * added_rate[j]
            if stage == 2 and with_variations:
                for i in range(3):
                    for j in range(3):
                        Rm[i, j] = R[i, 0] * Q[0, j] + R[i, 1] * Q[1, j] + R[i, 2] * Q[2, j]
                        before[i, j] = angle[i, j]
                if columns == 3:
                    advance_variations(
                        3, h, load, strain, inverse, Rm, pulled, rod.places[c], angle, moment, phi, mu, rate,
                        rod.tendons[c], count, length_rates,
                    )  # fmt: skip
                else:
                    pull_directions(rod, tension, c, strain, pulled)
                    advance_variations(
                        columns, h, load, strain, inverse, Rm, pulled, rod.places[c], angle, moment, room[0:3],
                        room[3:6], room[6:12], rod.tendons[c], count, length_rates,
                    )  # fmt: skip
                if begun and not rigid:
                    if columns > 3:
                        modes += negative_eigenvalues(angle, before)
                    elif modes == 0 and not positive_spectrum(angle, before):
                        modes = 1
        begun = begun or not rigid
        if rubs:
            turn(rod, tension, c)
        for j in range(6):
            twist[j] = h * total[j]
        se3_exp(twist, Q, d)
        end_step(rod.step_disks[c], loads, Q, d, n0, m0, added_sum, p, M, R, positions, rotations)
    end_moment[0], end_moment[1], end_moment[2] = M[0], M[1], M[2]
    add_payload(rod, loads, R, end_moment, angle, moment)
    if with_variations and modes == 0:
        if columns > 3:
            modes += negative_eigenvalues(moment, angle)
        elif not positive_spectrum(moment, angle):
            modes = 1
    elif with_variations and columns > 3:
        modes += negative_eigenvalues(moment, angle)
    return np.isfinite(M[0] + M[1] + M[2]), modes


@njit(**INLINED)
def start_integration(
    positions: FloatArray,
    rotations: FloatArray,
    angle: FloatArray,
    moment: FloatArray,
    with_variations: bool,
    lengths: FloatArray,
    length_rates: FloatArray,
) -> None:
    """Sets the base pose, the variations and the lengths to what they are at the base."""
    for i in range(3):
        positions[0, i] = 0.0
        for j in range(3):
            rotations[0, i, j] = 1.0 if i == j else 0.0
        if with_variations:
            for j in range(angle.shape[1]):
                angle[i, j] = 0.0
                moment[i, j] = 1.0 if i == j else 0.0
    for kind in range(lengths.shape[0]):
        for i in range(lengths.shape[1]):
            lengths[kind, i] = 0.0
    for i in range(length_rates.shape[0]):
        for j in range(length_rates.shape[1]):
            length_rates[i, j] = 0.0


@njit(**INLINED)
def start_step(
    loads: CutLoads,
    c: int,
    R: FloatArray,
    M: FloatArray,
    n0: FloatArray,
    m0: FloatArray,
    l0: FloatArray,
    W: FloatArray,
) -> bool:
    """Writes force, moment, moment per length and the loads along a step in the frame of its start.

    Returns:
        Whether the step itself carries load.
    """
    size = 0.0
    for j in range(3):
        n0[j] = R[0, j] * loads.forces[c, 0] + R[1, j] * loads.forces[c, 1] + R[2, j] * loads.forces[c, 2]
        m0[j] = R[0, j] * M[0] + R[1, j] * M[1] + R[2, j] * M[2]
        size += abs(loads.line_loads[c, 1, j]) + abs(loads.line_moment[j])
    if size == 0.0:
        for j in range(3):
            l0[j] = W[1, j] = W[2, j] = 0.0
        return False
    for j in range(3):
        x, y, z = R[0, j], R[1, j], R[2, j]
        l0[j] = x * loads.line_moment[0] + y * loads.line_moment[1] + z * loads.line_moment[2]
        for k in range(2):
            W[k + 1, j] = x * loads.line_loads[c, k, 0] + y * loads.line_loads[c, k, 1] + z * loads.line_loads[c, k, 2]
    return True


@njit(**INLINED)
def end_step(
    disk: int,
    loads: CutLoads,
    Q: FloatArray,
    d: FloatArray,
    n0: FloatArray,
    m0: FloatArray,
    added: FloatArray,
    p: FloatArray,
    M: FloatArray,
    R: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
) -> None:
    """Moves pose and moment over a step: M(end) = M - (p(end) - p) x N + the moment of the step's own loads."""
    mx = m0[0] - d[1] * n0[2] + d[2] * n0[1] + added[0]
    my = m0[1] - d[2] * n0[0] + d[0] * n0[2] + added[1]
    mz = m0[2] - d[0] * n0[1] + d[1] * n0[0] + added[2]
    for i in range(3):
        p[i] += R[i, 0] * d[0] + R[i, 1] * d[1] + R[i, 2] * d[2]
        M[i] = R[i, 0] * mx + R[i, 1] * my + R[i, 2] * mz
    for i in range(3):
        x, y, z = R[i, 0], R[i, 1], R[i, 2]
        for j in range(3):
            R[i, j] = x * Q[0, j] + y * Q[1, j] + z * Q[2, j]
    if disk >= 0:
        for i in range(3):
            M[i] -= loads.disk_moments[disk, i]
            positions[disk, i] = p[i]
            for j in range(3):
                rotations[disk, i, j] = R[i, j]


@njit(**OPTIONS)
def add_payload(
    rod: RodArrays, loads: CutLoads, R: FloatArray, end_moment: FloatArray, angle: FloatArray, moment: FloatArray
) -> None:
    """Takes the moment of a payload off the axis, (R a) x m g, from M(l), and its variation from that of M(l)."""
    x, y, z = rod.payload[1], rod.payload[2], rod.payload[3]
    if x == 0.0 and y == 0.0 and z == 0.0:
        return
    fx, fy, fz = loads.payload[0], loads.payload[1], loads.payload[2]
    ax = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
    ay = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
    az = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
    end_moment[0] -= ay * fz - az * fy
    end_moment[1] -= az * fx - ax * fz
    end_moment[2] -= ax * fy - ay * fx
    for k in range(angle.shape[1]):
        bx = angle[1, k] * az - angle[2, k] * ay
        by = angle[2, k] * ax - angle[0, k] * az
        bz = angle[0, k] * ay - angle[1, k] * ax
        moment[0, k] -= by * fz - bz * fy
        moment[1, k] -= bz * fx - bx * fz
        moment[2, k] -= bx * fy - by * fx


@njit(**OPTIONS)
def add_lengths(
    rod: RodArrays, tension: TendonTension, c: int, point: int, strain: FloatArray, share: float, lengths: FloatArray
) -> None:
    """Adds a stage's part of the length |v + u x r + r'| of each tendon, and of its tension along it."""
    vx, vy, vz, ux, uy, uz = strain[0], strain[1], strain[2], strain[3], strain[4], strain[5]
    half, along = rod.chords[c, point, 0], rod.chords[c, point, 1]
    for column in range(rod.tendon_counts[c]):
        i = rod.tendons[c, column]
        x, y, dx, dy = chord_path(half, along, rod.offsets[c, point, column], rod.slopes[c, point, column], strain)
        wx, wy, wz = vx - uz * y + dx, vy + uz * x + dy, vz + ux * y - uy * x
        size = share * np.sqrt(wx * wx + wy * wy + wz * wz)
        lengths[0, i] += size
        lengths[1, i] += size * tension.pulls[c, point, column]


@njit(**OPTIONS)
def pull_directions(rod: RodArrays, tension: TendonTension, c: int, strain: FloatArray, pulled: FloatArray) -> None:
    """Writes what each tendon's tension does at the middle of a step, shape (t, 7).

    (t, r x t), and the derivative of the tension there by that at the base.
    """
    vx, vy, vz, ux, uy, uz = strain[0], strain[1], strain[2], strain[3], strain[4], strain[5]
    half, along = rod.chords[c, 1, 0], rod.chords[c, 1, 1]
    for column in range(rod.tendon_counts[c]):
        x, y, dx, dy = chord_path(half, along, rod.offsets[c, 1, column], rod.slopes[c, 1, column], strain)
        wx, wy, wz = vx - uz * y + dx, vy + uz * x + dy, vz + ux * y - uy * x
        scale = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
        wx, wy, wz = wx * scale, wy * scale, wz * scale
        pulled[column, 0], pulled[column, 1], pulled[column, 2] = wx, wy, wz
        pulled[column, 3], pulled[column, 4], pulled[column, 5] = y * wz, -x * wz, x * wy - y * wx
        pulled[column, 6] = tension.weights[c, 1, column] if tension.friction.shape[0] > 0 else 1.0


@njit(**INLINED)
def advance_variations(
    columns: int,
    h: float,
    load: FloatArray,
    strain: FloatArray,
    inverse: FloatArray,
    Rm: FloatArray,
    pulled: FloatArray,
    places: IntArray,
    angle: FloatArray,
    moment: FloatArray,
    phi: FloatArray,
    mu: FloatArray,
    rate: FloatArray,
    tendons: IntArray,
    count: int,
    length_rates: FloatArray,
) -> None:
    """Advances the variations over a step by the midpoint rule, in the frame of its middle.

    `columns` is their number: a constant where the call says so, by which the compiler lays out the loops.
    """
    for i in range(3):
        for j in range(columns):
            phi[i, j] = Rm[0, i] * angle[0, j] + Rm[1, i] * angle[1, j] + Rm[2, i] * angle[2, j]
            mu[i, j] = Rm[0, i] * moment[0, j] + Rm[1, i] * moment[1, j] + Rm[2, i] * moment[2, j]
    rate_of_variation(columns, load, strain, inverse, phi, mu, pulled, places, rate, tendons, count, 0.0, length_rates)
    for i in range(3):
        for j in range(columns):
            phi[i, j] += 0.5 * h * rate[i, j]
            mu[i, j] += 0.5 * h * rate[3 + i, j]
    rate_of_variation(columns, load, strain, inverse, phi, mu, pulled, places, rate, tendons, count, h, length_rates)
    for i in range(3):
        for j in range(columns):
            angle[i, j] += h * (Rm[i, 0] * rate[0, j] + Rm[i, 1] * rate[1, j] + Rm[i, 2] * rate[2, j])
            moment[i, j] += h * (Rm[i, 0] * rate[3, j] + Rm[i, 1] * rate[4, j] + Rm[i, 2] * rate[5, j])


@njit(**INLINED)
def rate_of_variation(
    columns: int,
    load: FloatArray,
    strain: FloatArray,
    inverse: FloatArray,
    angle: FloatArray,
    moment: FloatArray,
    pulled: FloatArray,
    places: IntArray,
    rate: FloatArray,
    tendons: IntArray,
    count: int,
    length: float,
    length_rates: FloatArray,
) -> None:
    """Writes the arc-length derivative of variations of rotation and moment, body components, a column each.

    With (dv, du) = H^-1 (n x phi - t, mu + m x phi - r x t): phi' = du, mu' = n x (phi x v + dv). Both derivatives are
    those of the world-frame vectors, expressed in the body frame.

    Args:
        columns: Number of columns.
        load: Shape (6,).
        strain: Shape (6,).
        inverse: H^-1, shape (6, 6).
        angle: phi, variation of the rotation, shape (3, c).
        moment: mu, variation of the moment across the cut, shape (3, c).
        pulled: From `pull_directions`, shape (t, 7); read for the columns of tensions, from the fourth on.
        places: Row of each tendon in it, -1 for none, shape (t,).
        rate: Shape (6, c), phi' over mu'; written.
        tendons: Tendon of each row of `pulled`.
        count: Number of rows of `pulled`.
        length: Length over which the derivatives of path lengths are added to `length_rates`, m; 0 for none.
        length_rates: Shape (t, c), or (0, c) for none.
    """
    nx, ny, nz, mx, my, mz = load[0], load[1], load[2], load[3], load[4], load[5]
    vx, vy, vz = strain[0], strain[1], strain[2]
    for c in range(columns):
        px, py, pz = angle[0, c], angle[1, c], angle[2, c]
        f0, f1, f2 = ny * pz - nz * py, nz * px - nx * pz, nx * py - ny * px
        f3 = moment[0, c] + my * pz - mz * py
        f4 = moment[1, c] + mz * px - mx * pz
        f5 = moment[2, c] + mx * py - my * px
        if columns > 3 and c >= 3 and places[c - 3] >= 0:
            row = places[c - 3]
            gain = pulled[row, 6]
            f0, f1, f2 = f0 - gain * pulled[row, 0], f1 - gain * pulled[row, 1], f2 - gain * pulled[row, 2]
            f3, f4, f5 = f3 - gain * pulled[row, 3], f4 - gain * pulled[row, 4], f5 - gain * pulled[row, 5]
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
        sx, sy, sz = (
            inverse[0, 0] * f0 + inverse[0, 1] * f1 + inverse[0, 2] * f2
            + inverse[0, 3] * f3 + inverse[0, 4] * f4 + inverse[0, 5] * f5,
            inverse[1, 0] * f0 + inverse[1, 1] * f1 + inverse[1, 2] * f2
            + inverse[1, 3] * f3 + inverse[1, 4] * f4 + inverse[1, 5] * f5,
            inverse[2, 0] * f0 + inverse[2, 1] * f1 + inverse[2, 2] * f2
            + inverse[2, 3] * f3 + inverse[2, 4] * f4 + inverse[2, 5] * f5,
        )  # fmt: skip
        if columns > 3 and length > 0.0 and length_rates.shape[0] > 0:
            for row in range(count):
                length_rates[tendons[row], c] += length * (
                    pulled[row, 0] * sx + pulled[row, 1] * sy + pulled[row, 2] * sz
                    + pulled[row, 3] * rate[0, c] + pulled[row, 4] * rate[1, c] + pulled[row, 5] * rate[2, c]
                )  # fmt: skip
        ex, ey, ez = sx + py * vz - pz * vy, sy + pz * vx - px * vz, sz + px * vy - py * vx
        rate[3, c] = ny * ez - nz * ey
        rate[4, c] = nz * ex - nx * ez
        rate[5, c] = nx * ey - ny * ex
