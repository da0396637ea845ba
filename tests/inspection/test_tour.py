from __future__ import annotations

import itertools

import numpy as np
import pytest

from tdcr_planner.inspection.tour import TourSearch


def make(
    seed: int, stops: int, points: int, *, back: bool, share: float = 1.0
) -> tuple[TourSearch, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    places = random.uniform(size=(stops, 2))
    lengths = np.linalg.norm(places[:, None] - places[None], axis=2)
    seen = random.uniform(size=(stops, points)) < 0.4
    seen[0] = False
    weights = random.uniform(0.5, 1.5, points)
    target = share * float(weights[seen.any(axis=0)].sum())
    return TourSearch(lengths, seen, weights, target, back=back, seed=seed), lengths, seen


def shortest(lengths: np.ndarray, seen: np.ndarray, *, back: bool) -> float:
    """Returns the length of the shortest tour that sees all that can be seen, by trying all."""
    best = np.inf
    everything = seen.any(axis=0)
    for count in range(len(lengths)):
        for order in itertools.permutations(range(1, len(lengths)), count):
            if (seen[[0, *order]].any(axis=0) == everything).all():
                stops = [0, *order, *([0] if back else [])]
                best = min(best, float(lengths[stops[:-1], stops[1:]].sum()))
    return best


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_small_tours_are_the_shortest(seed: int, back: bool) -> None:
    search, lengths, seen = make(seed, 8, 10, back=back)
    search.run(np.inf, rounds=120)
    assert search.length == pytest.approx(shortest(lengths, seen, back=back), rel=1e-9)
    assert search.measure(search.order) == pytest.approx(search.length)


def test_a_tour_sees_as_much_as_it_must_and_gets_no_longer() -> None:
    search, _, seen = make(5, 60, 80, back=False, share=0.9)
    told: list[float] = []
    search.run(np.inf, rounds=60, found=lambda: told.append(search.length))
    assert told == sorted(told, reverse=True)
    assert len(set(search.order)) == len(search.order)
    weights = np.random.default_rng(5)
    weights.uniform(size=(60, 2))
    weights.uniform(size=(60, 80))
    area = weights.uniform(0.5, 1.5, 80)
    assert area[seen[[0, *search.order]].any(axis=0)].sum() >= 0.9 * area[seen.any(axis=0)].sum() - 1e-9


def test_stops_without_a_way_are_left_out() -> None:
    lengths = np.array([[0.0, 1.0, np.inf], [1.0, 0.0, np.inf], [np.inf, np.inf, 0.0]])
    seen = np.array([[False, False], [True, False], [False, True]])
    search = TourSearch(lengths, seen, np.ones(2), 2.0, back=False, seed=1)
    search.run(np.inf, rounds=3)
    assert search.order == [1]
