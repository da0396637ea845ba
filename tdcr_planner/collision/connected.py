"""The connected parts of a graph, compiled: which faces or vertices of a mesh hang together."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import IntArray
from tdcr_planner.compiled import njit


def connected_parts(total: int, links: IntArray) -> tuple[int, IntArray]:
    """Returns the number of connected parts of a graph and the part of each node, shape (total,).

    Parts are numbered in the order of their lowest nodes, as `scipy.sparse.csgraph.connected_components` does, whose
    import takes longer than the rest of reading a mesh.

    Args:
        total: Number of nodes.
        links: Pairs of nodes that are joined, shape (e, 2).
    """
    labels = _label(total, np.ascontiguousarray(links, dtype=np.int64))
    return int(labels.max()) + 1 if total else 0, labels


@njit(cache=True, nogil=True)
def _label(total, links):  # type: ignore[no-untyped-def]
    """Joins the nodes' trees, the lower root above the higher one (union-find with path halving)."""
    parent = np.arange(total)
    for k in range(len(links)):
        a, b = links[k, 0], links[k, 1]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        while parent[b] != b:
            parent[b] = parent[parent[b]]
            b = parent[b]
        if a < b:
            parent[b] = a
        else:
            parent[a] = b
    # A root is the lowest node of its part, so it is numbered before the others.
    labels = np.empty(total, np.int64)
    count = 0
    for node in range(total):
        if parent[node] == node:
            labels[node] = count
            count += 1
        else:
            labels[node] = labels[parent[node]]
    return labels
