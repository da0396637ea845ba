from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.planning.timing import path_times

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
