"""The error bound: the conformal quantile and its coverage, and how it grows from the tip to all disks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.bound import bound_per_disk, conformal_quantile
from tdcr_planner.calibration.forward import Forward, UnloadedMechanics


def test_the_quantile_is_the_rank_that_the_theorem_names():
    errors = np.random.default_rng(0).permutation(np.arange(1.0, 100.0))
    assert conformal_quantile(errors, 0.95) == 95.0
    assert conformal_quantile(errors[:19], 0.95) == errors[:19].max()
    assert conformal_quantile(errors[:18], 0.95) == math.inf


def test_a_further_error_is_covered_as_often_as_stated():
    random = np.random.default_rng(1)
    draws = random.exponential(size=(4000, 40))
    covered = np.mean([row[-1] <= conformal_quantile(row[:-1], 0.9) for row in draws])
    # At least 0.9 and at most 0.9 + 1/40 in the mean; 4000 draws tell it to 0.005.
    assert 0.89 < covered < 0.94


def test_the_bound_grows_from_the_base_to_the_tracked_tip(robot, states):
    forward = Forward(states, UnloadedMechanics())
    errors = np.full((len(states), 1), 2e-3)
    bound = bound_per_disk(forward, Bench.nominal(robot), errors)
    assert bound[0] == 0.0
    assert bound[-1] == pytest.approx(2e-3)
    assert (np.diff(bound) > 0.0).all()
    # Bending errors move a disk with the square of its distance, so half-way it is well below half.
    assert bound[3] < 0.5 * bound[-1]
