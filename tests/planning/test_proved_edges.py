from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.planning.proved_edges import ProvedEdges

SCALE = np.array([0.05, 0.04, 1.0, 0.02])
seeds = st.integers(0, 2**32 - 1)


def an_edge(seed):
    generator = np.random.default_rng(seed)
    return generator, *generator.uniform(-3.0, 3.0, (2, len(SCALE)))


@settings(max_examples=100, deadline=None)
@given(seeds)
def test_parts_of_an_edge_are_known_from_either_end_and_in_either_direction(seed):
    generator, a, b = an_edge(seed)
    proved = ProvedEdges()
    proved.add(a, b)
    inside = a + generator.uniform() * (b - a)
    for end in (a, b):
        assert proved.contain(end, inside, SCALE)
        assert proved.contain(inside, end, SCALE)
    assert proved.contain(a, b, SCALE)
    assert proved.contain(b, a, SCALE)


@settings(max_examples=100, deadline=None)
@given(seeds, st.floats(1e-9, 1e-2))
def test_what_leaves_an_edge_or_goes_past_its_end_is_not(seed, off):
    generator, a, b = an_edge(seed)
    proved = ProvedEdges()
    proved.add(a, b)
    inside = a + generator.uniform(0.1, 0.9) * (b - a)
    way = (b - a) * SCALE
    aside = generator.normal(size=len(SCALE))
    aside -= (aside @ way) / (way @ way) * way
    assert not proved.contain(a, inside + off * aside / np.linalg.norm(aside) / SCALE, SCALE)
    assert not proved.contain(a, b + off * (b - a), SCALE)
    assert not proved.contain(a, a - off * (b - a), SCALE)


def test_a_part_within_an_edge_that_shares_no_end_with_it_is_not_known():
    _, a, b = an_edge(1)
    proved = ProvedEdges()
    proved.add(a, b)
    assert not proved.contain(a + 0.25 * (b - a), a + 0.75 * (b - a), SCALE)


@pytest.mark.parametrize("count", [3, 40])
def test_the_last_edges_of_an_end_are_kept(count):
    generator, a, _ = an_edge(2)
    others = generator.uniform(-3.0, 3.0, (count, len(SCALE)))
    proved = ProvedEdges()
    for other in others:
        proved.add(a, other)
    assert all(proved.contain(a, 0.5 * (a + other), SCALE) for other in others[-3:])


def test_an_edge_without_length_is_known_at_an_end_of_a_proved_edge_only():
    _, a, b = an_edge(3)
    proved = ProvedEdges()
    assert not proved.contain(a, a, SCALE)
    proved.add(a, b)
    assert proved.contain(a, a, SCALE)
    assert not proved.contain(0.5 * (a + b), 0.5 * (a + b), SCALE)
