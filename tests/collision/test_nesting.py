"""Boxes in boxes, against a comparison of all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.collision.nesting import enclosing_boxes


@pytest.mark.parametrize("count", [1, 2, 3, 17, 300])
@pytest.mark.parametrize("kind", ["scattered", "nested", "equal centres", "flat", "same"])
def test_the_box_found_is_the_last_larger_one_that_contains(count, kind):
    rng = np.random.default_rng(count)
    centre = rng.random((count, 3))
    half = 0.5 * rng.random((count, 3)) ** (4 if kind == "scattered" else 1)
    if kind in ("nested", "equal centres", "same"):
        centre[:] = 0.5
    if kind == "nested":
        half = np.sort(half, axis=0)
    if kind == "flat":
        half[:, 2] = 0.0
        centre[:, 2] = 0.0
    if kind == "same":
        half[:] = half[0]
    lower, upper = centre - half, centre + half
    rank = rng.permutation(count)
    contains = (lower[:, None] <= lower[None]).all(axis=2) & (upper[:, None] >= upper[None]).all(axis=2)
    expected = np.full(count, -1)
    for index in range(count):
        around = np.flatnonzero(contains[:, index] & (rank < rank[index]))
        if len(around):
            expected[index] = around[np.argmax(rank[around])]
    np.testing.assert_array_equal(enclosing_boxes(lower, upper, rank), expected)
