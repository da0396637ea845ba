"""Proved edges: straight motions that are known to be valid, and with them every part of them."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray

# Motion of the body, m, by which the ends of a part may lie off the edge: rounding stays far below it, and it stays far
# below what the collision tests keep as a spare (`collision.first_look.SPARE`), also where parts of parts are taken.
_OFF_M = 1e-13
_MOST_OTHER_ENDS = 6
_MOST_ENDS = 20_000


class ProvedEdges:
    """Edges that have been proved, found by either end.

    A path that is shortened is cut at places on its own edges, so that most of the edges to be checked are parts of
    edges that are proved already and share an end with them.
    """

    def __init__(self) -> None:
        """Starts with none."""
        self._other_ends: dict[bytes, list[FloatArray]] = {}

    def add(self, row_a: FloatArray, row_b: FloatArray) -> None:
        """Adds an edge between two configurations, shape (dimension,) each."""
        if len(self._other_ends) >= _MOST_ENDS:
            self._other_ends.clear()
        for end, other in ((row_a, row_b), (row_b, row_a)):
            others = self._other_ends.setdefault(end.tobytes(), [])
            others.append(other.copy())
            del others[:-_MOST_OTHER_ENDS]

    def contain(self, row_a: FloatArray, row_b: FloatArray, scale: FloatArray) -> bool:
        """Returns whether an edge is a part of a proved one with which it shares an end.

        Args:
            row_a: Start, shape (dimension,).
            row_b: End, shape (dimension,).
            scale: Motion of the body for one unit of each coordinate, shape (dimension,), m per unit.
        """
        for end, place in ((row_a, row_b), (row_b, row_a)):
            others = self._other_ends.get(end.tobytes())
            if others is not None and _on_one(end, np.array(others), place, scale):
                return True
        return False


def _on_one(end: FloatArray, others: FloatArray, place: FloatArray, scale: FloatArray) -> bool:
    """Returns whether a configuration lies on one of the straight motions from one end to others, (k, dimension)."""
    edges, way = (others - end) * scale, (place - end) * scale
    lengths = np.einsum("ij,ij->i", edges, edges)
    along = edges @ way / np.maximum(lengths, 1e-300)
    off = np.abs(way - np.clip(along, 0.0, 1.0)[:, None] * edges).max(axis=1)
    return bool((off <= _OFF_M).any())
