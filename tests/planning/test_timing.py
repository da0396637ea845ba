from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import toppra

from tdcr_planner.planning.timing import path_times, rest_to_rest, smooth_states

BASE = {"insertion_m": [0.0, 0.1], "roll_deg": [-180.0, 180.0]}
LIMITS = {"tension_rate_n_s": 2.0, "insertion_speed_m_s": 0.05, "roll_speed_deg_s": 90.0}


def times_of(setup, rows):
    rows = np.array(rows, dtype=np.float64)
    return path_times(setup.scenario, setup.space, rows, setup.space.actuate(rows).tensions)


@pytest.mark.parametrize(
    ("row", "seconds"),
    [
        ([0.0, 3.0, 0.0, 0.0], 1.5),  # 3 N on the tendon at 90 degrees, 2 N/s
        ([0.0, 0.0, 0.1, 0.0], 2.0),  # 0.1 m at 0.05 m/s
        ([0.0, 0.0, 0.0, np.pi], 2.0),  # 180 degrees at 90 degrees/s
        ([0.0, 1.0, 0.1, np.pi / 4], 2.0),  # the slowest of the three decides
        ([0.0, 0.0, 0.0, 0.0], 1e-3),  # standing still still takes time
    ],
)
def test_each_limit_is_met_exactly(make_setup, row, seconds):
    setup = make_setup(base=BASE, limits=LIMITS)
    np.testing.assert_allclose(times_of(setup, [np.zeros(4), row]), [0.0, seconds], rtol=1e-12)


def test_a_kink_between_states_counts_with_its_steeper_side(make_setup):
    setup = make_setup(base=BASE, limits=LIMITS)
    # From the direction of tendon 1 (90 degrees) through 30 degrees to that of tendon 2 (-30 degrees): tendon 1 falls
    # from 2 N to 0 and tendon 2 rises from 0 to 2 N over the whole way; past -30 degrees tendon 3 takes over.
    first, second = np.array([0.0, 2.0]), 2.0 * np.array([np.cos(np.pi / 6), -0.5])
    past = second + (second - first)
    rows = [[*first, 0.0, 0.0], [*past, 0.0, 0.0]]
    half = times_of(setup, [[*first, 0.0, 0.0], [*second, 0.0, 0.0], [*past, 0.0, 0.0]])
    whole = times_of(setup, rows)
    fine = np.linspace(rows[0], rows[1], 4001)
    steepest = np.abs(np.diff(setup.space.actuate(fine).tensions, axis=0)).max() * 4000
    assert whole[-1] == pytest.approx(steepest / 2.0, rel=1e-6)
    assert half[-1] < whole[-1]


def test_no_rate_is_exceeded_anywhere_on_random_paths(make_setup, random):
    setup = make_setup("two_segment", base=BASE, limits=LIMITS)
    rows = random.uniform(setup.space.lower, setup.space.upper, (30, 6))
    times = times_of(setup, rows)
    assert times[0] == 0.0
    assert (np.diff(times) > 0.0).all()
    tightness = []
    for index in range(29):
        fine = np.linspace(rows[index], rows[index + 1], 501)
        seconds = (times[index + 1] - times[index]) / 500
        tension = np.abs(np.diff(setup.space.actuate(fine).tensions, axis=0)).max() / seconds / 2.0
        travel = np.abs(np.diff(fine[:, 4])).max() / seconds / 0.05
        roll = np.rad2deg(np.abs(np.diff(fine[:, 5])).max()) / seconds / 90.0
        tightness.append(max(tension, travel, roll))
    np.testing.assert_allclose(tightness, 1.0, rtol=1e-6)


def test_short_paths(make_setup):
    setup = make_setup(base=BASE)
    assert times_of(setup, [np.zeros(4)]).tolist() == [0.0]
    assert path_times(setup.scenario, setup.space, np.zeros((0, 4)), np.zeros((0, 3))).tolist() == []


ACCELERATIONS = {
    "tension_acceleration_n_s2": 5.0,
    "insertion_acceleration_m_s2": 0.1,
    "roll_acceleration_deg_s2": 200.0,
}


def driven(setup, rows):
    """Returns tensions, insertion and roll of rows as columns, with their largest rates and accelerations."""
    tensions = setup.space.actuate(rows).tensions
    columns = np.column_stack([tensions, setup.space.insertion(rows), setup.space.roll(rows)])
    count = tensions.shape[1]
    rates = np.array([2.0] * count + [0.05, np.deg2rad(90.0)])
    return columns, rates, np.array([5.0] * count + [0.1, np.deg2rad(200.0)])


def test_no_rate_and_no_acceleration_is_exceeded_and_the_path_is_the_same(make_setup, random):
    setup = make_setup("two_segment", base=BASE, limits={**LIMITS, **ACCELERATIONS})
    corners = random.uniform(setup.space.lower, setup.space.upper, (12, 6))
    parts = [smooth_states(setup.space, np.linspace(a, b, 20)) for a, b in pairwise(corners)]
    rows = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    times = times_of(setup, rows)
    assert (np.diff(times) > 0.0).all()
    columns, rates, accelerations = driven(setup, rows)
    steps = np.diff(times)[:, None]
    velocity = np.diff(columns, axis=0) / steps
    assert (np.abs(velocity) <= rates * (1.0 + 1e-9)).all()
    # A second divided difference is a mean of the second derivative over its three times.
    second = np.diff(velocity, axis=0) / (0.5 * (steps[1:] + steps[:-1]))
    assert (np.abs(second) <= accelerations * (1.0 + 1e-4)).all()
    assert (np.abs(second) / accelerations).max() > 0.9
    # The states lie on the edges between the corners, and every corner is one.
    for part, (a, b) in zip(parts, pairwise(corners), strict=True):
        along = (part - a) @ (b - a) / ((b - a) @ (b - a))
        np.testing.assert_allclose(part, a + along[:, None] * (b - a), atol=1e-12)
        assert (part[0] == a).all()
        assert (part[-1] == b).all()


def test_a_straight_stretch_takes_the_time_that_toppra_finds(make_setup):
    setup = make_setup(base=BASE, limits={**LIMITS, **ACCELERATIONS})
    start, end = np.zeros(4), np.array([0.0, 2.5, 0.08, 1.0])
    rows = smooth_states(setup.space, np.stack([start, end]))
    columns, rates, accelerations = driven(setup, np.stack([start, end]))
    path = toppra.SplineInterpolator([0.0, 1.0], columns)
    limits = [
        toppra.constraint.JointVelocityConstraint(np.stack([-rates, rates], axis=1)),
        toppra.constraint.JointAccelerationConstraint(np.stack([-accelerations, accelerations], axis=1)),
    ]
    found = toppra.algorithm.TOPPRA(limits, path, gridpoints=np.linspace(0.0, 1.0, 2001)).compute_trajectory(0.0, 0.0)
    # The error of its grid: 1e-3 of the time.
    assert times_of(setup, rows)[-1] == pytest.approx(found.duration, rel=2e-3)


@pytest.mark.parametrize(("length", "seconds"), [(8.0, 6.0), (1.0, 2.0), (4.0, 4.0)])
def test_from_rest_to_rest_by_the_closed_form(length, seconds):
    # Highest speed 2 after 2 s and 2 m; below 4 m it is never reached and half the way takes sqrt(length / a).
    times = rest_to_rest(np.linspace(0.0, length, 101), 2.0, 1.0)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(seconds)
    np.testing.assert_allclose(times + times[::-1], seconds)
    np.testing.assert_allclose(rest_to_rest(np.array([0.0, length]), 2.0, np.inf), [0.0, length / 2.0])


def test_one_limited_acceleration_leaves_the_others_their_rates(make_setup):
    setup = make_setup(base=BASE, limits={**LIMITS, "insertion_acceleration_m_s2": 0.1})
    rows = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 3.0, 0.1, 0.0]])
    np.testing.assert_allclose(times_of(setup, rows), [0.0, 1.5, 1.5 + 2.0 + 0.5])


def test_standing_states_take_the_shortest_time(make_setup):
    setup = make_setup(base=BASE, limits={**LIMITS, **ACCELERATIONS})
    rows = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.1, 0.0]])
    np.testing.assert_allclose(times_of(setup, rows), [0.0, 1e-3, 1e-3 + 2.5])
