"""States held out of a fit: blocks in time, since neighbouring states are alike and would hide what a model misses."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tdcr_planner.arrays import IntArray
from tdcr_planner.calibration.data import MeasuredStates

FOLDS = 6


def blocks_in_time(states: MeasuredStates, folds: int = FOLDS) -> IntArray:
    """Returns the fold of each state, shape (n,): stretches of time of about as many states each.

    Where the file names patterns of motion, a stretch ends with a pattern, so that none is in two folds.

    Args:
        states: The measured states.
        folds: Number of stretches.
    """
    count = len(states)
    ends = list(range(1, count + 1))
    if states.patterns:
        ends = [row + 1 for row, (a, b) in enumerate(pairwise(states.patterns)) if a != b] + [count]
    fold = np.zeros(count, dtype=np.int64)
    places = np.array(ends)
    cuts = {int(places[np.argmin(np.abs(places - count * index / folds))]) for index in range(1, folds)}
    for cut in sorted(cuts):
        fold[cut:] += 1
    return fold
