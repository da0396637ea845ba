from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.limits import ROUNDING, at_most, snap

sizes = st.floats(1e-6, 1e6)


@given(sizes, st.floats(-1.0, 1.0))
def test_a_limit_holds_to_rounding_of_its_size(limit: float, offset: float) -> None:
    value = limit * (1.0 + 3.0 * ROUNDING * offset)
    if abs(abs(3.0 * offset) - 1.0) > 1e-3:
        assert bool(at_most(value, limit)) == (3.0 * offset < 1.0)


@given(st.floats(-1e3, 1e3), sizes, st.floats(-3.0, 3.0))
def test_values_within_rounding_of_an_end_are_moved_onto_it(low: float, size: float, offset: float) -> None:
    high = low + size
    for end in (low, high):
        value = end + offset * ROUNDING * size
        found = float(snap(value, low, high))
        if abs(offset) < 0.9 and size > 1e-2:
            assert low <= found <= high
        if abs(offset) > 1.1 and size > 1e-2:
            assert found == value


def test_what_is_far_outside_or_not_a_number_stays_as_it_is() -> None:
    np.testing.assert_array_equal(snap([-1.0, 0.5, 2.0, np.nan], 0.0, 1.0), [-1.0, 0.5, 2.0, np.nan])
    assert at_most([0.0, np.nan, 5.0], [0.0, 1.0, np.inf]).tolist() == [True, False, True]


@pytest.mark.parametrize("degrees", [12.0, 33.3, 179.9, -7.7])
def test_an_end_survives_a_change_of_unit(degrees: float) -> None:
    low, high = sorted((0.0, degrees))
    there_and_back = float(np.rad2deg(np.deg2rad(degrees)))
    assert low <= float(snap(there_and_back, low, high)) <= high
