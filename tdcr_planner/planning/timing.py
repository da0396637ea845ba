"""Timing: when a path passes each of its states, as fast as the limits on rates and accelerations allow.

Without limits on accelerations each interval between two states is passed at constant speed. With them the speed
never jumps: a path is a chain of stretches that are straight in tensions, insertion and roll together, and each of
them is passed from rest to rest. At its corners the path itself demands the stop, because whoever turns a corner of it
at speed changes a velocity in no time; rounding the corners would make another path than the one that was verified.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace

_SHORTEST_INTERVAL_S = 1e-3  # between states that coincide, so that times increase strictly
# Directions of unit length that differ by less are one: states on a straight line are off by rounding, 1e-12.
_SAME_DIRECTION = 1e-6
LEAST_INTERVALS = 8
"""Intervals of a stretch from rest to rest, so that its states show how the speed grows and falls."""


def path_times(scenario: Scenario, space: ConfigurationSpace, rows: FloatArray, tensions: FloatArray) -> FloatArray:
    """Returns the time at which a path passes each state, from 0 and strictly increasing, shape (k,), s.

    With limits on rates alone each interval is passed at constant speed, the highest that keeps every rate within its
    limit. Within an interval a tension is piecewise linear, with a kink where the bending vector passes a tendon: the
    steepest piece decides.

    With a limit on any acceleration each straight stretch of the path is passed from rest to rest, by the time-optimal
    profile for one straight line: as hard as allowed up to the highest speed, and the same down to rest. The states
    have to be those of `smooth_states`, which have no kink between them.

    Args:
        scenario: The query, for its limits.
        space: The path's configuration space.
        rows: States of the path, shape (k, dimension).
        tensions: Tensions of the states, shape (k, t), N.
    """
    limits = scenario.file.limits
    if len(rows) < 2:
        return np.zeros(len(rows))
    if limits.accelerations:
        return _smooth_times(scenario, space, rows, tensions)
    needed = [np.full(len(rows) - 1, _SHORTEST_INTERVAL_S)]
    needed.append(steepest_tension(space, rows, tensions) / limits.tension_rate_n_s)
    needed.append(np.abs(np.diff(space.insertion(rows))) / limits.insertion_speed_m_s)
    needed.append(np.abs(np.diff(space.roll(rows))) / np.deg2rad(limits.roll_speed_deg_s))
    return np.concatenate([[0.0], np.cumsum(np.max(needed, axis=0))])


def smooth_states(space: ConfigurationSpace, rows: FloatArray) -> FloatArray:
    """Returns the states of a straight edge with more of them, so that a motion without speed jumps can be told.

    Every kink of a tension becomes a state, and each piece between two kinks has `LEAST_INTERVALS` or more.

    Args:
        space: The path's configuration space.
        rows: States along the edge, ends included, evenly spaced or not, shape (k, dimension).

    Returns:
        States of the same straight edge, its ends included, shape (n, dimension), n at least k.
    """
    first, last = rows[0], rows[-1]
    places = np.linalg.norm(rows - first, axis=1) / max(float(np.linalg.norm(last - first)), 1e-300)
    kinks = np.unique(kinks_between(space, np.stack([first, last]))[0])
    # A kink that rounding puts beside an end is that end.
    ends = np.concatenate([[0.0], kinks[(kinks > 1e-9) & (kinks < 1.0 - 1e-9)], [1.0]])
    ends = ends[np.concatenate([[True], np.diff(ends) > 1e-9])]
    parts = [np.zeros(1)]
    for low, high in pairwise(ends):
        inside = places[(places > low + 1e-9) & (places < high - 1e-9)]
        if len(inside) + 1 < LEAST_INTERVALS:
            inside = np.linspace(low, high, LEAST_INTERVALS + 1)[1:-1]
        parts.append(np.append(inside, high))
    along = np.concatenate(parts)[:, None]
    states = first + along * (last - first)
    states[-1] = last
    return np.asarray(states)


def _smooth_times(scenario: Scenario, space: ConfigurationSpace, rows: FloatArray, tensions: FloatArray) -> FloatArray:
    """Returns the times of states that are passed from rest to rest on each straight stretch, shape (k,), s."""
    limits = scenario.file.limits
    driven = np.column_stack([tensions, space.insertion(rows), space.roll(rows)])
    count = tensions.shape[1]
    rates = np.array(
        [limits.tension_rate_n_s] * count + [limits.insertion_speed_m_s, np.deg2rad(limits.roll_speed_deg_s)]
    )
    largest = [
        *[_or_infinite(limits.tension_acceleration_n_s2)] * count,
        _or_infinite(limits.insertion_acceleration_m_s2),
        np.deg2rad(_or_infinite(limits.roll_acceleration_deg_s2)),
    ]
    # Measured in seconds at the highest rate, so that newtons, metres and radians compare.
    steps = np.diff(driven, axis=0) / rates
    lengths = np.linalg.norm(steps, axis=1)
    directions = np.divide(steps, lengths[:, None], out=np.zeros_like(steps), where=lengths[:, None] > 0.0)
    turns = np.linalg.norm(np.diff(directions, axis=0), axis=1) > _SAME_DIRECTION
    stops = np.concatenate([[0], np.flatnonzero(turns) + 1, [len(rows) - 1]])
    times = np.zeros(len(rows))
    for first, last in pairwise(stops):
        passed = np.concatenate([[0.0], np.cumsum(lengths[first:last])])
        direction = np.abs(directions[first])
        if passed[-1] == 0.0:
            needed = _SHORTEST_INTERVAL_S * np.arange(last - first + 1)
        else:
            with np.errstate(divide="ignore"):
                speed = float((1.0 / direction).min())
                acceleration = float((np.array(largest) / rates / direction).min())
            needed = rest_to_rest(passed, speed, acceleration)
        times[first + 1 : last + 1] = times[first] + needed[1:]
    return times


def rest_to_rest(passed: FloatArray, speed: float, acceleration: float) -> FloatArray:
    """Returns when a motion from rest to rest along a straight line has covered each distance, shape (n,), s.

    The speed grows, stays and falls; on a line too short for the highest speed it grows and falls.

    Args:
        passed: Distances from 0 to the line's length, increasing, shape (n,).
        speed: Highest speed.
        acceleration: Highest acceleration; infinite for none.
    """
    length = float(passed[-1])
    peak = min(speed, math.sqrt(acceleration * length))
    ramp = 0.5 * peak**2 / acceleration
    total = length / peak + peak / acceleration
    left = length - passed
    with np.errstate(invalid="ignore"):
        rising = np.sqrt(2.0 * passed / acceleration)
        falling = total - np.sqrt(2.0 * np.maximum(left, 0.0) / acceleration)
    even = peak / acceleration + (passed - ramp) / peak
    return np.asarray(np.where(passed < ramp, rising, np.where(left < ramp, falling, even)))


def _or_infinite(limit: float | None) -> float:
    return math.inf if limit is None else limit


def kinks_between(space: ConfigurationSpace, rows: FloatArray) -> FloatArray:
    """Returns where in each interval a bending vector passes a tendon's direction, so that tensions have a kink.

    Args:
        space: The path's configuration space.
        rows: States of the path, shape (k, dimension).

    Returns:
        Fractions of the interval in increasing order, shape (k - 1, t); 0 where a tendon is not passed.
    """
    robot = space.robot
    bending = space.bending(rows)
    start, change = bending[:-1], np.diff(bending, axis=0)
    angles = robot.tendon_angles
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    segment = robot.tendon_segments
    offset = rays[:, 0] * start[:, segment, 1] - rays[:, 1] * start[:, segment, 0]
    slope = rays[:, 0] * change[:, segment, 1] - rays[:, 1] * change[:, segment, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        kinks = -offset / slope
    return np.asarray(np.sort(np.where((kinks > 0.0) & (kinks < 1.0), kinks, 0.0), axis=1))


def steepest_tension(space: ConfigurationSpace, rows: FloatArray, tensions: FloatArray) -> FloatArray:
    """Returns for each interval the largest change of any tension, were its steepest part to last all of it.

    Where the drive does not set bending vectors of tension, it is the change between the states.

    Args:
        space: The path's configuration space.
        rows: States of the path, shape (k, dimension).
        tensions: Tensions of the states, shape (k, t), N.

    Returns:
        Shape (k - 1,), N.
    """
    if space.coordinates.key != "bending_n":
        return np.asarray(np.abs(np.diff(tensions, axis=0)).max(axis=1))
    robot = space.robot
    bending = space.bending(rows)
    start, change = bending[:-1], np.diff(bending, axis=0)
    kinks = kinks_between(space, rows)
    places = start[:, None] + kinks[:, :, None, None] * change[:, None]
    between = robot.tensions_from_bending(places.reshape(-1, robot.segment_count, 2))
    between = between.reshape(len(start), robot.tendon_count, -1)
    ends = np.zeros((len(start), 1))
    width = np.diff(np.concatenate([ends, kinks, ends + 1.0], axis=1), axis=1)[:, :, None]
    passed = np.concatenate([tensions[:-1, None], between, tensions[1:, None]], axis=1)
    # A piece narrower than this share of the interval is two kinks that rounding has set apart.
    rates = np.where(width > 1e-9, np.abs(np.diff(passed, axis=1)) / np.maximum(width, 1e-9), 0.0)
    return np.asarray(rates.max(axis=(1, 2)))
