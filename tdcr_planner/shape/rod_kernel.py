"""The cut form of the rod's equilibrium as compiled code: from the base moment to the shape, many shapes at once."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.robot import RobotSpec

EIGHT, SIXTEEN = (None,) * 8, (None,) * 16
"""How many shapes are integrated side by side, so that the compiler can use vector instructions.

The length of a tuple is a constant to the compiler: each length makes its own machine code from one source.
"""

_TENDONS_AT_ONCE = 3

FAST_MATH = {"contract", "reassoc", "nsz", "arcp"}

# Rows of the work array; each row holds one number of each lane.
_M, _N, _G = 0, 3, 6  # moment, force and gravity at the cut, body frame
STATE = 9  # the nine numbers above at the start of the gap
_SLOPE = 18  # their Runge-Kutta slope
_U, _V = 27, 30  # strains at the stage: curvature, linear strain
_TX, _TY, _TZ = 33, 34, 35  # sums over the tendons of tension times x, y and 1 times the tangent's z component
_SUMS = 36  # the same three from the present strains, then the twisting stiffness and the shears in x and y
_P, _R = 42, 45  # position and rotation of the cut, base frame
_FIRST, _MIDDLE, _LAST = 54, 60, 66  # strains at the start, the middle and the end of the gap
_TOTAL = 72  # weighted sum of the slopes
_THREE = 81  # tensions of the three tendons at hand
_TENSION = 84  # tensions, one row a tendon
WORK_ROWS = _TENSION

SETTLING = 3  # sweeps that settle the tendon sums: each shrinks their error by about (u_z r)^2, 1e-3 or less
_DIFFERENCE = 1e-7  # N m


@dataclass(frozen=True)
class RodConstants:
    """What the kernel needs to know of a robot.

    Attributes:
        gaps: Shape (d - 1, 12): gap length, EI, EI, GJ, GA, GA, EA, rest curvature (3), backbone mass per length,
            mass of the disk at the gap's end (payload included).
        first_tendon: Shape (d - 1,): index of the first tendon that is still present in the gap.
        offsets: Tendon offsets x, y, shape (t padded to a multiple of three, 2), m.
        base_mass: Mass of everything beyond the base, kg.
        tendon_count: Number of tendons t.
    """

    gaps: FloatArray
    first_tendon: IntArray
    offsets: FloatArray
    base_mass: float
    tendon_count: int


def rod_constants(robot: RobotSpec, bending_scale: float = 1.0, torsion_scale: float = 1.0) -> RodConstants:
    """Returns the kernel's constants of a robot.

    Args:
        robot: The robot.
        bending_scale: Factor on the bending stiffness EI (identified from measurements; 1 for the robot file's).
        torsion_scale: Factor on the torsional stiffness GJ.
    """
    rows, first = [], []
    disk = 0
    for index, (segment, backbone) in enumerate(zip(robot.segments, robot.segment_backbones, strict=True)):
        bending = np.array(backbone.stiffness_bending_torsion) * [bending_scale, bending_scale, torsion_scale]
        for _ in range(segment.disks):
            disk += 1
            mass = robot.disk_masses[disk] + (robot.tip.mass_kg if disk == robot.disk_count - 1 else 0.0)
            rows.append(
                [
                    segment.length_m / segment.disks,
                    *bending,
                    *backbone.stiffness_shear_extension,
                    *backbone.rest_curvature_1_m,
                    backbone.weight_per_length_kg_m,
                    mass,
                ]
            )
            first.append(int(np.argmax(robot.tendon_segments >= index)))
    gaps = np.array(rows)
    padded = -(-robot.tendon_count // _TENDONS_AT_ONCE) * _TENDONS_AT_ONCE
    offsets = np.zeros((padded, 2))
    offsets[: robot.tendon_count] = robot.tendon_offsets[:, :2]
    base_mass = float((gaps[:, 0] * gaps[:, 10] + gaps[:, 11]).sum())
    return RodConstants(gaps, np.array(first, dtype=np.int64), offsets, base_mass, robot.tendon_count)


def rod_constants_at(robot: RobotSpec, arc_lengths: FloatArray) -> tuple[RodConstants, IntArray]:
    """Returns constants whose gaps also end at given arc lengths, and the columns of their poses.

    Args:
        robot: The robot.
        arc_lengths: Shape (k,), m, increasing, from 0 to the robot's length.

    Returns:
        The constants, and for each arc length the index of its pose among all stops, shape (k,).
    """
    whole = rod_constants(robot)
    ends = robot.arc_lengths
    # A stop within rounding of a disk is that disk.
    near = np.abs(arc_lengths[:, None] - ends[None, :]) <= 1e-9 * robot.length
    extra = arc_lengths[~near.any(axis=1)]
    stops = np.sort(np.concatenate([ends, extra]))
    owner = np.clip(np.searchsorted(ends, stops[1:], side="left") - 1, 0, len(whole.gaps) - 1)
    gaps = whole.gaps[owner]
    gaps[:, 0] = np.diff(stops)
    gaps[~np.isin(stops[1:], ends), 11] = 0.0
    columns = np.abs(stops[None, :] - arc_lengths[:, None]).argmin(axis=1)
    constants = RodConstants(gaps, whole.first_tendon[owner], whole.offsets, whole.base_mass, whole.tendon_count)
    return constants, columns


@numba.njit(fastmath=FAST_MATH, cache=True, error_model="numpy", boundscheck=False)
def _sum_tendons(work, offsets, first, side_by_side):  # type: ignore[no-untyped-def]
    """Sums over the tendons present, whose tangents are (v + u x r) / |v + u x r|."""
    lanes = len(side_by_side)
    for lane in range(_SUMS * lanes, (_SUMS + 6) * lanes):
        work[lane] = 0.0
    for block in range(first // _TENDONS_AT_ONCE, len(offsets) // _TENDONS_AT_ONCE):
        tendon = block * _TENDONS_AT_ONCE
        x0, y0 = offsets[tendon, 0], offsets[tendon, 1]
        x1, y1 = offsets[tendon + 1, 0], offsets[tendon + 1, 1]
        x2, y2 = offsets[tendon + 2, 0], offsets[tendon + 2, 1]
        w0 = 1.0 if tendon >= first else 0.0
        w1 = 1.0 if tendon + 1 >= first else 0.0
        w2 = 1.0 if tendon + 2 >= first else 0.0
        q0, q1, q2 = x0 * x0 + y0 * y0, x1 * x1 + y1 * y1, x2 * x2 + y2 * y2
        # Copied to fixed rows: the compiler must see that they do not overlap with what is written.
        for lane in range(3 * lanes):
            work[_THREE * lanes + lane] = work[(_TENSION + tendon) * lanes + lane]
        for lane in range(lanes):
            ux, uy = work[_U * lanes + lane], work[(_U + 1) * lanes + lane]
            uz, vz = work[(_U + 2) * lanes + lane], work[(_V + 2) * lanes + lane]
            zz = uz * uz
            a0, a1, a2 = vz + ux * y0 - uy * x0, vz + ux * y1 - uy * x1, vz + ux * y2 - uy * x2
            c0 = w0 * work[_THREE * lanes + lane] / np.sqrt(a0 * a0 + zz * q0)
            c1 = w1 * work[(_THREE + 1) * lanes + lane] / np.sqrt(a1 * a1 + zz * q1)
            c2 = w2 * work[(_THREE + 2) * lanes + lane] / np.sqrt(a2 * a2 + zz * q2)
            work[_SUMS * lanes + lane] += x0 * a0 * c0 + x1 * a1 * c1 + x2 * a2 * c2
            work[(_SUMS + 1) * lanes + lane] += y0 * a0 * c0 + y1 * a1 * c1 + y2 * a2 * c2
            work[(_SUMS + 2) * lanes + lane] += a0 * c0 + a1 * c1 + a2 * c2
            work[(_SUMS + 3) * lanes + lane] += q0 * c0 + q1 * c1 + q2 * c2
            work[(_SUMS + 4) * lanes + lane] += x0 * c0 + x1 * c1 + x2 * c2
            work[(_SUMS + 5) * lanes + lane] += y0 * c0 + y1 * c1 + y2 * c2


@numba.njit(fastmath=FAST_MATH, cache=True, error_model="numpy", boundscheck=False)
def _stage(work, gap, offsets, first, stage, side_by_side):  # type: ignore[no-untyped-def]
    """One of the four Runge-Kutta stages of a gap: the state there, its strains, and its slope summed.

    Stages below zero only settle the sums over the tendons. The middle's strains are the mean of its two stages.
    """
    lanes = len(side_by_side)
    EI, GJ, GA, EA = gap[1], gap[3], gap[4], gap[6]
    rx, ry, rz, line_mass = gap[7], gap[8], gap[9], gap[10]
    GJ_rz = GJ * rz
    step = 0.0 if stage <= 0 else (gap[0] if stage == 3 else 0.5 * gap[0])
    for i in range(9 * lanes):
        work[i] = work[STATE * lanes + i] + step * work[_SLOPE * lanes + i]
    for lane in range(lanes):
        work[_U * lanes + lane] = rx + (work[_M * lanes + lane] - work[_TY * lanes + lane]) / EI
        work[(_U + 1) * lanes + lane] = ry + (work[(_M + 1) * lanes + lane] + work[_TX * lanes + lane]) / EI
        work[(_V + 2) * lanes + lane] = 1.0 + (work[(_N + 2) * lanes + lane] - work[_TZ * lanes + lane]) / EA
    _sum_tendons(work, offsets, first, side_by_side)
    for lane in range(lanes):
        mx, my, mz = work[_M * lanes + lane], work[(_M + 1) * lanes + lane], work[(_M + 2) * lanes + lane]
        nx, ny, nz = work[_N * lanes + lane], work[(_N + 1) * lanes + lane], work[(_N + 2) * lanes + lane]
        gx, gy, gz = work[_G * lanes + lane], work[(_G + 1) * lanes + lane], work[(_G + 2) * lanes + lane]
        tx, ty, tz = work[_SUMS * lanes + lane], work[(_SUMS + 1) * lanes + lane], work[(_SUMS + 2) * lanes + lane]
        s4, s5 = work[(_SUMS + 4) * lanes + lane], work[(_SUMS + 5) * lanes + lane]
        vx, vy = work[_V * lanes + lane], work[(_V + 1) * lanes + lane]
        uz = (mz + GJ_rz - vy * s4 + vx * s5) / (GJ + work[(_SUMS + 3) * lanes + lane])
        ux, uy = rx + (mx - ty) / EI, ry + (my + tx) / EI
        vx, vy, vz = (nx + uz * s5) / (GA + tz), (ny - uz * s4) / (GA + tz), 1.0 + (nz - tz) / EA
        work[_TX * lanes + lane] = tx
        work[_TY * lanes + lane] = ty
        work[_TZ * lanes + lane] = tz
        work[_U * lanes + lane] = ux
        work[(_U + 1) * lanes + lane] = uy
        work[(_U + 2) * lanes + lane] = uz
        work[_V * lanes + lane] = vx
        work[(_V + 1) * lanes + lane] = vy
        work[(_V + 2) * lanes + lane] = vz
        # m' = m x u + n x v, n' = n x u - rho A g, g' = g x u: the cut form in the body frame.
        work[_SLOPE * lanes + lane] = my * uz - mz * uy + ny * vz - nz * vy
        work[(_SLOPE + 1) * lanes + lane] = mz * ux - mx * uz + nz * vx - nx * vz
        work[(_SLOPE + 2) * lanes + lane] = mx * uy - my * ux + nx * vy - ny * vx
        work[(_SLOPE + 3) * lanes + lane] = ny * uz - nz * uy - line_mass * gx
        work[(_SLOPE + 4) * lanes + lane] = nz * ux - nx * uz - line_mass * gy
        work[(_SLOPE + 5) * lanes + lane] = nx * uy - ny * ux - line_mass * gz
        work[(_SLOPE + 6) * lanes + lane] = gy * uz - gz * uy
        work[(_SLOPE + 7) * lanes + lane] = gz * ux - gx * uz
        work[(_SLOPE + 8) * lanes + lane] = gx * uy - gy * ux
    if stage < 0:
        return
    weight = gap[0] / (6.0 if stage == 0 or stage == 3 else 3.0)
    for i in range(9 * lanes):
        work[_TOTAL * lanes + i] += weight * work[_SLOPE * lanes + i]
    if stage == 0:
        for i in range(6 * lanes):
            work[_FIRST * lanes + i] = work[_U * lanes + i]
    elif stage == 3:
        for i in range(6 * lanes):
            work[_LAST * lanes + i] = work[_U * lanes + i]
    else:
        for i in range(6 * lanes):
            work[_MIDDLE * lanes + i] += 0.5 * work[_U * lanes + i]


@numba.njit(fastmath=FAST_MATH, cache=True, error_model="numpy", boundscheck=False)
def _advance_pose(work, length, side_by_side):  # type: ignore[no-untyped-def]
    """Moves the pose over one gap: fourth-order Magnus step on SE(3) with the strains at start, middle and end.

    Ω = h/6 (ξ0 + 4 ξm + ξ1) + h²/12 [ξ0, ξ1] for R' = R [u]x (Iserles et al. 2000), then the closed-form exponential,
    its trigonometric factors as series that end below 1e-16 for |Ω| < 0.5.
    """
    lanes = len(side_by_side)
    h6, h12 = length / 6.0, length * length / 12.0
    for lane in range(lanes):
        ax, ay, az = work[_FIRST * lanes + lane], work[(_FIRST + 1) * lanes + lane], work[(_FIRST + 2) * lanes + lane]
        bx, by, bz = work[_LAST * lanes + lane], work[(_LAST + 1) * lanes + lane], work[(_LAST + 2) * lanes + lane]
        mx, my, mz = (
            work[_MIDDLE * lanes + lane],
            work[(_MIDDLE + 1) * lanes + lane],
            work[(_MIDDLE + 2) * lanes + lane],
        )
        cx, cy, cz = (
            work[(_FIRST + 3) * lanes + lane],
            work[(_FIRST + 4) * lanes + lane],
            work[(_FIRST + 5) * lanes + lane],
        )
        dx, dy, dz = (
            work[(_LAST + 3) * lanes + lane],
            work[(_LAST + 4) * lanes + lane],
            work[(_LAST + 5) * lanes + lane],
        )
        wx = h6 * (ax + 4.0 * mx + bx) + h12 * (ay * bz - az * by)
        wy = h6 * (ay + 4.0 * my + by) + h12 * (az * bx - ax * bz)
        wz = h6 * (az + 4.0 * mz + bz) + h12 * (ax * by - ay * bx)
        px = h6 * (cx + 4.0 * work[(_MIDDLE + 3) * lanes + lane] + dx) + h12 * (ay * dz - az * dy + cy * bz - cz * by)
        py = h6 * (cy + 4.0 * work[(_MIDDLE + 4) * lanes + lane] + dy) + h12 * (az * dx - ax * dz + cz * bx - cx * bz)
        pz = h6 * (cz + 4.0 * work[(_MIDDLE + 5) * lanes + lane] + dz) + h12 * (ax * dy - ay * dx + cx * by - cy * bx)
        t = wx * wx + wy * wy + wz * wz
        s1 = 1.0 - t / 6.0 * (1.0 - t / 20.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0))))
        s2 = 0.5 - t / 24.0 * (1.0 - t / 30.0 * (1.0 - t / 56.0 * (1.0 - t / 90.0 * (1.0 - t / 132.0))))
        s3 = 1.0 / 6.0 - t / 120.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0 * (1.0 - t / 156.0))))
        # chord = (I + s2 [w]x + s3 [w]x^2) p
        ex, ey, ez = wy * pz - wz * py, wz * px - wx * pz, wx * py - wy * px
        qx = px + s2 * ex + s3 * (wy * ez - wz * ey)
        qy = py + s2 * ey + s3 * (wz * ex - wx * ez)
        qz = pz + s2 * ez + s3 * (wx * ey - wy * ex)
        e00, e11, e22 = 1.0 - s2 * (wy * wy + wz * wz), 1.0 - s2 * (wx * wx + wz * wz), 1.0 - s2 * (wx * wx + wy * wy)
        e01, e10 = s2 * wx * wy - s1 * wz, s2 * wx * wy + s1 * wz
        e02, e20 = s2 * wx * wz + s1 * wy, s2 * wx * wz - s1 * wy
        e12, e21 = s2 * wy * wz - s1 * wx, s2 * wy * wz + s1 * wx
        for row in range(3):
            r0 = work[(_R + 3 * row) * lanes + lane]
            r1 = work[(_R + 3 * row + 1) * lanes + lane]
            r2 = work[(_R + 3 * row + 2) * lanes + lane]
            work[(_P + row) * lanes + lane] += r0 * qx + r1 * qy + r2 * qz
            work[(_R + 3 * row) * lanes + lane] = r0 * e00 + r1 * e10 + r2 * e20
            work[(_R + 3 * row + 1) * lanes + lane] = r0 * e01 + r1 * e11 + r2 * e21
            work[(_R + 3 * row + 2) * lanes + lane] = r0 * e02 + r1 * e12 + r2 * e22


@numba.njit(fastmath=FAST_MATH, cache=True, error_model="numpy", boundscheck=False)
def shoot(work, gaps, first_tendon, offsets, with_poses, positions, rotations, start, count, side_by_side):  # type: ignore[no-untyped-def]
    """Integrates the cases that `load` put into the lanes from the base to the tip.

    The moment that is left over at the tip is then in the first three rows of `work` from row `STATE`. Poses of cases
    start ... start + count are written if `with_poses`.
    """
    lanes = len(side_by_side)
    for lane in range(_SLOPE * lanes, _FIRST * lanes):
        work[lane] = 0.0
    for lane in range(lanes):
        work[(_V + 2) * lanes + lane] = 1.0
        work[_R * lanes + lane] = 1.0
        work[(_R + 4) * lanes + lane] = 1.0
        work[(_R + 8) * lanes + lane] = 1.0
    if with_poses:
        for lane in range(count):
            for row in range(3):
                positions[start + lane, 0, row] = 0.0
                for column in range(3):
                    rotations[start + lane, 0, row, column] = 1.0 if row == column else 0.0
    for k in range(len(gaps)):
        gap = gaps[k]
        first = first_tendon[k]
        for lane in range(_MIDDLE * lanes, (_TOTAL + 9) * lanes):
            work[lane] = 0.0
        # The tendon sums are carried from stage to stage; where tendons have ended there is none to carry.
        fresh = k == 0 or first != first_tendon[k - 1]
        for stage in range(-SETTLING if fresh else 0, 4):
            _stage(work, gap, offsets, first, stage, side_by_side)
        for i in range(9 * lanes):
            work[STATE * lanes + i] += work[_TOTAL * lanes + i]
        for i in range(3 * lanes):
            work[(STATE + _N) * lanes + i] -= gap[11] * work[(STATE + _G) * lanes + i]
        if with_poses:
            _advance_pose(work, gap[0], side_by_side)
            for lane in range(count):
                for row in range(3):
                    positions[start + lane, k + 1, row] = work[(_P + row) * lanes + lane]
                for row in range(9):
                    rotations[start + lane, k + 1, row // 3, row % 3] = work[(_R + row) * lanes + lane]


@numba.njit(fastmath=FAST_MATH, cache=True, error_model="numpy", boundscheck=False)
def load(work, tensions, gravity, tip_force, base_moment, base_mass, start, count, side_by_side):  # type: ignore[no-untyped-def]
    """Puts cases start ... start + count into the lanes; lanes left over repeat the last."""
    lanes = len(side_by_side)
    for lane in range(lanes):
        case = start + min(lane, count - 1)
        for row in range(3):
            work[(STATE + _M + row) * lanes + lane] = base_moment[case, row]
            work[(STATE + _N + row) * lanes + lane] = tip_force[case, row] + base_mass * gravity[case, row]
            work[(STATE + _G + row) * lanes + lane] = gravity[case, row]
        for tendon in range(tensions.shape[1]):
            work[(_TENSION + tendon) * lanes + lane] = tensions[case, tendon]


@numba.njit(cache=True, error_model="numpy", boundscheck=False)
def _integrate(  # type: ignore[no-untyped-def]
    gaps,
    first_tendon,
    offsets,
    base_mass,
    tensions,
    gravity,
    tip_force,
    base_moment,
    positions,
    rotations,
    residual,
    side_by_side,
):
    lanes = len(side_by_side)
    work = np.zeros((WORK_ROWS + len(offsets)) * lanes)
    cases = len(tensions)
    for start in range(0, cases, lanes):
        count = min(lanes, cases - start)
        load(work, tensions, gravity, tip_force, base_moment, base_mass, start, count, side_by_side)
        shoot(work, gaps, first_tendon, offsets, len(positions) > 0, positions, rotations, start, count, side_by_side)
        for lane in range(count):
            for row in range(3):
                residual[start + lane, row] = work[(STATE + row) * lanes + lane]


def tip_residual(
    constants: RodConstants,
    tensions: FloatArray,
    gravity: FloatArray,
    tip_force: FloatArray,
    base_moment: FloatArray,
) -> FloatArray:
    """Returns the moment left over at the tip for given base moments, shape (n, 3), N m, tip frame.

    Zero where the base moment is that of an equilibrium: it is the residual of the cut form.

    Args:
        constants: The robot.
        tensions: Shape (n, t), N.
        gravity: Shape (n, 3), m/s^2, base frame.
        tip_force: Shape (n, 3), N, base frame.
        base_moment: Shape (n, 3), N m, base frame.
    """
    residual = np.empty((len(tensions), 3))
    no_positions, no_rotations = np.empty((0, 1, 3)), np.empty((0, 1, 3, 3))
    _integrate(
        *_arguments(constants), tensions, gravity, tip_force, base_moment, no_positions, no_rotations, residual, SIXTEEN
    )
    return residual


def tip_residual_jacobian(
    constants: RodConstants,
    tensions: FloatArray,
    gravity: FloatArray,
    tip_force: FloatArray,
    base_moment: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Returns `tip_residual`, shape (n, 3), and its derivative by the base moment, shape (n, 3, 3).

    The derivative is a forward difference: the step of 1e-7 N m leaves about six digits.
    """
    count = len(tensions)
    moments = np.tile(base_moment, (4, 1))
    for column in range(3):
        moments[(column + 1) * count : (column + 2) * count, column] += _DIFFERENCE
    residuals = tip_residual(
        constants, np.tile(tensions, (4, 1)), np.tile(gravity, (4, 1)), np.tile(tip_force, (4, 1)), moments
    ).reshape(4, count, 3)
    jacobian = np.stack([(residuals[column + 1] - residuals[0]) / _DIFFERENCE for column in range(3)], axis=2)
    return residuals[0], jacobian


def integrate_poses(
    constants: RodConstants,
    tensions: FloatArray,
    gravity: FloatArray,
    tip_force: FloatArray,
    base_moment: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns positions (n, d, 3) m, rotations (n, d, 3, 3) and the tip residual (n, 3); see `tip_residual`."""
    count, disks = len(tensions), len(constants.gaps) + 1
    positions, rotations = np.empty((count, disks, 3)), np.empty((count, disks, 3, 3))
    residual = np.empty((count, 3))
    _integrate(
        *_arguments(constants), tensions, gravity, tip_force, base_moment, positions, rotations, residual, SIXTEEN
    )
    return positions, rotations, residual


def _arguments(constants: RodConstants) -> tuple[FloatArray, IntArray, FloatArray, float]:
    return constants.gaps, constants.first_tendon, constants.offsets, constants.base_mass
