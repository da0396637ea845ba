import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from tdcr_planner.errors import InputError
from tdcr_planner.rates import binomial_rate, quantiles, ratio_at_least

totals = st.integers(1, 2000)
counts = totals.flatmap(lambda total: st.tuples(st.integers(0, total), st.just(total)))


@given(counts, st.sampled_from([0.9, 0.95, 0.99]))
def test_interval_is_scipys_exact_one(pair, confidence):
    rate = binomial_rate(*pair, confidence)
    expected = binomtest(*pair).proportion_ci(confidence, method="exact")
    # scipy finds the ends by a root finder that stops at about 1e-12.
    assert rate.low == pytest.approx(expected.low, abs=1e-9)
    assert rate.high == pytest.approx(expected.high, abs=1e-9)
    assert rate.low <= rate.value <= rate.high


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [
        # Newcombe 1998, Statistics in Medicine 17:857, table I, method 5 (Clopper-Pearson).
        (81, 263, 0.2527, 0.3676),
        (15, 148, 0.0578, 0.1617),
        (0, 20, 0.0, 0.1684),
        (1, 29, 0.0009, 0.1776),
    ],
)
def test_interval_is_the_published_one(count, total, low, high):
    rate = binomial_rate(count, total)
    assert rate.low == pytest.approx(low, abs=5e-5)
    assert rate.high == pytest.approx(high, abs=5e-5)


@given(st.integers(1, 10**7))
def test_nothing_seen_in_n_trials_has_the_closed_form(total):
    # (1 - p)^n = alpha / 2 when none of n trials had it.
    rate = binomial_rate(0, total)
    assert rate.low == 0.0
    assert rate.high == pytest.approx(-np.expm1(np.log(0.025) / total), rel=1e-9)


@pytest.mark.parametrize("probability", [0.001, 0.02, 0.3, 0.5])
def test_interval_covers_as_often_as_it_says(probability):
    total = 60
    inside = [k for k in range(total + 1) if binomial_rate(k, total).low <= probability <= binomial_rate(k, total).high]
    assert binom.pmf(inside, total, probability).sum() >= 0.95


@given(counts)
def test_interval_is_symmetric(pair):
    count, total = pair
    rate, other = binomial_rate(count, total), binomial_rate(total - count, total)
    assert rate.low == pytest.approx(1.0 - other.high, abs=1e-12)


def test_no_trials_say_nothing():
    rate = binomial_rate(0, 0)
    assert (rate.low, rate.high) == (0.0, 1.0)
    assert np.isnan(rate.value)
    assert rate.as_dict()["value"] is None
    assert str(rate) == "no trials"


@pytest.mark.parametrize(("count", "total"), [(-1, 5), (6, 5)])
def test_refuses_impossible_counts(count, total):
    with pytest.raises(InputError, match="0 to 5"):
        binomial_rate(count, total)


def test_refuses_a_confidence_that_is_none():
    with pytest.raises(InputError, match="between 0 and 1"):
        binomial_rate(1, 5, 1.0)


@given(counts, counts)
def test_ratio_bound_is_below_the_ratio(pair, other):
    numerator, denominator = binomial_rate(*pair), binomial_rate(*other)
    bound = ratio_at_least(numerator, denominator)
    if denominator.count:
        assert bound <= numerator.value / denominator.value + 1e-12
    assert bound >= 0.0


def test_ratio_bound_holds_as_often_as_it_says():
    generator = np.random.default_rng(3)
    total, truth = 3000, 10.0
    above, below = generator.binomial(total, 0.05, 400), generator.binomial(total, 0.005, 400)
    held = [
        ratio_at_least(binomial_rate(a, total), binomial_rate(b, total)) <= truth
        for a, b in zip(above, below, strict=True)
    ]
    assert np.mean(held) >= 0.95


def test_quantiles_are_numpys_over_what_is_finite():
    values = np.array([3.0, 1.0, np.nan, 2.0, np.inf])
    found = quantiles(values)
    assert found["count"] == 3
    assert found["median"] == 2.0
    assert found["p25"] == np.quantile([1.0, 2.0, 3.0], 0.25)
    assert found["max"] == 3.0
    assert quantiles([]) == {
        "count": 0,
        "mean": None,
        **dict.fromkeys(("p10", "p25", "median", "p75", "p90", "p99", "max")),
    }
