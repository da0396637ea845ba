"""Compiled kernel of the unloaded robot: an arc a segment, elastic tendons that go slack, friction with history."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.compiled import njit

OPTIONS: dict[str, Any] = {"nogil": True, "cache": True, "error_model": "numpy"}

ITERATIONS = 60
TOLERANCE = 1e-11
LARGEST_BEND_STEP = 0.5
"""Largest change of a segment's bend in one iteration, rad: a chord's length is far from linear over a whole turn."""
LINE_STEPS = 12


class ArcArrays(NamedTuple):
    """What the kernel needs of a robot; m segments, t tendons.

    Attributes:
        lengths: Length of each segment, shape (m,), m.
        stiffness: EI and EA of each segment, shape (m, 2), N m^2 and N.
        gaps: Distance of the disks between which each tendon runs straight, 0 in channels, shape (t, m), m.
        ends: Index of the segment with which each tendon ends, shape (t,).
        offsets: x and y of each tendon from the backbone, shape (t, 2), m.
        spring: Stiffness of each tendon with its transmission, 0 with tension drive, shape (t,), N/m.
        friction: Exponent of the sheath, and coefficient along the robot, of each tendon, shape (t, 2).
        presliding: Displacement over which friction builds up, shape (1,), m.
    """

    lengths: FloatArray
    stiffness: FloatArray
    gaps: FloatArray
    ends: IntArray
    offsets: FloatArray
    spring: FloatArray
    friction: FloatArray
    presliding: FloatArray


class TendonState(NamedTuple):
    """What the tendons do in one state, each of shape (t,); `rows` of shape (t, 3 m).

    Attributes:
        change: Length along the robot less that along the straight one, m.
        slip: -1 where it slides inwards, 1 outwards, between where it sticks.
        at_base: Tension at the robot's base, N.
        rows: Derivative of `change` with respect to the bends.
    """

    change: FloatArray
    slip: FloatArray
    at_base: FloatArray
    rows: FloatArray


class Balance(NamedTuple):
    """Gradient, shape (3 m,), and Hessian of the energy."""

    gradient: FloatArray
    hessian: FloatArray


@njit(**{**OPTIONS, "cache": False})
def measure_tendons(robot: ArcArrays, x: FloatArray, before: TendonState, now: TendonState) -> None:
    """Writes lengths, slip and derivatives of all tendons at bends x into `now`."""
    for i in range(robot.ends.shape[0]):
        rx, ry = robot.offsets[i, 0], robot.offsets[i, 1]
        total = 0.0
        for j in range(robot.ends[i] + 1):
            bx, by, stretch = x[3 * j], x[3 * j + 1], x[3 * j + 2]
            square = robot.gaps[i, j] * robot.gaps[i, j] / 4.0
            u = (bx * bx + by * by) * square
            chord = 1.0 - u / 6.0 * (1.0 - u / 20.0 * (1.0 - u / 42.0))
            slope = (-1.0 / 6.0 + u / 60.0 * (1.0 - u / 28.0)) * 2.0 * square
            lever = 1.0 + stretch - bx * rx - by * ry
            length = robot.lengths[j]
            total += length * (lever * chord - 1.0)
            now.rows[i, 3 * j] = length * (lever * slope * bx - rx * chord)
            now.rows[i, 3 * j + 1] = length * (lever * slope * by - ry * chord)
            now.rows[i, 3 * j + 2] = length * chord
        now.change[i] = total
        moved = before.slip[i] + (total - before.change[i]) / robot.presliding[0]
        now.slip[i] = min(1.0, max(-1.0, moved))


@njit(**{**OPTIONS, "cache": False})
def balance_of(
    robot: ArcArrays, x: FloatArray, displacement: FloatArray, tension: FloatArray, now: TendonState, sums: Balance
) -> None:
    """Writes gradient and Hessian of the energy at bends x, and the tensions at the base."""
    gradient, hessian = sums
    gradient[:] = 0.0
    hessian[:, :] = 0.0
    for k in range(gradient.shape[0]):
        hessian[k, k] = robot.stiffness[k // 3, 1 if k % 3 == 2 else 0] * robot.lengths[k // 3]
        gradient[k] = hessian[k, k] * x[k]
    for i in range(robot.ends.shape[0]):
        pull = tension[i] + robot.spring[i] * (displacement[i] + now.change[i])
        if pull <= 0.0:
            now.at_base[i] = 0.0
            continue
        rx, ry, slip = robot.offsets[i, 0], robot.offsets[i, 1], now.slip[i]
        passed = robot.friction[i, 0]
        now.at_base[i] = pull * np.exp(passed * slip)
        for j in range(robot.ends[i] + 1):
            bx, by = x[3 * j], x[3 * j + 1]
            turn = robot.friction[i, 1] * np.sqrt(bx * bx + by * by) * robot.lengths[j]
            exponent = passed + 0.5 * turn
            passed += turn
            factor = np.exp(exponent * slip)
            stiffening = robot.spring[i] * factor
            if -1.0 < slip < 1.0:
                stiffening += pull * factor * exponent / robot.presliding[0]
            for a in range(3 * j, 3 * j + 3):
                gradient[a] += pull * factor * now.rows[i, a]
                for b in range(3 * (robot.ends[i] + 1)):
                    hessian[a, b] += stiffening * now.rows[i, a] * now.rows[i, b]
            square = robot.gaps[i, j] * robot.gaps[i, j] / 4.0
            slope = (-1.0 / 6.0 + (bx * bx + by * by) * square / 60.0) * 2.0 * square
            bent = pull * factor * robot.lengths[j] * slope
            lever = 1.0 + x[3 * j + 2] - bx * rx - by * ry
            hessian[3 * j, 3 * j] += bent * (lever - 2.0 * rx * bx)
            hessian[3 * j + 1, 3 * j + 1] += bent * (lever - 2.0 * ry * by)
            hessian[3 * j, 3 * j + 1] -= bent * (rx * by + ry * bx)
            hessian[3 * j + 1, 3 * j] -= bent * (rx * by + ry * bx)
            for axis in range(2):
                hessian[3 * j + axis, 3 * j + 2] += bent * x[3 * j + axis]
                hessian[3 * j + 2, 3 * j + axis] += bent * x[3 * j + axis]


@njit(**{**OPTIONS, "cache": False})
def search_direction(robot: ArcArrays, sums: Balance, step: FloatArray) -> tuple[float, float]:
    """Writes Newton's step, and returns its slope and the largest bend in it, rad.

    The Hessian of the arcs' chords may be indefinite far from equilibrium: steepest descent there.
    """
    step[:] = -np.linalg.solve(sums.hessian, sums.gradient)
    if step @ sums.gradient > 0.0:
        for k in range(step.shape[0]):
            step[k] = -sums.gradient[k] / (robot.stiffness[k // 3, 1 if k % 3 == 2 else 0] * robot.lengths[k // 3])
    largest = 0.0
    for k in range(step.shape[0]):
        if k % 3 != 2:
            largest = max(largest, abs(step[k]) * robot.lengths[k // 3])
    return float(step @ sums.gradient), largest


@njit(**{**OPTIONS, "cache": False})
def imbalance(robot: ArcArrays, gradient: FloatArray) -> float:
    """Returns the largest moment out of balance as a curvature, 1/m, times the segment's length."""
    error = 0.0
    for k in range(gradient.shape[0]):
        if k % 3 != 2:
            error = max(error, abs(gradient[k]) / robot.stiffness[k // 3, 0])
    return error


@njit(**OPTIONS)
def solve_sequence_of_arcs(
    robot: ArcArrays, displacement: FloatArray, tension: FloatArray, warm: bool,
    bends: FloatArray, tensions: FloatArray, changes: FloatArray, solved: FloatArray,
) -> None:  # fmt: skip
    """Solves states one after the other, each with the slip that the one before has left.

    Args:
        robot: The robot.
        displacement: Displacement of each tendon, shape (n, t), m.
        tension: Tension of each tendon without displacement, shape (n, t), N.
        warm: Whether `bends` holds starts; else each state starts at the one before, the first at the straight robot.
        bends: Bend towards x and y (1/m) and stretch of each segment, shape (n, 3 m); written.
        tensions: Tension of each tendon at the base, shape (n, t), N; written.
        changes: Length of each tendon along the robot less that along the straight one, shape (n, t), m; written.
        solved: 1 where Newton's method converged, else 0, shape (n,); written.
    """
    tendons, width = robot.ends.shape[0], bends.shape[1]
    step, trial, x = np.zeros(width), np.zeros(width), np.zeros(width)
    sums = Balance(np.zeros(width), np.zeros((width, width)))
    none = np.zeros((0, 0))
    before = TendonState(np.zeros(tendons), np.zeros(tendons), np.zeros(tendons), none)
    now = TendonState(np.zeros(tendons), np.zeros(tendons), np.zeros(tendons), np.zeros((tendons, width)))
    for case in range(displacement.shape[0]):
        if warm:
            x[:] = bends[case]
        measure_tendons(robot, x, before, now)
        balance_of(robot, x, displacement[case], tension[case], now, sums)
        solved[case] = 0.0
        for _ in range(ITERATIONS):
            if imbalance(robot, sums.gradient) < TOLERANCE:
                solved[case] = 1.0
                break
            descent, largest = search_direction(robot, sums, step)
            scale = min(1.0, LARGEST_BEND_STEP / max(largest, 1e-300))
            for _line in range(LINE_STEPS):
                trial[:] = x + scale * step
                measure_tendons(robot, trial, before, now)
                balance_of(robot, trial, displacement[case], tension[case], now, sums)
                slope = step @ sums.gradient
                if slope <= -0.5 * descent:
                    break
                scale *= max(0.1, min(0.7, -descent / (slope - descent)))
            x[:] = trial
        bends[case], tensions[case], changes[case] = x, now.at_base, now.change
        before.change[:], before.slip[:] = now.change, now.slip
