"""Timing: when a path passes each of its states, as fast as the limits on tension, insertion and roll rates allow."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace

_SHORTEST_INTERVAL_S = 1e-3  # between states that coincide, so that times increase strictly


def path_times(scenario: Scenario, space: ConfigurationSpace, rows: FloatArray, tensions: FloatArray) -> FloatArray:
    """Returns the time at which a path passes each state, from 0 and strictly increasing, shape (k,), s.

    Each interval is passed at constant speed, the highest that keeps every rate within its limit. With limits on
    rates alone and a path that is straight between its states that is the time-optimal answer for motion at constant
    speed between states; methods for limits on accelerations have nothing to add. Within an interval a tension is
    piecewise linear, with a kink where the bending vector passes a tendon: the steepest piece decides.

    Args:
        scenario: The query, for its limits.
        space: The path's configuration space.
        rows: States of the path, shape (k, dimension).
        tensions: Tensions of the states, shape (k, t), N.
    """
    limits = scenario.file.limits
    if len(rows) < 2:
        return np.zeros(len(rows))
    needed = [np.full(len(rows) - 1, _SHORTEST_INTERVAL_S)]
    needed.append(steepest_tension(space, rows, tensions) / limits.tension_rate_n_s)
    needed.append(np.abs(np.diff(space.insertion(rows))) / limits.insertion_speed_m_s)
    needed.append(np.abs(np.diff(space.roll(rows))) / np.deg2rad(limits.roll_speed_deg_s))
    return np.concatenate([[0.0], np.cumsum(np.max(needed, axis=0))])


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
    angles = robot.tendon_angles
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    segment = robot.tendon_segments
    offset = rays[:, 0] * start[:, segment, 1] - rays[:, 1] * start[:, segment, 0]
    slope = rays[:, 0] * change[:, segment, 1] - rays[:, 1] * change[:, segment, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        kinks = -offset / slope
    kinks = np.sort(np.where((kinks > 0.0) & (kinks < 1.0), kinks, 0.0), axis=1)
    places = start[:, None] + kinks[:, :, None, None] * change[:, None]
    between = robot.tensions_from_bending(places.reshape(-1, robot.segment_count, 2))
    between = between.reshape(len(start), len(angles), -1)
    ends = np.zeros((len(start), 1))
    width = np.diff(np.concatenate([ends, kinks, ends + 1.0], axis=1), axis=1)[:, :, None]
    passed = np.concatenate([tensions[:-1, None], between, tensions[1:, None]], axis=1)
    # A piece narrower than this share of the interval is two kinks that rounding has set apart.
    rates = np.where(width > 1e-9, np.abs(np.diff(passed, axis=1)) / np.maximum(width, 1e-9), 0.0)
    return np.asarray(rates.max(axis=(1, 2)))
