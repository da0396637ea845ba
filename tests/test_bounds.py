from __future__ import annotations

import pytest

from tdcr_planner.bounds import Bound
from tdcr_planner.errors import InputError

BOUND = Bound(1, 1000, "a reason")


@pytest.mark.parametrize("value", [1, 500, 1000, 1.5])
def test_values_inside_are_returned(value: float) -> None:
    assert BOUND.check("--count", value) == value
    assert BOUND.validate(value) == value


@pytest.mark.parametrize("value", [0, -1, 1001, 1e308, float("nan"), float("inf"), 10**300])
def test_values_outside_are_refused_with_the_reason(value: float) -> None:
    with pytest.raises(InputError, match=r"--count: expected 1 to 1000 \(a reason\), got"):
        BOUND.check("--count", value)
    with pytest.raises(ValueError, match=r"expected 1 to 1000 \(a reason\), got"):
        BOUND.validate(value)
