"""Tours: the order of goals that makes the way through all of them shortest."""

from __future__ import annotations

import itertools

import numpy as np

from tdcr_planner.arrays import FloatArray

MOST_EXACT = 10


def best_order(between: FloatArray, most_exact: int = MOST_EXACT) -> tuple[int, ...]:
    """Returns the order in which an open tour from the start through all goals is shortest.

    For up to `most_exact` goals it is the shortest of all orders (dynamic programming over sets of goals: Held and Karp
    1962). For more it is the order that takes the nearest goal next, improved until turning a part of it round or
    moving a goal elsewhere gains nothing.

    Args:
        between: Distances between places, shape (n + 1, n + 1), symmetric; place 0 is the start, place i + 1 is goal i.
        most_exact: Largest number of goals of which all orders are compared.
    """
    if len(between) <= 1:
        return ()
    return _shortest(between) if len(between) <= most_exact + 1 else _improved(between, _nearest_next(between))


def tour_length(between: FloatArray, order: tuple[int, ...]) -> float:
    """Returns the length of the tour from the start through goals in an order; see `best_order`."""
    stops = [0, *(index + 1 for index in order)]
    return float(sum(between[a, b] for a, b in itertools.pairwise(stops)))


def _shortest(between: FloatArray) -> tuple[int, ...]:
    count = len(between) - 1
    legs = between[1:, 1:]
    # Of each set of goals (a bit a goal) and the goal that it ends at: the least length, and the goal before.
    length = np.full((1 << count, count), np.inf)
    before = np.zeros((1 << count, count), dtype=int)
    for goal in range(count):
        length[1 << goal, goal] = between[0, goal + 1]
    for visited in range(1, 1 << count):
        onward = length[visited][:, None] + legs
        nearest = onward.argmin(axis=0)
        for goal in range(count):
            more = visited | 1 << goal
            if more != visited and onward[nearest[goal], goal] < length[more, goal]:
                length[more, goal], before[more, goal] = onward[nearest[goal], goal], nearest[goal]
    visited = (1 << count) - 1
    order = [int(length[visited].argmin())]
    while len(order) < count:
        here = order[-1]
        order.append(int(before[visited, here]))
        visited ^= 1 << here
    return tuple(reversed(order))


def _nearest_next(between: FloatArray) -> tuple[int, ...]:
    left = list(range(1, len(between)))
    places = [0]
    while left:
        places.append(min(left, key=lambda place: float(between[places[-1], place])))
        left.remove(places[-1])
    return tuple(place - 1 for place in places[1:])


def _improved(between: FloatArray, order: tuple[int, ...]) -> tuple[int, ...]:
    least = tour_length(between, order)
    while True:
        changed = min(_changes(order), key=lambda other: tour_length(between, other))
        length = tour_length(between, changed)
        if length >= least * (1.0 - 1e-12):
            return order
        order, least = changed, length


def _changes(order: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Returns the orders with one part turned round, and those with one goal moved to another place."""
    count = len(order)
    turned = [
        order[:first] + order[first : last + 1][::-1] + order[last + 1 :]
        for first, last in itertools.combinations(range(count), 2)
    ]
    moved = []
    for here in range(count):
        others = order[:here] + order[here + 1 :]
        moved += [(*others[:there], order[here], *others[there:]) for there in range(count) if there != here]
    return turned + moved
