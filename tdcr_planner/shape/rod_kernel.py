"""The cut form of the rod's equilibrium as compiled code: from the base moment to the shape, many shapes at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.compiled import njit
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.rod import GapColumn, gap_table, rod_arrays

ONE, EIGHT = (None,), (None,) * 8
"""How many shapes are integrated side by side, so that the compiler can use vector instructions.

The length of a tuple is a constant to the compiler: each length makes its own machine code from one source. The number
of tendons is given in the same way, so that their sums are straight code and the loop over the lanes is the innermost.
"""

FAST_MATH = {"contract", "reassoc", "nsz", "arcp"}
COMPILED: dict[str, Any] = {"fastmath": FAST_MATH, "cache": True, "error_model": "numpy", "boundscheck": False}
_INLINE = COMPILED | {"forceinline": True}

# Rows of the work array; each row holds one number of each lane.
_MOMENT, _FORCE, _GRAVITY = 0, 3, 6  # at the cut, body frame
_SUMS = 9  # sums over the tendons of tension times x, y and 1 times the tangent's z component
_CARRIED = 12  # twist, and shear in x and y, at the last stage
_POSITION, _ROTATION = 15, 18  # pose of the cut, base frame
_TENDONS = 27  # tension and offsets x, y of each tendon

SETTLING = 3  # sweeps that settle the tendon sums: each shrinks their error by about (u_z r)^2, 1e-3 or less
_STRAIGHT = 8  # tendons that the compiler turns into straight code from one loop; with twelve it keeps the loop
_DIFFERENCE = 1e-7  # N m


@dataclass(frozen=True)
class RodConstants:
    """What the kernel needs to know of a robot.

    Attributes:
        gaps: A row from disk to disk, shape (d - 1, 12), columns as in `statics.rod.GapColumn`.
        first_tendon: Shape (d - 1,): index of the first tendon that is still present in the gap.
        offsets: Tendon offsets x, y, shape (t, 2), m.
        base_mass: Mass of everything beyond the base, kg.
    """

    gaps: FloatArray
    first_tendon: IntArray
    offsets: FloatArray
    base_mass: float

    @property
    def tendon_count(self) -> int:
        """Number of tendons t."""
        return len(self.offsets)

    @property
    def arguments(self) -> tuple[FloatArray, IntArray, FloatArray, float, tuple[None, ...]]:
        """What the compiled functions take of a robot: `gaps`, `first_tendon`, `offsets`, `base_mass`, `tendons`."""
        return self.gaps, self.first_tendon, self.offsets, self.base_mass, (None,) * self.tendon_count


def rod_constants(robot: RobotSpec, bending_scale: float = 1.0, torsion_scale: float = 1.0) -> RodConstants:
    """Returns the kernel's constants of a robot.

    Args:
        robot: The robot.
        bending_scale: Factor on the bending stiffness EI (identified from measurements; 1 for the robot file's).
        torsion_scale: Factor on the torsional stiffness GJ.
    """
    rod = rod_arrays(robot, 1)
    gaps = gap_table(rod)
    gaps[:, GapColumn.BENDING_X : GapColumn.BENDING_Y + 1] *= bending_scale
    gaps[:, GapColumn.TWIST] *= torsion_scale
    base_mass = float(
        (gaps[:, GapColumn.LENGTH] * gaps[:, GapColumn.MASS_PER_LENGTH] + gaps[:, GapColumn.DISK_MASS]).sum()
    )
    # Tendons stand in the order of the segments in which they end, so that those present are the last ones.
    first = rod.tendons.shape[1] - rod.tendon_counts
    return RodConstants(gaps, first, np.ascontiguousarray(robot.tendon_offsets[:, :2]), base_mass)


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
    gaps[:, GapColumn.LENGTH] = np.diff(stops)
    gaps[~np.isin(stops[1:], ends), GapColumn.DISK_MASS] = 0.0
    columns = np.abs(stops[None, :] - arc_lengths[:, None]).argmin(axis=1)
    constants = RodConstants(gaps, whole.first_tendon[owner], whole.offsets, whole.base_mass)
    return constants, columns


@njit(**_INLINE)
def _read(work, row, lane, lanes):  # type: ignore[no-untyped-def]
    return work[row * lanes + lane], work[(row + 1) * lanes + lane], work[(row + 2) * lanes + lane]


@njit(**_INLINE)
def _write(work, row, lane, lanes, a):  # type: ignore[no-untyped-def]
    work[row * lanes + lane] = a[0]
    work[(row + 1) * lanes + lane] = a[1]
    work[(row + 2) * lanes + lane] = a[2]


@njit(**_INLINE)
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**_INLINE)
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**_INLINE)
def _ahead(a, step, slope):  # type: ignore[no-untyped-def]
    return a[0] + step * slope[0], a[1] + step * slope[1], a[2] + step * slope[2]


@njit(**_INLINE)
def _section(gap):  # type: ignore[no-untyped-def]
    """1/EI, GJ, GA, 1/EA, rest curvature in x and y, and the moment that holds the rest twist."""
    return 1.0 / gap[1], gap[3], gap[4], 1.0 / gap[6], gap[7], gap[8], gap[3] * gap[9]


@njit(**_INLINE)
def _add_tendon(work, tendon, lane, lanes, ux, uy, vz, square, pulls):  # type: ignore[no-untyped-def]
    """Adds a tendon's tension, along its tangent, to the sums that the strains need."""
    tension, x, y = _read(work, _TENDONS + 3 * tendon, lane, lanes)
    q = x * x + y * y
    along = vz + ux * y - uy * x
    share = tension / np.sqrt(along * along + square * q)
    pull = share * along
    return (
        pulls[0] + x * pull,
        pulls[1] + y * pull,
        pulls[2] + pull,
        pulls[3] + q * share,
        pulls[4] + x * share,
        pulls[5] + y * share,
    )


@njit(**_INLINE)
def _strains(work, lane, lanes, tendons, section, m, n, sums, carried):  # type: ignore[no-untyped-def]
    """Curvature u and linear strain v at a cut, from its moment and force and from the sums at the stage before.

    Tendons pull along their tangents (v + u x r) / |v + u x r|. Their sums and what they need of u and v depend on each
    other; both are carried from stage to stage.
    """
    per_EI, GJ, GA, per_EA, rest_x, rest_y, rest_moment = section
    ux, uy = rest_x + (m[0] - sums[1]) * per_EI, rest_y + (m[1] + sums[0]) * per_EI
    uz, vx, vy = carried
    vz = 1.0 + (n[2] - sums[2]) * per_EA
    square = uz * uz
    pulls = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for tendon in range(min(len(tendons), _STRAIGHT)):
        pulls = _add_tendon(work, tendon, lane, lanes, ux, uy, vz, square, pulls)
    for tendon in range(_STRAIGHT, len(tendons)):
        pulls = _add_tendon(work, tendon, lane, lanes, ux, uy, vz, square, pulls)
    tx, ty, tz, twist, shear_x, shear_y = pulls
    uz = (m[2] + rest_moment - vy * shear_x + vx * shear_y) / (GJ + twist)
    u = (rest_x + (m[0] - ty) * per_EI, rest_y + (m[1] + tx) * per_EI, uz)
    per_shear = 1.0 / (GA + tz)
    v = ((n[0] + uz * shear_y) * per_shear, (n[1] - uz * shear_x) * per_shear, 1.0 + (n[2] - tz) * per_EA)
    return u, v, (tx, ty, tz), (uz, v[0], v[1])


@njit(**_INLINE)
def _slopes(m, n, g, u, v, line_mass):  # type: ignore[no-untyped-def]
    """The cut form in the body frame: m' = m x u + n x v, n' = n x u - rho A g, g' = g x u."""
    return _ahead(_cross(m, u), 1.0, _cross(n, v)), _ahead(_cross(n, u), -line_mass, g), _cross(g, u)


@njit(**_INLINE)
def _runge_kutta(a, h6, first, second, third, fourth):  # type: ignore[no-untyped-def]
    return (
        a[0] + h6 * (first[0] + 2.0 * (second[0] + third[0]) + fourth[0]),
        a[1] + h6 * (first[1] + 2.0 * (second[1] + third[1]) + fourth[1]),
        a[2] + h6 * (first[2] + 2.0 * (second[2] + third[2]) + fourth[2]),
    )


@njit(**_INLINE)
def _advance_pose(work, lane, lanes, length, u, v):  # type: ignore[no-untyped-def]
    """Moves the pose over one gap: fourth-order Magnus step on SE(3) with the strains at the four stages.

    Ω = h/6 (ξ0 + 4 ξm + ξ1) + h²/12 [ξ0, ξ1] for R' = R [u]x (Iserles et al. 2000), the middle's strains the mean of
    its two stages; then the closed-form exponential, its trigonometric factors as series that end below 1e-16 for
    |Ω| < 0.5.
    """
    h6, h12 = length / 6.0, length * length / 12.0
    zero = (0.0, 0.0, 0.0)
    w = _ahead(_runge_kutta(zero, h6, *u), h12, _cross(u[0], u[3]))
    p = _ahead(_runge_kutta(zero, h6, *v), h12, _ahead(_cross(u[0], v[3]), 1.0, _cross(v[0], u[3])))
    t = _dot(w, w)
    s1 = 1.0 - t / 6.0 * (1.0 - t / 20.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0))))
    s2 = 0.5 - t / 24.0 * (1.0 - t / 30.0 * (1.0 - t / 56.0 * (1.0 - t / 90.0 * (1.0 - t / 132.0))))
    s3 = 1.0 / 6.0 - t / 120.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0 * (1.0 - t / 156.0))))
    # chord = (I + s2 [w]x + s3 [w]x^2) p
    once = _cross(w, p)
    chord = _ahead(_ahead(p, s2, once), s3, _cross(w, once))
    x, y, z = w
    column_x = (1.0 - s2 * (y * y + z * z), s2 * x * y + s1 * z, s2 * x * z - s1 * y)
    column_y = (s2 * x * y - s1 * z, 1.0 - s2 * (x * x + z * z), s2 * y * z + s1 * x)
    column_z = (s2 * x * z + s1 * y, s2 * y * z - s1 * x, 1.0 - s2 * (x * x + y * y))
    r0 = _read(work, _ROTATION, lane, lanes)
    r1 = _read(work, _ROTATION + 3, lane, lanes)
    r2 = _read(work, _ROTATION + 6, lane, lanes)
    moved = (_dot(r0, chord), _dot(r1, chord), _dot(r2, chord))
    _write(work, _POSITION, lane, lanes, _ahead(_read(work, _POSITION, lane, lanes), 1.0, moved))
    _write(work, _ROTATION, lane, lanes, (_dot(r0, column_x), _dot(r0, column_y), _dot(r0, column_z)))
    _write(work, _ROTATION + 3, lane, lanes, (_dot(r1, column_x), _dot(r1, column_y), _dot(r1, column_z)))
    _write(work, _ROTATION + 6, lane, lanes, (_dot(r2, column_x), _dot(r2, column_y), _dot(r2, column_z)))


@njit(**_INLINE)
def _settle(work, gap, tendons, side_by_side):  # type: ignore[no-untyped-def]
    """Settles the sums over the tendons where there are none to carry: at the base, and where tendons have ended."""
    lanes = len(side_by_side)
    section = _section(gap)
    for _ in range(SETTLING):
        for lane in range(lanes):
            m, n = _read(work, _MOMENT, lane, lanes), _read(work, _FORCE, lane, lanes)
            sums, carried = _read(work, _SUMS, lane, lanes), _read(work, _CARRIED, lane, lanes)
            _, _, sums, carried = _strains(work, lane, lanes, tendons, section, m, n, sums, carried)
            _write(work, _SUMS, lane, lanes, sums)
            _write(work, _CARRIED, lane, lanes, carried)


@njit(**_INLINE)
def _cross_gap(work, gap, tendons, with_poses, side_by_side):  # type: ignore[no-untyped-def]
    """One Runge-Kutta step of the state, and one Magnus step of the pose if `with_poses`.

    All four stages stand in one loop over the lanes: between them nothing passes through memory.
    """
    lanes = len(side_by_side)
    section = _section(gap)
    h, line_mass, disk_mass = gap[0], gap[10], gap[11]
    half, h6 = 0.5 * h, h / 6.0
    for lane in range(lanes):
        m, n = _read(work, _MOMENT, lane, lanes), _read(work, _FORCE, lane, lanes)
        g = _read(work, _GRAVITY, lane, lanes)
        sums, carried = _read(work, _SUMS, lane, lanes), _read(work, _CARRIED, lane, lanes)
        u0, v0, sums, carried = _strains(work, lane, lanes, tendons, section, m, n, sums, carried)
        dm0, dn0, dg0 = _slopes(m, n, g, u0, v0, line_mass)
        m1, n1, g1 = _ahead(m, half, dm0), _ahead(n, half, dn0), _ahead(g, half, dg0)
        u1, v1, sums, carried = _strains(work, lane, lanes, tendons, section, m1, n1, sums, carried)
        dm1, dn1, dg1 = _slopes(m1, n1, g1, u1, v1, line_mass)
        m2, n2, g2 = _ahead(m, half, dm1), _ahead(n, half, dn1), _ahead(g, half, dg1)
        u2, v2, sums, carried = _strains(work, lane, lanes, tendons, section, m2, n2, sums, carried)
        dm2, dn2, dg2 = _slopes(m2, n2, g2, u2, v2, line_mass)
        m3, n3, g3 = _ahead(m, h, dm2), _ahead(n, h, dn2), _ahead(g, h, dg2)
        u3, v3, sums, carried = _strains(work, lane, lanes, tendons, section, m3, n3, sums, carried)
        dm3, dn3, dg3 = _slopes(m3, n3, g3, u3, v3, line_mass)
        gravity = _runge_kutta(g, h6, dg0, dg1, dg2, dg3)
        _write(work, _MOMENT, lane, lanes, _runge_kutta(m, h6, dm0, dm1, dm2, dm3))
        _write(work, _FORCE, lane, lanes, _ahead(_runge_kutta(n, h6, dn0, dn1, dn2, dn3), -disk_mass, gravity))
        _write(work, _GRAVITY, lane, lanes, gravity)
        _write(work, _SUMS, lane, lanes, sums)
        _write(work, _CARRIED, lane, lanes, carried)
        if with_poses:
            _advance_pose(work, lane, lanes, h, (u0, u1, u2, u3), (v0, v1, v2, v3))


@njit(**_INLINE)
def _load(work, offsets, base_mass, tensions, gravity, tip_force, base_moment, start, count, side_by_side):  # type: ignore[no-untyped-def]
    """Puts cases start ... start + count into the lanes; lanes left over repeat the last."""
    lanes = len(side_by_side)
    work[: _TENDONS * lanes] = 0.0
    for lane in range(lanes):
        case = start + min(lane, count - 1)
        for axis in range(3):
            work[(_MOMENT + axis) * lanes + lane] = base_moment[case, axis]
            work[(_FORCE + axis) * lanes + lane] = tip_force[case, axis] + base_mass * gravity[case, axis]
            work[(_GRAVITY + axis) * lanes + lane] = gravity[case, axis]
            work[(_ROTATION + 4 * axis) * lanes + lane] = 1.0
        for tendon in range(len(offsets)):
            values = (tensions[case, tendon], offsets[tendon, 0], offsets[tendon, 1])
            _write(work, _TENDONS + 3 * tendon, lane, lanes, values)


@njit(**_INLINE)
def _store(work, positions, rotations, start, count, disk, side_by_side):  # type: ignore[no-untyped-def]
    lanes = len(side_by_side)
    for lane in range(count):
        for row in range(3):
            positions[start + lane, disk, row] = work[(_POSITION + row) * lanes + lane]
            for column in range(3):
                rotations[start + lane, disk, row, column] = work[(_ROTATION + 3 * row + column) * lanes + lane]


@njit(**COMPILED)
def shoot(  # type: ignore[no-untyped-def]
    gaps,
    first_tendon,
    offsets,
    base_mass,
    tendons,
    tensions,
    gravity,
    tip_force,
    base_moment,
    with_poses,
    positions,
    rotations,
    residual,
    work,
    start,
    count,
    side_by_side,
):
    """Integrates cases start ... start + count from the base to the tip.

    Args:
        gaps: As in `RodConstants`; see its `arguments` for this and the next four.
        first_tendon: As in `RodConstants`.
        offsets: As in `RodConstants`.
        base_mass: As in `RodConstants`.
        tendons: A tuple as long as there are tendons.
        tensions: Shape (n, t), N.
        gravity: Shape (n, 3), m/s^2, base frame.
        tip_force: Shape (n, 3), N, base frame.
        base_moment: Shape (n, 3), N m, base frame.
        with_poses: Whether poses are asked for.
        positions: Output, shape (n, d, 3), m, base frame.
        rotations: Output, shape (n, d, 3, 3), base frame.
        residual: Output, shape (n, 3), N m, tip frame: the moment that is left over at the tip.
        work: Room for `work_size` numbers.
        start: First case.
        count: How many cases, at most as many as there are lanes.
        side_by_side: The lanes, `ONE` or `EIGHT`.
    """
    lanes = len(side_by_side)
    _load(work, offsets, base_mass, tensions, gravity, tip_force, base_moment, start, count, side_by_side)
    if with_poses:
        _store(work, positions, rotations, start, count, 0, side_by_side)
    for k in range(len(gaps)):
        first = first_tendon[k]
        if k == 0 or first != first_tendon[k - 1]:
            # A tendon that has ended pulls no more.
            for tendon in range(first):
                for lane in range(lanes):
                    work[(_TENDONS + 3 * tendon) * lanes + lane] = 0.0
            _settle(work, gaps[k], tendons, side_by_side)
        _cross_gap(work, gaps[k], tendons, with_poses, side_by_side)
        if with_poses:
            _store(work, positions, rotations, start, count, k + 1, side_by_side)
    for lane in range(count):
        for row in range(3):
            residual[start + lane, row] = work[(_MOMENT + row) * lanes + lane]


@njit(**COMPILED)
def work_size(tendon_count, side_by_side):  # type: ignore[no-untyped-def]
    """How many numbers `shoot` needs room for."""
    return (_TENDONS + 3 * tendon_count) * len(side_by_side)


@njit(**COMPILED)
def _integrate(  # type: ignore[no-untyped-def]
    gaps,
    first_tendon,
    offsets,
    base_mass,
    tendons,
    tensions,
    gravity,
    tip_force,
    base_moment,
    with_poses,
    positions,
    rotations,
    residual,
):
    cases, lanes = len(tensions), len(EIGHT)
    work = np.empty(work_size(len(offsets), EIGHT))
    for start in range(0, cases, lanes):
        shoot(
            gaps, first_tendon, offsets, base_mass, tendons, tensions, gravity, tip_force, base_moment,
            with_poses, positions, rotations, residual, work, start, min(lanes, cases - start), EIGHT,
        )  # fmt: skip


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
    none = np.empty((0, 1, 3)), np.empty((0, 1, 3, 3))
    _integrate(*constants.arguments, tensions, gravity, tip_force, base_moment, False, *none, residual)
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
    poses = positions, rotations
    _integrate(*constants.arguments, tensions, gravity, tip_force, base_moment, True, *poses, residual)
    return positions, rotations, residual
