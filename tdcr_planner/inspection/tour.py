"""The tour: which views to pass, in which order, so that enough is seen on a short way."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray

_MOST_LEFT_OUT = 0.4  # share of the stops that a round leaves out at most
_WARMTH = 0.03  # share of the length by which a round may be worse and still be gone on from, at first
_TOLERANCE = 1e-12


class TourSearch:
    """Looks for a short order of views that sees enough, by ruin and recreate (Schrimpf et al. 2000).

    A round leaves out some neighbouring stops and puts in others, each where it costs least, by what it adds to what is
    seen for its detour, until enough is seen; then stops that are not needed go, and the order is untangled (2-opt).

    Attributes:
        order: The best tour's stops in order; 0, the start, is not among them.
        length: Its length, m; infinity while none sees enough.
    """

    def __init__(
        self, lengths: FloatArray, seen: BoolArray, weights: FloatArray, target: float, *, back: bool, seed: int
    ) -> None:
        """Prepares a search.

        Args:
            lengths: Of the ways between stops, shape (m, m), m; the first is the start.
            seen: What is seen from each stop, shape (m, p).
            weights: Of the points, shape (p,).
            target: Least weight that is to be seen.
            back: Whether the tour ends at the start.
            seed: Of the search.
        """
        self._lengths = lengths
        self._seen = seen
        self._dense = seen.astype(np.float32)
        self._weights = weights
        self._target = min(target, float(weights[seen.any(axis=0)].sum())) - _TOLERANCE
        self._back = back
        self._generator = np.random.default_rng(seed)
        self.order: list[int] = []
        self.length = np.inf

    def run(self, deadline: float, rounds: int = 10**9, found: Callable[[], None] | None = None) -> None:
        """Improves the tour until a time by time.monotonic() or for some rounds; tells of each better one."""
        current = self._finish([])
        price = self.measure(current)
        self.order, self.length = current, price
        if found is not None:
            found()
        for number in range(rounds):
            if time.monotonic() >= deadline or len(self.order) < 1:
                return
            tried = self._finish(self._ruined(current))
            cost = self.measure(tried)
            warmth = _WARMTH * 0.5 ** (number / 200.0)
            if cost < price * (1.0 + warmth * self._generator.uniform()):
                current, price = tried, cost
            if cost < self.length - 1e-9:
                self.order, self.length = tried, cost
                if found is not None:
                    found()

    def measure(self, order: list[int]) -> float:
        """Returns the length of a tour, m."""
        stops = [0, *order, *([0] if self._back else [])]
        return float(self._lengths[stops[:-1], stops[1:]].sum())

    def _ruined(self, order: list[int]) -> list[int]:
        """Returns a tour with neighbouring stops left out."""
        most = max(1, int(_MOST_LEFT_OUT * len(order)))
        count = int(self._generator.integers(1, most + 1))
        if self._generator.uniform() < 0.5:
            first = int(self._generator.integers(len(order)))
            gone = {order[(first + k) % len(order)] for k in range(count)}
        else:
            centre = order[int(self._generator.integers(len(order)))]
            near = sorted(order, key=lambda stop: self._lengths[centre, stop])
            gone = set(near[:count])
        return [stop for stop in order if stop not in gone]

    def _finish(self, order: list[int]) -> list[int]:
        order = self._fill(order)
        order = self._prune(order)
        return self._untangle(order)

    def _fill(self, order: list[int]) -> list[int]:
        """Puts in stops until enough is seen."""
        order = list(order)
        covered = self._seen[[0, *order]].any(axis=0)
        noise = self._generator.uniform(0.8, 1.2, len(self._lengths))
        floor = 1e-3 * float(np.median(self._lengths[np.isfinite(self._lengths)])) + 1e-9
        while float(self._weights[covered].sum()) < self._target:
            gains = self._dense @ np.where(covered, 0.0, self._weights).astype(np.float32)
            detours, places = self._detours(order)
            worth = np.where(gains > 0.0, gains * noise / (np.maximum(detours, 0.0) + floor), -1.0)
            worth[~np.isfinite(detours)] = -1.0
            best = int(worth.argmax())
            if worth[best] <= 0.0:
                break
            order.insert(int(places[best]), best)
            covered |= self._seen[best]
        return order

    def _detours(self, order: list[int]) -> tuple[FloatArray, FloatArray]:
        """Returns what each stop adds to the length, and where it adds least, shape (m,) each."""
        stops = [0, *order]
        ends = [*order, 0] if self._back else order
        to_stops = self._lengths[:, stops]
        added = to_stops.copy()
        between = self._lengths[stops[: len(ends)], ends]
        added[:, : len(ends)] += self._lengths[:, ends] - between
        places = added.argmin(axis=1)
        return added[np.arange(len(added)), places], places

    def _prune(self, order: list[int]) -> list[int]:
        """Leaves out stops that are not needed, the ones that cost most first."""
        counts = self._seen[[0, *order]].sum(axis=0)
        covered = float(self._weights[counts > 0].sum())
        gone = True
        while gone:
            gone = False
            savings = []
            for index in range(len(order)):
                shorter = order[:index] + order[index + 1 :]
                savings.append((self.measure(order) - self.measure(shorter), index))
            for _, index in sorted(savings, reverse=True):
                only = self._seen[order[index]] & (counts == 1)
                lost = float(self._weights[only].sum())
                if covered - lost >= self._target:
                    counts = counts - self._seen[order[index]]
                    covered -= lost
                    order = order[:index] + order[index + 1 :]
                    gone = True
                    break
        return order

    def _untangle(self, order: list[int]) -> list[int]:
        """Reverses stretches of the tour while that shortens it (2-opt)."""
        stops = np.array([0, *order, *([0] if self._back else [])])
        improved = len(order) > 1
        while improved:
            improved = False
            for i in range(1, len(stops) - 1):
                # Reversing stops[i : j + 1] for every j at once.
                j = np.arange(i + 1, len(stops) - (1 if self._back else 0))
                if not len(j):
                    continue
                last = j + 1 >= len(stops)
                after = stops[np.minimum(j + 1, len(stops) - 1)]
                old = self._lengths[stops[i - 1], stops[i]] + np.where(last, 0.0, self._lengths[stops[j], after])
                new = self._lengths[stops[i - 1], stops[j]] + np.where(last, 0.0, self._lengths[stops[i], after])
                gain = old - new
                best = int(gain.argmax())
                if gain[best] > 1e-9:
                    end = int(j[best]) + 1
                    stops[i:end] = stops[i:end][::-1].copy()
                    improved = True
        inner = stops[1:-1] if self._back else stops[1:]
        return [int(stop) for stop in inner]
