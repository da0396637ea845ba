"""What measurements say of parameters: combinations that nothing tells, and states that are not independent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.fit import fit_bench
from tdcr_planner.calibration.forward import Forward, UnloadedMechanics
from tdcr_planner.calibration.parameters import make_blocks
from tdcr_planner.calibration.uncertainty import autocorrelation_factor, find_inseparable, variance_factor


def test_a_sum_alone_does_not_tell_its_terms():
    jacobian = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) * 100.0
    assert find_inseparable(jacobian.T @ jacobian, ["a", "b", "c"]) == (("a", "b"),)
    assert find_inseparable(1e4 * np.eye(3), ["a", "b", "c"]) == ()


@pytest.fixture(scope="module")
def fit(robot, states):
    bench = Bench.nominal(robot)
    blocks = make_blocks(bench, ["offsets"], 30.0)
    forward = Forward(states, UnloadedMechanics())
    return fit_bench(forward, bench, blocks, np.ones(len(states), dtype=bool))


def test_independent_noise_leaves_the_variance_alone(fit):
    assert autocorrelation_factor(fit) < 1.5
    assert 0.7 < variance_factor(fit) < 1.4
    assert fit.noise.position == pytest.approx(5e-4, rel=0.2)


def test_slow_errors_count_as_fewer_states(fit):
    slow = np.repeat(np.random.default_rng(3).normal(size=(6, 3)), 10, axis=0).ravel()
    # Ten states of one value each: the variance of a mean is ten times that of independent states.
    assert 4.0 < autocorrelation_factor(replace(fit, residuals=slow)) < 20.0
