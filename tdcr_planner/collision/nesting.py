"""Which box lies in which: the smallest of larger boxes around each of many, found through a tree of boxes."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.compiled import njit

# Cells of the space-filling curve along each axis that orders the boxes: 2 ** 10.
_BITS = 10


def enclosing_boxes(lower: FloatArray, upper: FloatArray, rank: IntArray) -> IntArray:
    """Returns for each box the one of the next lower rank that contains it, or -1, shape (n,).

    Args:
        lower: Lower corners, shape (n, 3).
        upper: Upper corners, shape (n, 3).
        rank: A permutation of 0 to n - 1, shape (n,): only boxes of a lower rank than a box's own may contain it.
    """
    order = _along_curve(0.5 * (lower + upper))
    leaves = 1 << max(0, len(order) - 1).bit_length()
    node_lower, node_upper = np.full((2 * leaves, 3), np.inf), np.full((2 * leaves, 3), -np.inf)
    least, most = np.full(2 * leaves, len(order)), np.full(2 * leaves, -1)
    filled = slice(leaves, leaves + len(order))
    node_lower[filled], node_upper[filled] = lower[order], upper[order]
    least[filled], most[filled] = rank[order], rank[order]
    begin = leaves
    while begin > 1:  # level by level up to the root, node 1; the children of node k are 2 k and 2 k + 1
        left, right, level = slice(begin, 2 * begin, 2), slice(begin + 1, 2 * begin, 2), slice(begin // 2, begin)
        node_lower[level] = np.minimum(node_lower[left], node_lower[right])
        node_upper[level] = np.maximum(node_upper[left], node_upper[right])
        least[level] = np.minimum(least[left], least[right])
        most[level] = np.maximum(most[left], most[right])
        begin //= 2
    return np.asarray(_search(lower, upper, rank, node_lower, node_upper, least, most, order, leaves))


def _along_curve(points: FloatArray) -> IntArray:
    """Returns the order of points, shape (n, 3), along a curve that keeps neighbours together (Morton 1966)."""
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    cells = ((points - low) / np.where(extent > 0.0, extent, 1.0) * ((1 << _BITS) - 1)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


@njit(cache=True, nogil=True)
def _search(lower, upper, rank, node_lower, node_upper, least, most, order, leaves):  # type: ignore[no-untyped-def]
    found = np.full(len(rank), -1, np.int64)
    stack = np.empty(128, np.int64)
    for i in range(len(rank)):
        best = -1
        stack[0] = 1
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if least[node] >= rank[i] or most[node] <= best:
                continue
            within = True
            for a in range(3):
                if node_lower[node, a] > lower[i, a] or node_upper[node, a] < upper[i, a]:
                    within = False
            if not within:
                continue
            if node >= leaves:
                other = order[node - leaves]
                if rank[other] < rank[i]:
                    best = rank[other]
                    found[i] = other
                continue
            stack[top], stack[top + 1] = 2 * node, 2 * node + 1
            top += 2
    return found
