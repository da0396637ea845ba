from __future__ import annotations

import itertools

import numpy as np
import pytest

from tdcr_planner.planning.plain_motions import PlainMotions, straightest

BASE = {"insertion_m": [0.0, 0.1], "roll_deg": [-90.0, 90.0]}


def blocked_halfway(make_setup, start, goal, **changes):
    """Returns a setup with a small box about the tip of the configuration halfway between two others."""
    free = make_setup(base=BASE, **changes)
    positions, _, _ = free.checker.world_poses(0.5 * (np.array(start) + np.array(goal))[None])
    tip = positions[0, -1]
    return make_setup(base=BASE, boxes=[[tip - 0.001, tip + 0.001]], **changes)


def test_an_open_way_is_straight(make_setup):
    setup = make_setup(base=BASE)
    start, goal = np.zeros(4), np.array([1.5, 0.0, 0.1, 0.0])
    np.testing.assert_array_equal(PlainMotions(setup.edges).connect(start, [goal], np.inf), [start, goal])


def test_what_is_blocked_halfway_is_passed_in_legs_that_are_valid(make_setup):
    start, goal = np.zeros(4), np.array([3.0, 0.0, 0.1, 0.0])
    setup = blocked_halfway(make_setup, start, goal)
    assert not setup.edges.check_edge(start, goal)
    rows = PlainMotions(setup.edges).connect(start, [goal], np.inf)
    assert len(rows) == 3
    np.testing.assert_array_equal(rows[[0, -1]], [start, goal])
    assert all(setup.edges.check_edge(a, b) for a, b in itertools.pairwise(rows))


def test_the_nearest_goal_state_is_taken_and_none_is_no_motion(make_setup):
    setup = make_setup(base=BASE)
    near, far = np.array([0.2, 0.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.1, 1.0])
    rows = PlainMotions(setup.edges).connect(np.zeros(4), [far, near], np.inf)
    np.testing.assert_array_equal(rows[-1], near)
    assert PlainMotions(setup.edges).connect(np.zeros(4), [], np.inf) is None
    assert PlainMotions(setup.edges).connect(np.zeros(4), [near], -np.inf) is None


def test_the_straightest_shape_without_loads_is_unbent_and_keeps_insertion_and_roll(make_setup):
    setup = make_setup(base=BASE)
    row = np.array([1.0, -0.5, 0.04, 0.3])
    np.testing.assert_array_equal(straightest(setup.checker, row), [0.0, 0.0, 0.04, 0.3])


@pytest.mark.parametrize("begin", [0.0797, 0.0803, 0.0809])
def test_a_straight_pull_out_of_a_hole_is_shown_to_be_free_however_little_room_it_leaves(port, begin):
    setup = port(3.45)
    inside, outside = np.array([[0.0, 0.0, 0.0, 0.0, begin], [0.0, 0.0, 0.0, 0.0, 0.0]])
    assert setup.edges.check_edge(inside, outside)
