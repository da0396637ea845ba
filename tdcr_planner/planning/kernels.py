"""Compiled inner loops of the search: actuation, world poses and how far the body moves between two states."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.robot import RobotSpec


class TendonPairs(NamedTuple):
    """Neighbouring tendons of each segment and what turns a bending vector into their tensions.

    Attributes:
        segment: Segment of each pair, shape (pairs,).
        tendons: The two tendons, shape (pairs, 2).
        inverse: Matrix from bending vector to the pair's tensions, shape (pairs, 2, 2).
        pretension: Added to every tendon, shape (t,), N.
    """

    segment: IntArray
    tendons: IntArray
    inverse: FloatArray
    pretension: FloatArray


def tendon_pairs(robot: RobotSpec) -> TendonPairs:
    """Returns the neighbouring pairs of a robot's tendons; see `RobotSpec.tensions_from_bending`."""
    segments, tendons, inverses = [], [], []
    for index in range(robot.segment_count):
        columns = np.flatnonzero(robot.tendon_segments == index)
        order = columns[np.argsort(np.mod(robot.tendon_angles[columns], 2.0 * np.pi), kind="stable")]
        for left, right in zip(order, np.roll(order, -1), strict=True):
            angles = robot.tendon_angles[[left, right]]
            segments.append(index)
            tendons.append([left, right])
            inverses.append(np.linalg.inv(np.array([np.cos(angles), np.sin(angles)])))
    return TendonPairs(np.array(segments), np.array(tendons), np.array(inverses), robot.pretensions)


@numba.njit(cache=True, fastmath=False)
def tensions_of_bending(bending, segment, tendons, inverse, pretension):  # type: ignore[no-untyped-def]
    """Returns the tensions of least sum, shape (n, t), N, of bending vectors (n, segments, 2), N.

    The bending vector lies in the cone of exactly one neighbouring pair (two on their common border, which then give
    the same tensions): the pair whose smaller tension is largest.
    """
    count = bending.shape[0]
    tensions = np.empty((count, pretension.shape[0]))
    for row in range(count):
        tensions[row] = pretension
        for index in range(bending.shape[1]):
            x, y = bending[row, index, 0], bending[row, index, 1]
            best, best_pair, best_first, best_second = -np.inf, 0, 0.0, 0.0
            for pair in range(segment.shape[0]):
                if segment[pair] != index:
                    continue
                first = inverse[pair, 0, 0] * x + inverse[pair, 0, 1] * y
                second = inverse[pair, 1, 0] * x + inverse[pair, 1, 1] * y
                smaller = min(first, second)
                if smaller > best:
                    best, best_pair, best_first, best_second = smaller, pair, first, second
            tensions[row, tendons[best_pair, 0]] += max(best_first, 0.0)
            tensions[row, tendons[best_pair, 1]] += max(best_second, 0.0)
    return tensions


@numba.njit(cache=True)
def to_world(positions, rotations, base_positions, base_rotations):  # type: ignore[no-untyped-def]
    """Returns disk poses in the world frame from poses in the base frame.

    Args:
        positions: Shape (n, d, 3), m, base frame.
        rotations: base_from_disk, shape (n, d, 3, 3).
        base_positions: Shape (n, 3), m, world frame.
        base_rotations: world_from_base, shape (n, 3, 3).

    Returns:
        Positions (n, d, 3) and rotations (n, d, 3, 3), float64, and which rows are finite, shape (n,).
    """
    count, disks = positions.shape[0], positions.shape[1]
    world_positions = np.empty((count, disks, 3))
    world_rotations = np.empty((count, disks, 3, 3))
    finite = np.empty(count, dtype=np.bool_)
    for row in range(count):
        total = 0.0
        base = base_rotations[row]
        for disk in range(disks):
            p = positions[row, disk]
            R = rotations[row, disk]
            for i in range(3):
                value = base_positions[row, i] + base[i, 0] * p[0] + base[i, 1] * p[1] + base[i, 2] * p[2]
                world_positions[row, disk, i] = value
                total += abs(value)
                for j in range(3):
                    value = base[i, 0] * R[0, j] + base[i, 1] * R[1, j] + base[i, 2] * R[2, j]
                    world_rotations[row, disk, i, j] = value
                    total += abs(value)
        finite[row] = math.isfinite(total)
    return world_positions, world_rotations, finite


@numba.njit(cache=True)
def body_motion(positions, rotations, parameters, reaches):  # type: ignore[no-untyped-def]
    """Returns how far the body may stray from the nearer of two neighbouring states, doubled, between each two.

    A point of disk k at distance rho <= reaches[k] from its centre moves by at most |dp| + rho 2 sin(angle / 2), and
    2 sin(angle / 2) = |dR| / sqrt 2 with the Frobenius norm. A path x(t) leaves the chord over an interval of width h
    by at most h^2 / 8 max|x''|, so at each t one of the two ends is nearer than |dx| / 2 + h^2 / 8 max|x''|. The
    second derivative is taken from the divided differences at both ends of the interval and doubled, which also covers
    a kink (a jump J of the slope leaves the chord by up to h J / 4).

    Args:
        positions: Disk centres along an edge, shape (n, d, 3), m, n of 3 or more.
        rotations: Shape (n, d, 3, 3).
        parameters: Where on the edge, increasing, shape (n,).
        reaches: Largest distance of a point from its disk's centre, shape (d,), m.

    Returns:
        Shape (n - 1,), m: for each interval max over disks of |dx| + h^2 / 2 |x''|.
    """
    count, disks = positions.shape[0], positions.shape[1]
    chord = np.zeros((count - 1, disks))
    bend = np.zeros((count, disks))
    root = math.sqrt(2.0)
    for row in range(count - 1):
        for disk in range(disks):
            shift, turn = 0.0, 0.0
            for i in range(3):
                shift += (positions[row + 1, disk, i] - positions[row, disk, i]) ** 2
                for j in range(3):
                    turn += (rotations[row + 1, disk, i, j] - rotations[row, disk, i, j]) ** 2
            chord[row, disk] = math.sqrt(shift) + reaches[disk] * math.sqrt(turn) / root
    for row in range(1, count - 1):
        before, after = parameters[row] - parameters[row - 1], parameters[row + 1] - parameters[row]
        for disk in range(disks):
            shift, turn = 0.0, 0.0
            for i in range(3):
                slope = (positions[row + 1, disk, i] - positions[row, disk, i]) / after
                slope -= (positions[row, disk, i] - positions[row - 1, disk, i]) / before
                shift += slope * slope
                for j in range(3):
                    slope = (rotations[row + 1, disk, i, j] - rotations[row, disk, i, j]) / after
                    slope -= (rotations[row, disk, i, j] - rotations[row - 1, disk, i, j]) / before
                    turn += slope * slope
            bend[row, disk] = (math.sqrt(shift) + reaches[disk] * math.sqrt(turn)) * 2.0 / (before + after)
    motion = np.zeros(count - 1)
    for row in range(count - 1):
        width = parameters[row + 1] - parameters[row]
        for disk in range(disks):
            curvature = max(bend[row, disk], bend[row + 1, disk])
            motion[row] = max(motion[row], chord[row, disk] + 0.5 * width * width * curvature)
    return motion


@numba.njit(cache=True)
def gap_curvatures(rotations, spacing):  # type: ignore[no-untyped-def]
    """Returns the mean curvature and twist between neighbouring disks.

    Args:
        rotations: base_from_disk, shape (n, d, 3, 3).
        spacing: Arc length between disks, shape (d - 1,), m.

    Returns:
        The rotation vector from each disk to the next over their distance, shape (n, d - 1, 3), 1/m, disk frame.
    """
    count, disks = rotations.shape[0], rotations.shape[1]
    curvature = np.empty((count, disks - 1, 3))
    for row in range(count):
        for gap in range(disks - 1):
            A, B = rotations[row, gap], rotations[row, gap + 1]
            trace, x, y, z = 0.0, 0.0, 0.0, 0.0
            for i in range(3):
                trace += A[i, 0] * B[i, 0] + A[i, 1] * B[i, 1] + A[i, 2] * B[i, 2]
                x += A[i, 2] * B[i, 1] - A[i, 1] * B[i, 2]
                y += A[i, 0] * B[i, 2] - A[i, 2] * B[i, 0]
                z += A[i, 1] * B[i, 0] - A[i, 0] * B[i, 1]
            sine = 0.5 * math.sqrt(x * x + y * y + z * z)
            angle = math.atan2(sine, 0.5 * (trace - 1.0))
            factor = 0.5 if sine < 1e-9 else 0.5 * angle / sine
            curvature[row, gap, 0] = factor * x / spacing[gap]
            curvature[row, gap, 1] = factor * y / spacing[gap]
            curvature[row, gap, 2] = factor * z / spacing[gap]
    return curvature
