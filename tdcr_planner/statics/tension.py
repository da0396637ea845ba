"""The tension along each tendon: constant without friction, by Coulomb's law with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.chord import chord_path
from tdcr_planner.statics.options import INLINED, OPTIONS
from tdcr_planner.statics.rod import RodArrays


class TendonTension(NamedTuple):
    """Tensions at the stage points of each step, and what they follow from where tendons rub.

    Without friction the arrays after `base` are empty, and so is `weights`.

    Attributes:
        pulls: Tension at each stage point, shape (c, 3, t), N, columns as in `RodArrays.tendons`.
        weights: Derivative of `pulls` by the tendon's tension at the base, shape (c, 3, t).
        base: Tension of each tendon at the base, shape (t,), N.
        earlier: What `pulls` was before, shape (c, 3, t), N.
        angles: Angle that a tendon turns through where the step starts, from there to its middle, and from there to
            its end, shape (c, 3, t), rad. The first one of a tendon is that of its way from the drive to the base.
        running: Tension at the end of the steps so far, its derivative by that at the base, and the largest change of
            an angle times the friction coefficient, shape (3, t).
        friction: Friction coefficient of each tendon, shape (t,).
        tangents: Direction of each tendon at the stage points, body frame, shape (c, 3, t, 3).
        curvatures: u at the stage points, shape (c, 3, 3), 1/m.
        sheaths: Angle of each tendon's way from drive to base, shape (t,), rad.
        loose: Whether the derivative takes tendons that stick for sliding ones, shape (1,).
        last: Step and column at which each tendon ran before, -1 for none, shape (2, t).
    """

    pulls: FloatArray
    weights: FloatArray
    base: FloatArray
    earlier: FloatArray
    angles: FloatArray
    running: FloatArray
    friction: FloatArray
    tangents: FloatArray
    curvatures: FloatArray
    sheaths: FloatArray
    loose: BoolArray
    last: IntArray


@njit(**OPTIONS)
def frictionless_tension(rod: RodArrays) -> TendonTension:
    """Returns room for the tensions of one case without friction."""
    steps, total = rod.tendons.shape
    none = np.empty((0, 3, total))
    return TendonTension(
        np.zeros((steps, 3, total)),
        none,
        np.zeros(total),
        none,
        none,
        np.empty((0, total)),
        np.empty(0),
        np.empty((0, 3, total, 3)),
        np.empty((0, 3, 3)),
        np.empty(0),
        np.empty(0, dtype=np.bool_),
        np.empty((2, 0), dtype=np.int64),
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


@njit(**OPTIONS)
def fill_pulls(rod: RodArrays, tensions: FloatArray, pulls: FloatArray, case: int, tension: TendonTension) -> None:
    """Writes the tensions along a case's tendons: its row of `pulls`, or the same all along where it is empty."""
    fill_tension(rod, tensions, tension)
    if pulls.shape[0] > 0:
        tension.pulls[:] = pulls[case]


@njit(**OPTIONS)
def rubbing_tension(rod: RodArrays, friction: FloatArray, sheath_angles: FloatArray) -> TendonTension:
    """Returns room for the tensions of one case with friction; before it no tendon has pulled or turned.

    Args:
        rod: RodArrays.
        friction: Friction coefficient of each tendon, shape (t,).
        sheath_angles: Angle of each tendon's way from drive to base, shape (t,), rad.
    """
    steps, total = rod.tendons.shape
    shape = (steps, 3, total)
    return TendonTension(
        np.zeros(shape), np.ones(shape), np.zeros(total), np.zeros(shape), np.zeros(shape), np.zeros((3, total)),
        friction.copy(), np.zeros((steps, 3, total, 3)), np.zeros((steps, 3, 3)), sheath_angles,
        np.zeros(1, dtype=np.bool_), np.empty((2, total), dtype=np.int64),
    )  # fmt: skip


@njit(**INLINED)
def slid(value: float, gain: float, before: float, factor: float, loose: bool) -> tuple[float, float]:
    """Returns the tension behind an angle, and its derivative by that at the base, from those before the angle.

    Over an angle a the tension can change by factors from exp(-mu a) to exp(mu a) (Euler and Eytelwein's capstan). A
    tendon keeps the tension that it had where that lies between, since it sticks there, and slides to the nearer bound
    where it does not.

    Args:
        value: Tension before the angle, N.
        gain: Its derivative by that at the base.
        before: What the tendon had behind the angle, N.
        factor: exp(mu a).
        loose: Whether the derivative is that of sliding where it sticks.
    """
    if before * factor <= value:
        return value / factor, gain / factor
    if before >= value * factor:
        return value * factor, gain * factor
    return before, gain if loose else 0.0


@njit(**OPTIONS)
def start_sliding(tension: TendonTension) -> None:
    """Sets the tensions to what they are at the drive."""
    for i in range(tension.base.shape[0]):
        tension.running[0, i], tension.running[1, i], tension.running[2, i] = tension.base[i], 1.0, 0.0
        tension.last[0, i] = tension.last[1, i] = -1


@njit(**OPTIONS)
def slide(rod: RodArrays, tension: TendonTension, c: int) -> None:
    """Writes the tensions of a step from those at its start, with the angles that the step had before."""
    for column in range(rod.tendon_counts[c]):
        i = rod.tendons[c, column]
        value, gain, friction = tension.running[0, i], tension.running[1, i], tension.friction[i]
        for point in range(3):
            factor = np.exp(friction * tension.angles[c, point, column])
            value, gain = slid(value, gain, tension.earlier[c, point, column], factor, tension.loose[0])
            tension.pulls[c, point, column], tension.weights[c, point, column] = value, gain


@njit(**OPTIONS)
def write_tangents(rod: RodArrays, tension: TendonTension, c: int, point: int, strain: FloatArray) -> None:
    """Writes the direction of each tendon at a stage point, body frame, and the curvature there."""
    vx, vy, vz, ux, uy, uz = strain[0], strain[1], strain[2], strain[3], strain[4], strain[5]
    half, along = rod.chords[c, point, 0], rod.chords[c, point, 1]
    tension.curvatures[c, point, 0], tension.curvatures[c, point, 1], tension.curvatures[c, point, 2] = ux, uy, uz
    for column in range(rod.tendon_counts[c]):
        x, y, dx, dy = chord_path(half, along, rod.offsets[c, point, column], rod.slopes[c, point, column], strain)
        wx, wy, wz = vx - uz * y + dx, vy + uz * x + dy, vz + ux * y - uy * x
        scale = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
        tension.tangents[c, point, column, 0] = scale * wx
        tension.tangents[c, point, column, 1] = scale * wy
        tension.tangents[c, point, column, 2] = scale * wz


@njit(**OPTIONS)
def angle_between(a: FloatArray, b: FloatArray) -> float:
    """Returns the angle between two unit vectors, rad."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return np.arctan2(np.sqrt(x * x + y * y + z * z), a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(**INLINED)
def turning_rate(
    tangents: FloatArray, t: FloatArray, u: FloatArray, first: float, second: float, third: float
) -> float:
    """Returns the curvature |t' + u x t| of a tendon's path; t' by given weights of the step's three tangents."""
    x = first * tangents[0, 0] + second * tangents[1, 0] + third * tangents[2, 0] + u[1] * t[2] - u[2] * t[1]
    y = first * tangents[0, 1] + second * tangents[1, 1] + third * tangents[2, 1] + u[2] * t[0] - u[0] * t[2]
    z = first * tangents[0, 2] + second * tangents[1, 2] + third * tangents[2, 2] + u[0] * t[1] - u[1] * t[0]
    return np.sqrt(x * x + y * y + z * z)


@njit(**OPTIONS)
def turn(rod: RodArrays, tension: TendonTension, c: int) -> None:
    """Writes the angles of a step from the tendons' directions in it, and the tensions at its end by them.

    Within the step the curvature of a tendon's path is taken for a parabola. A tendon that runs straight between disks
    turns at the disks.
    """
    straight, h = rod.chords[c, 0, 0] > 0.0, rod.step_lengths[c]
    at_disk = straight and rod.chords[c, 0, 1] < -(1.0 - 1e-9) * rod.chords[c, 0, 0]
    for column in range(rod.tendon_counts[c]):
        i = rod.tendons[c, column]
        tangents, u = tension.tangents[c, :, column], tension.curvatures[c]
        jump, first, second = 0.0, 0.0, 0.0
        if tension.last[0, i] < 0:
            jump = tension.sheaths[i]
        elif at_disk or (rod.joins[c] and not straight):
            jump = angle_between(tension.tangents[tension.last[0, i], 2, tension.last[1, i]], tangents[0])
        if not straight:
            a = turning_rate(tangents, tangents[0], u[0], -3.0 / h, 4.0 / h, -1.0 / h)
            b = turning_rate(tangents, tangents[1], u[1], -1.0 / h, 0.0, 1.0 / h)
            e = turning_rate(tangents, tangents[2], u[2], 1.0 / h, -4.0 / h, 3.0 / h)
            first = max(0.0, h / 24.0 * (5.0 * a + 8.0 * b - e))
            second = max(0.0, h / 24.0 * (5.0 * e + 8.0 * b - a))
        value, gain, friction = tension.running[0, i], tension.running[1, i], tension.friction[i]
        for point in range(3):
            angle = jump if point == 0 else (first if point == 1 else second)
            change = friction * abs(angle - tension.angles[c, point, column])
            tension.running[2, i] = max(tension.running[2, i], change)
            tension.angles[c, point, column] = angle
            factor = np.exp(friction * angle)
            value, gain = slid(value, gain, tension.earlier[c, point, column], factor, tension.loose[0])
        tension.running[0, i], tension.running[1, i] = value, gain
        tension.last[0, i], tension.last[1, i] = c, column
