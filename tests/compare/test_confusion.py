import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.compare.confusion import EXCESS_EDGES, Confusion, agreement_by_clearance, count_verdicts

verdicts = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60).map(lambda pairs: np.array(pairs))


@given(verdicts)
def test_counts_are_those_of_a_loop(pairs):
    confusion = count_verdicts(pairs[:, 0], pairs[:, 1])
    tally = [tuple(pair) for pair in pairs.tolist()]
    assert confusion == Confusion(
        both_valid=tally.count((True, True)),
        false_valid=tally.count((True, False)),
        false_invalid=tally.count((False, True)),
        both_invalid=tally.count((False, False)),
    )
    assert confusion.total == len(pairs)


def test_rates_have_the_denominators_that_their_names_say():
    rates = Confusion(both_valid=60, false_valid=4, false_invalid=6, both_invalid=30).rates
    assert {name: (rate.count, rate.total) for name, rate in rates.items()} == {
        "agreement": (90, 100),
        "false_valid": (4, 100),
        "false_valid_of_accepted": (4, 64),
        "false_valid_of_invalid": (4, 34),
        "false_invalid": (6, 100),
        "false_invalid_of_rejected": (6, 36),
        "false_invalid_of_valid": (6, 66),
    }


@given(verdicts, st.floats(0.0, 0.002), st.integers(0, 2**32 - 1))
def test_bins_hold_every_state_with_a_clearance_once(pairs, asked, seed):
    clearance = np.random.default_rng(seed).normal(0.0, 0.02, len(pairs))
    clearance[::7] = np.nan
    bins = agreement_by_clearance(pairs[:, 0], pairs[:, 1], clearance, asked)
    known = np.isfinite(clearance)
    assert sum(part.agreement.total for part in bins) == known.sum()
    assert sum(part.agreement.count for part in bins) == (pairs[:, 0] == pairs[:, 1])[known].sum()


def test_a_state_lies_in_the_bin_of_its_excess_clearance():
    truth = np.array([True])
    (part,) = agreement_by_clearance(truth, truth, np.array([0.0023]), 0.0005)
    assert (part.low, part.high) == pytest.approx((0.001, 0.002))
    (part,) = agreement_by_clearance(truth, truth, np.array([0.0005]), 0.0005)
    assert part.low == 0.0
    (part,) = agreement_by_clearance(truth, truth, np.array([9.0]), 0.0005)
    assert part.high == np.inf == EXCESS_EDGES[-1]
