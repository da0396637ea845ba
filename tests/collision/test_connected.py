"""Connected parts of graphs, against scipy's."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from tdcr_planner.collision.connected import connected_parts


@settings(deadline=None)  # the first case compiles
@given(st.integers(1, 30), st.lists(st.tuples(st.integers(0, 29), st.integers(0, 29)), max_size=40))
def test_parts_and_their_order_are_those_of_scipy(total, links):
    links = np.array(links, dtype=np.int64).reshape(-1, 2) % total
    count, labels = connected_parts(total, links)
    graph = coo_matrix((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(total, total))
    expected_count, expected = connected_components(graph, directed=False)
    assert count == expected_count
    np.testing.assert_array_equal(labels, expected)


def test_a_graph_without_nodes_has_no_parts():
    count, labels = connected_parts(0, np.empty((0, 2), dtype=np.int64))
    assert (count, len(labels)) == (0, 0)
