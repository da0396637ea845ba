"""Smoothing: shorter paths with rounder corners, every edge of which has passed the same check as in the search."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.edges import EdgeChecker

EdgeCost = Callable[[FloatArray, FloatArray], float]

_PATIENCE = 25  # tries without gain after which shortcutting ends
_LEAST_GAIN = 1e-3  # share of the path's cost that counts as a gain
_CORNER_SHARE = 0.25


def shorten(
    edges: EdgeChecker,
    rows: FloatArray,
    *,
    seed: int,
    tries: int = 150,
    corners: int = 2,
    deadline: float = np.inf,
    cost: EdgeCost | None = None,
) -> FloatArray:
    """Returns a path with the same ends that costs no more, cut short and with its corners rounded.

    First waypoints are left out where the straight way past them is valid, then straight ways between random places
    of the path are tried, then corners are cut. Every edge of what comes out has passed `EdgeChecker.check_edge`.
    The same seed gives the same path unless the deadline cuts in.

    Args:
        edges: Validity of edges.
        rows: Waypoints of a valid path, shape (k, dimension).
        seed: Seed of the random places.
        tries: Largest number of shortcuts tried.
        corners: Rounds of cutting corners.
        deadline: When to end, by time.monotonic().
        cost: Cost of an edge; None for its length in body motion.
    """
    price = cost or _length(edges)
    generator = np.random.default_rng(seed)
    rows = _leave_out(edges, rows, price, deadline)
    rows = _cut_short(edges, rows, price, generator, tries, deadline)
    for _ in range(corners):
        rows = _round_corners(edges, rows, price, deadline)
    return rows


def path_cost(rows: FloatArray, cost: EdgeCost) -> float:
    """Returns the cost of a path of waypoints (k, dimension)."""
    return sum(cost(a, b) for a, b in itertools.pairwise(rows))


def _length(edges: EdgeChecker) -> EdgeCost:
    scale = edges.checker.motion_scale

    def length(row_a: FloatArray, row_b: FloatArray) -> float:
        return float(np.linalg.norm((row_b - row_a) * scale))

    return length


def _leave_out(edges: EdgeChecker, rows: FloatArray, cost: EdgeCost, deadline: float) -> FloatArray:
    """Leaves out waypoints, from the start as many as possible at a time."""
    kept, here = [rows[0]], 0
    while here < len(rows) - 1:
        following = here + 1
        for there in range(len(rows) - 1, here + 1, -1):
            if time.monotonic() >= deadline:
                break
            cheaper = cost(rows[here], rows[there]) <= path_cost(rows[here : there + 1], cost)
            if cheaper and edges.check_edge(rows[here], rows[there]):
                following = there
                break
        kept.append(rows[following])
        here = following
    return np.array(kept)


def _cut_short(
    edges: EdgeChecker,
    rows: FloatArray,
    cost: EdgeCost,
    generator: np.random.Generator,
    tries: int,
    deadline: float,
) -> FloatArray:
    """Tries straight ways between random places of the path, uniform in cost."""
    idle = 0
    for _ in range(tries):
        if len(rows) < 3 or idle >= _PATIENCE or time.monotonic() >= deadline:
            break
        idle += 1
        prices = np.array([cost(a, b) for a, b in itertools.pairwise(rows)])
        ends = np.concatenate([[0.0], np.cumsum(prices)])
        places = np.sort(generator.uniform(0.0, ends[-1], 2))
        legs = np.clip(np.searchsorted(ends, places, side="right") - 1, 0, len(prices) - 1)
        if legs[0] == legs[1]:
            continue
        shares = (places - ends[legs]) / np.maximum(prices[legs], 1e-12)
        cut = rows[legs] + shares[:, None] * (rows[legs + 1] - rows[legs])
        replaced = np.concatenate([rows[: legs[0] + 1], cut, rows[legs[1] + 1 :]])
        gain = ends[-1] - path_cost(replaced, cost)
        touched = replaced[legs[0] : legs[0] + 4]
        if gain > _LEAST_GAIN * ends[-1] and _all_valid(edges, touched, first=1):
            rows, idle = replaced, 0
    return rows


def _all_valid(edges: EdgeChecker, rows: FloatArray, first: int) -> bool:
    """Tests all edges of a few waypoints, the one at `first` before the others since it is the likeliest to fail."""
    legs = [first, *(leg for leg in range(len(rows) - 1) if leg != first)]
    return all(edges.check_edge(rows[leg], rows[leg + 1]) for leg in legs)


def _round_corners(edges: EdgeChecker, rows: FloatArray, cost: EdgeCost, deadline: float) -> FloatArray:
    """Replaces each inner waypoint by two on its edges where the way between them is valid (Chaikin 1974)."""
    if len(rows) < 3:
        return rows
    rounded = [rows[0]]
    for before, corner, after in zip(rows[:-2], rows[1:-1], rows[2:], strict=True):
        first = corner + _CORNER_SHARE * (before - corner)
        second = corner + _CORNER_SHARE * (after - corner)
        around = cost(first, corner) + cost(corner, second)
        changed = np.array([rounded[-1], first, second, after])
        if time.monotonic() < deadline and cost(first, second) <= around and _all_valid(edges, changed, first=1):
            rounded += [first, second]
        else:
            rounded.append(corner)
    return np.array([*rounded, rows[-1]])
