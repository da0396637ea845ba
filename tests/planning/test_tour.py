from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.planning.tour import best_order, tour_length


def random_places(count, seed):
    places = np.random.default_rng(seed).uniform(size=(count + 1, 3))
    return np.linalg.norm(places[:, None] - places, axis=2)


def way(between, order):
    """The length of a tour, added up without the code under test."""
    length, here = 0.0, 0
    for goal in order:
        length += between[here, goal + 1]
        here = goal + 1
    return length


@given(count=st.integers(1, 6), seed=st.integers(0, 2**32 - 1))
def test_the_order_is_the_best_of_all(count, seed):
    between = random_places(count, seed)
    order = best_order(between)
    assert sorted(order) == list(range(count))
    best = min(way(between, other) for other in itertools.permutations(range(count)))
    assert way(between, order) == pytest.approx(best, rel=1e-12)
    assert tour_length(between, order) == pytest.approx(best, rel=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_the_order_of_many_goals_is_near_the_best(seed):
    between = random_places(9, seed)
    order = best_order(between, most_exact=0)
    assert sorted(order) == list(range(9))
    assert way(between, order) <= 1.1 * way(between, best_order(between))


def test_many_goals_on_a_line_are_visited_along_it():
    # From a place nearer to the left end the shortest way turns there once.
    goals = np.arange(24.0)
    places = np.concatenate([[7.4], np.random.default_rng(3).permutation(goals)])
    between = np.abs(places[:, None] - places)
    order = best_order(between)
    assert way(between, order) == pytest.approx(7.4 + 23.0)


def test_no_goal_is_an_empty_tour():
    assert best_order(np.zeros((1, 1))) == ()
