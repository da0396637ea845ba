"""Linear complementarity problems against all choices of active rows."""

from __future__ import annotations

from itertools import product

import numpy as np

from tdcr_planner.statics.complementarity import negative_pivots, solve_complementary


def test_the_solution_is_the_one_found_by_trying_all_choices(random: np.random.Generator) -> None:
    for _ in range(50):
        half = random.normal(size=(5, 5))
        matrix = half @ half.T + 0.05 * np.eye(5)
        right = random.normal(size=5)
        expected = []
        for choice in product([False, True], repeat=5):
            active = np.array(choice)
            x = np.zeros(5)
            x[active] = np.linalg.solve(matrix[np.ix_(active, active)], right[active])
            if (x[active] > 0.0).all() and (right - matrix @ x <= 1e-12).all():
                expected.append(x)
        assert len(expected) == 1
        found, active = np.empty(5), random.uniform(size=5) > 0.5
        assert solve_complementary(matrix, right, active, np.empty((5, 6)), found)
        np.testing.assert_allclose(found, expected[0], atol=1e-9)
        np.testing.assert_array_equal(active, expected[0] > 0.0)


def test_negative_eigenvalues_of_the_active_rows(random: np.random.Generator) -> None:
    for _ in range(20):
        half = random.normal(size=(4, 4))
        matrix = half + half.T
        active = random.uniform(size=4) > 0.3
        expected = (np.linalg.eigvalsh(matrix[np.ix_(active, active)]) < 0.0).sum()
        assert negative_pivots(matrix, active, np.empty((4, 5))) == expected
