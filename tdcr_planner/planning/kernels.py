"""Compiled inner loops of the search: actuation, world poses and how far the body moves between two states."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.compiled import njit
from tdcr_planner.planning.spaces import ConfigurationSpace


class ActuationTables(NamedTuple):
    """What turns configurations into actuations, as arrays for compiled code.

    Attributes:
        segment: Segment of each pair of neighbouring tendons, shape (pairs,).
        tendons: The two tendons of each pair, shape (pairs, 2).
        inverse: Matrix from bending vector to the pair's tensions, shape (pairs, 2, 2).
        pretension: Added to every tendon, shape (t,), N.
        limit: Largest tension of every tendon, shape (t,), N.
        columns: Number of bending columns, and the columns of insertion and roll or -1, shape (3,).
        base_position: Origin of the base frame at insertion 0, shape (3,), m, world frame.
        base_rotation: world_from_base at roll 0, shape (3, 3).
        gravity: Shape (3,), m/s^2, world frame.
        tip_force: Shape (3,), N, world frame.
    """

    segment: IntArray
    tendons: IntArray
    inverse: FloatArray
    pretension: FloatArray
    limit: FloatArray
    columns: IntArray
    base_position: FloatArray
    base_rotation: FloatArray
    gravity: FloatArray
    tip_force: FloatArray


def actuation_tables(space: ConfigurationSpace, tolerance: float | FloatArray) -> ActuationTables:
    """Returns the tables of a configuration space; tolerance, N, shape () or (t,), is added to the limits."""
    robot = space.robot
    segments, tendons, inverses = [], [], []
    for index in range(robot.segment_count):
        columns = np.flatnonzero(robot.tendon_segments == index)
        order = columns[np.argsort(np.mod(robot.tendon_angles[columns], 2.0 * np.pi), kind="stable")]
        for left, right in zip(order, np.roll(order, -1), strict=True):
            angles = robot.tendon_angles[[left, right]]
            segments.append(index)
            tendons.append([left, right])
            inverses.append(np.linalg.inv(np.array([np.cos(angles), np.sin(angles)])))
    bending = space.bending_count
    insertion = bending if space.has_insertion else -1
    roll = space.dimension - 1 if space.has_roll else -1
    return ActuationTables(
        np.array(segments),
        np.array(tendons),
        np.array(inverses),
        robot.pretensions,
        robot.max_tensions + tolerance,
        np.array([bending, insertion, roll]),
        *(np.ascontiguousarray(array) for array in space.world),
    )


@njit(cache=True)
def actuate(rows, tables):  # type: ignore[no-untyped-def]
    """Returns what `ConfigurationSpace.actuate` does, and which rows ask for too much tension or are not finite.

    The bending vector lies in the cone of exactly one neighbouring pair of tendons (two on their common border, which
    then give the same tensions): the pair whose smaller tension is largest.

    Args:
        rows: Configurations, shape (n, dimension).
        tables: See `ActuationTables`.

    Returns:
        Tensions (n, t), gravity (n, 3), tip force (n, 3), base positions (n, 3), base rotations (n, 3, 3), whether a
        tension is over its limit or a number of the row is not finite (n,), and how many rows that concerns.
    """
    count = rows.shape[0]
    tensions = np.empty((count, tables.pretension.shape[0]))
    gravity, tip_force = np.empty((count, 3)), np.empty((count, 3))
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    over, excessive = np.zeros(count, dtype=np.bool_), 0
    bending, insertion, roll = tables.columns
    base = tables.base_rotation
    for row in range(count):
        for tendon in range(tensions.shape[1]):
            tensions[row, tendon] = tables.pretension[tendon]
        for index in range(bending // 2):
            x, y = rows[row, 2 * index], rows[row, 2 * index + 1]
            best, best_pair, best_first, best_second = -np.inf, 0, 0.0, 0.0
            for pair in range(tables.segment.shape[0]):
                if tables.segment[pair] != index:
                    continue
                first = tables.inverse[pair, 0, 0] * x + tables.inverse[pair, 0, 1] * y
                second = tables.inverse[pair, 1, 0] * x + tables.inverse[pair, 1, 1] * y
                if min(first, second) > best:
                    best, best_pair, best_first, best_second = min(first, second), pair, first, second
            tensions[row, tables.tendons[best_pair, 0]] += max(best_first, 0.0)
            tensions[row, tables.tendons[best_pair, 1]] += max(best_second, 0.0)
        for tendon in range(tensions.shape[1]):
            over[row] |= tensions[row, tendon] > tables.limit[tendon]
        total = 0.0
        for column in range(rows.shape[1]):
            total += rows[row, column]
        # A bending vector that is not a number lies in no cone, so the tensions do not tell.
        over[row] |= not math.isfinite(total)
        angle = rows[row, roll] if roll >= 0 else 0.0
        travel = rows[row, insertion] if insertion >= 0 else 0.0
        cosine, sine = math.cos(angle), math.sin(angle)
        for i in range(3):
            positions[row, i] = tables.base_position[i] + travel * base[i, 2]
            rotations[row, i, 0] = base[i, 0] * cosine + base[i, 1] * sine
            rotations[row, i, 1] = base[i, 1] * cosine - base[i, 0] * sine
            rotations[row, i, 2] = base[i, 2]
        for i in range(3):
            pull, push = 0.0, 0.0
            for j in range(3):
                pull += rotations[row, j, i] * tables.gravity[j]
                push += rotations[row, j, i] * tables.tip_force[j]
            gravity[row, i], tip_force[row, i] = pull, push
        excessive += over[row]
    return tensions, gravity, tip_force, positions, rotations, over, excessive


@njit(cache=True)
def to_world(positions, rotations, base_positions, base_rotations):  # type: ignore[no-untyped-def]
    """Returns disk poses in the world frame from poses in the base frame.

    Args:
        positions: Shape (n, d, 3), m, base frame.
        rotations: base_from_disk, shape (n, d, 3, 3).
        base_positions: Shape (n, 3), m, world frame.
        base_rotations: world_from_base, shape (n, 3, 3).

    Returns:
        Positions (n, d, 3) and rotations (n, d, 3, 3), float64, which rows are finite (n,), and how many are not.
    """
    count, disks = positions.shape[0], positions.shape[1]
    world_positions = np.empty((count, disks, 3))
    world_rotations = np.empty((count, disks, 3, 3))
    finite, broken = np.empty(count, dtype=np.bool_), 0
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
        broken += not finite[row]
    return world_positions, world_rotations, finite, broken


@njit(cache=True)
def disk_motions(positions, rotations, parameters, order, reaches):  # type: ignore[no-untyped-def]
    """Returns how far the points of each disk move between two neighbouring states, and stray from straight lines.

    A point of disk k at distance rho <= reaches[k] from its centre moves by at most |dp| + rho 2 sin(angle / 2), and
    2 sin(angle / 2) = |dR| / sqrt 2 with the Frobenius norm. A path x(t) leaves the chord over an interval of width h
    by at most h^2 / 8 max|x''|, so at each t its distances from the two ends add up to at most |dx| + h^2 / 4 max|x''|,
    and the nearer end is within half of that. The second derivative is taken from the divided differences at both ends
    of the interval and doubled, which also covers a kink (a jump J of the slope leaves the chord by up to h J / 4).

    Args:
        positions: Disk centres along an edge, shape (n, d, 3), m, n of 3 or more.
        rotations: Shape (n, d, 3, 3).
        parameters: Where on the edge, shape (n,).
        order: Indices that put the parameters in increasing order, shape (n,).
        reaches: Largest distance of a point from its disk's centre, shape (d,), m.

    Returns:
        Shape (n - 1, d), m, each, for each disk in each interval of the ordered states: a bound on the sum of a point's
        distances from its places in the two states, |dx| + h^2 / 2 |x''|, and on its distance from the straight line
        between them at the same share of the interval, h^2 / 4 |x''|.
    """
    count, disks = positions.shape[0], positions.shape[1]
    motion, stray = np.empty((count - 1, disks)), np.empty((count - 1, disks))
    half = math.sqrt(0.5)
    slopes = np.empty((count - 1, 12))
    chord, bend = np.empty(count - 1), np.zeros(count)
    for disk in range(disks):
        for row in range(count - 1):
            here, there = order[row], order[row + 1]
            width = parameters[there] - parameters[here]
            shift, turn = 0.0, 0.0
            for i in range(3):
                step = positions[there, disk, i] - positions[here, disk, i]
                slopes[row, i] = step / width
                shift += step * step
                for j in range(3):
                    step = rotations[there, disk, i, j] - rotations[here, disk, i, j]
                    slopes[row, 3 + 3 * i + j] = step / width
                    turn += step * step
            chord[row] = math.sqrt(shift) + reaches[disk] * half * math.sqrt(turn)
        for row in range(1, count - 1):
            shift, turn = 0.0, 0.0
            for i in range(3):
                shift += (slopes[row, i] - slopes[row - 1, i]) ** 2
            for i in range(3, 12):
                turn += (slopes[row, i] - slopes[row - 1, i]) ** 2
            both = parameters[order[row + 1]] - parameters[order[row - 1]]
            bend[row] = (math.sqrt(shift) + reaches[disk] * math.sqrt(turn)) * 2.0 / both
        for row in range(count - 1):
            width = parameters[order[row + 1]] - parameters[order[row]]
            stray[row, disk] = 0.25 * width * width * max(bend[row], bend[row + 1])
            motion[row, disk] = chord[row] + 2.0 * stray[row, disk]
    return motion, stray


@njit(cache=True)
def fill_intervals(parameters, order, motion, limit, most):  # type: ignore[no-untyped-def]
    """Returns the parameters to add so that intervals with more motion than their limit are split evenly, shape (m,).

    Args:
        parameters: Where on the edge the states lie, shape (n,).
        order: Indices that put the parameters in increasing order, shape (n,).
        motion: Motion in each interval of the ordered states, shape (n - 1,), m.
        limit: The motion that each may have, shape (n - 1,), m.
        most: Largest number of pieces that an interval is split into at once.
    """
    pieces = np.ones(motion.shape[0], dtype=np.int64)
    missing = 0
    for row in range(motion.shape[0]):
        if motion[row] > limit[row]:
            wanted = motion[row] / max(0.97 * limit[row], 1e-30)
            pieces[row] = most if wanted >= most else max(2, math.ceil(wanted))
            missing += pieces[row] - 1
    added = np.empty(missing)
    place = 0
    for row in range(motion.shape[0]):
        start, end = parameters[order[row]], parameters[order[row + 1]]
        for piece in range(1, pieces[row]):
            added[place] = start + (end - start) * piece / pieces[row]
            place += 1
    return added


@njit(cache=True)
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
