from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.inspection.grid import Grid


@given(st.integers(0, 2**31), st.integers(8, 5000))
def test_a_grid_finds_every_cell_by_its_middle(seed: int, cells: int) -> None:
    random = np.random.default_rng(seed)
    lower = random.uniform(-1.0, 1.0, 3)
    grid = Grid.of(lower, lower + random.uniform(0.1, 1.0, 3), cells)
    np.testing.assert_array_equal(grid.find(grid.centres), np.arange(grid.cells))
    assert cells <= grid.cells
    corner = lower + 1e-6 * grid.size
    assert grid.find(corner[None])[0] == 0
    assert grid.find(corner[None], 0.1 * grid.size)[0] == -1
    assert (grid.find(np.array([lower - 1.0, [np.nan] * 3])) == -1).all()
