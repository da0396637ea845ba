from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.arrays import check_array, check_batch, check_positive
from tdcr_planner.errors import InputError


def test_check_array_returns_contiguous_float64() -> None:
    array = check_array("x", np.ones((3, 2), dtype=np.float32).T, (2, None))
    assert array.dtype == np.float64
    assert array.flags.c_contiguous


@pytest.mark.parametrize(
    ("value", "shape", "message"),
    [
        ([1.0, 2.0], (3,), r"x: expected shape \(3\), got shape \(2,\)"),
        ([[1.0]], (None,), r"x: expected shape \(n\), got shape \(1, 1\)"),
        ([1.0, float("nan")], (2,), r"x: expected finite numbers, got nan at index \(1,\)"),
        ([1.0, float("inf")], (2,), "finite numbers, got inf"),
        (["a"], (1,), "x: expected numbers"),
        (None, (1,), "x: expected"),
        ([[1.0], [1.0, 2.0]], (2, 2), "x: expected numbers"),
    ],
)
def test_check_array_refuses(value: object, shape: tuple[int | None, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_array("x", value, shape)  # type: ignore[arg-type]


def test_check_batch_repeats_one_vector_and_keeps_many() -> None:
    np.testing.assert_array_equal(check_batch("g", [1.0, 2.0, 3.0], 2, 3), [[1, 2, 3], [1, 2, 3]])
    np.testing.assert_array_equal(check_batch("g", None, 2, 3), np.zeros((2, 3)))
    many = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(check_batch("g", many, 2, 3), many)


def test_check_batch_refuses_another_count() -> None:
    with pytest.raises(InputError, match=r"g: expected shape \(3, 3\), got shape \(2, 3\)"):
        check_batch("g", np.zeros((2, 3)), 3, 3)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_check_positive_refuses(value: float) -> None:
    with pytest.raises(InputError, match="length"):
        check_positive("length", value)
