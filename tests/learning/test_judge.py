"""The error bound covers what it says, on errors of any distribution."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.learning.dataset import Cases, SolvedCases
from tdcr_planner.learning.judge import body_errors, calibrate_bound, conformal_bound, measure_accuracy
from tdcr_planner.se3 import rotation_about_z


def heavy_tailed(count, random):
    return np.abs(random.standard_t(3, (count, 1))) * random.uniform(0.5, 1.0, (count, 4)) * [0.0, 1.0, 2.0, 3.0]


def test_bound_covers_fresh_cases(random):
    alpha = 0.01
    bound = conformal_bound(heavy_tailed(20_000, random), alpha)
    outside = (heavy_tailed(200_000, random) > bound).any(axis=1).mean()
    # 99 % confidence keeps 2.3 deviations of sqrt(alpha / n) = 7e-4 below alpha; as much again for this draw.
    assert 0.005 < outside <= alpha


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(100, 400), alpha=st.floats(0.06, 0.5))
def test_bound_covers_all_but_alpha_of_its_own_cases(seed, count, alpha):
    errors = heavy_tailed(count, np.random.default_rng(seed))
    bound = conformal_bound(errors, alpha)
    assert (errors > bound * (1 + 1e-12)).any(axis=1).sum() <= alpha * (count + 1)


def test_bound_needs_enough_cases(random):
    with pytest.raises(ValueError, match="more than 50"):
        conformal_bound(heavy_tailed(50, random), 0.001)


def test_a_perfect_model_has_no_bound_to_pay(small_robot):
    solved, predict = shifted_model(small_robot, 0.0, 0.0)
    bound = calibrate_bound(small_robot, predict, [solved], 0.2)
    np.testing.assert_allclose(bound.disk_m, 0.0, atol=1e-15)


def shifted_model(robot, shift, angle, count=40):
    disks = robot.disk_count
    cases = Cases(np.zeros((count, robot.tendon_count)), np.zeros((count, 3)), np.zeros((count, 3)))
    rotations = np.broadcast_to(np.eye(3), (count, disks, 3, 3))
    solved = SolvedCases(cases, np.zeros((count, 3)), np.zeros((count, disks, 3)), rotations, count)

    def predict(asked):
        positions = np.zeros((count, disks, 3))
        positions[..., 0] = shift
        return positions, rotations @ rotation_about_z(np.array(angle)), np.zeros(count)

    return solved, predict


def test_body_error_is_centre_error_plus_the_rim_turning(small_robot):
    solved, predict = shifted_model(small_robot, 1e-3, 0.2)
    errors = body_errors(small_robot, *predict(solved.cases)[:2], solved)
    # A rim point moves along a chord of 2 r sin(angle / 2).
    np.testing.assert_allclose(errors, 1e-3 + 2.0 * 0.010 * np.sin(0.1), rtol=1e-12)


def test_accuracy_says_what_was_measured(small_robot):
    solved, predict = shifted_model(small_robot, 2e-3, np.deg2rad(3.0))
    accuracy = measure_accuracy(predict, "uniform", solved)
    assert accuracy.cases == 40
    np.testing.assert_allclose(accuracy.position_p99_mm, 2.0)
    assert accuracy.overall["rotation_max_deg"] == pytest.approx(3.0)
    assert accuracy.overall["residual_median_nm"] == 0.0
