"""The bound that follows the state: its coverage on errors of a known law."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.learning.dataset import Cases, SolvedCases
from tdcr_planner.learning.judge import conformal_bound
from tdcr_planner.learning.state_margin import FLOOR_M, calibrate_state_margin, cases_needed, measure_coverage

DISKS = 4
ALPHA = 0.05


def draw(count: int, seed: int) -> tuple[SolvedCases, np.ndarray, np.ndarray]:
    """Returns cases whose errors are a scale, which spans two decades, times a law of its own."""
    generator = np.random.default_rng(seed)
    scale = 1e-4 * 10.0 ** generator.uniform(0.0, 2.0, (count, 1)) * np.linspace(0.0, 1.0, DISKS)
    errors = scale * generator.lognormal(0.0, 0.5, (count, DISKS))
    cases = Cases(generator.uniform(size=(count, 3)), np.zeros((count, 3)), np.zeros((count, 3)))
    shape = np.zeros((count, DISKS, 3)), np.zeros((count, DISKS, 3, 3))
    return SolvedCases(cases, np.zeros((count, 3)), *shape, count), errors, scale


def test_it_covers_as_promised_and_follows_the_scale() -> None:
    solved, errors, scale = draw(4000, 1)
    margin = calibrate_state_margin(lambda _: scale, [solved], [errors], ALPHA)
    _, fresh, fresh_scale = draw(40_000, 2)
    own = np.minimum((fresh_scale + FLOOR_M) * margin.factor, margin.ceiling_m)
    coverage = measure_coverage(fresh, own)
    assert coverage.overall >= 1.0 - ALPHA
    # The law is the same at every scale, so that each tenth is covered alike: up to the counts, 4,000 each.
    assert min(coverage.deciles) > 1.0 - 1.5 * ALPHA
    uniform = measure_coverage(fresh, conformal_bound(errors, ALPHA))
    assert uniform.overall >= 1.0 - ALPHA
    assert coverage.median_tip_m < 0.25 * uniform.median_tip_m
    assert margin.tip_m[0] == pytest.approx(coverage.median_tip_m, rel=0.1)


def test_the_larger_of_two_samples_counts() -> None:
    solved, errors, scale = draw(2000, 1)
    one = calibrate_state_margin(lambda _: scale, [solved], [errors], ALPHA)
    both = calibrate_state_margin(lambda _: scale, [solved, solved], [errors, 2.0 * errors], ALPHA)
    np.testing.assert_allclose(both.factor, 2.0 * np.asarray(one.factor))
    np.testing.assert_allclose(both.ceiling_m, 2.0 * np.asarray(one.ceiling_m))


def test_cases_without_a_scale_take_no_part() -> None:
    solved, errors, scale = draw(2000, 1)
    broken = scale.copy()
    broken[:20] = np.nan
    margin = calibrate_state_margin(lambda _: broken, [solved], [errors], ALPHA)
    assert np.isfinite(margin.factor).all()
    assert 3.0 * margin.tip_m[1] == pytest.approx(margin.ceiling_m[-1])


def test_too_few_cases_are_an_error() -> None:
    few = cases_needed(ALPHA)
    assert (1.0 - ALPHA) ** (few - 1) <= 0.01 < (1.0 - ALPHA) ** (few - 3)
    solved, errors, scale = draw(few // 2, 1)
    with pytest.raises(ValueError, match="needs more than"):
        calibrate_state_margin(lambda _: scale, [solved], [errors], ALPHA)
