from __future__ import annotations

import time

import numpy as np
import pytest

from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.smoothing import path_cost, shorten

POST = [[[0.06, 0.06, 0.12], [0.10, 0.10, 0.17]]]
# Around the post by way of the straight robot, with a detour.
DETOUR = np.array([[0.0, 2.4], [-0.6, 1.4], [-1.0, 0.0], [-0.4, -1.0], [1.0, -1.0], [2.0, -0.6], [2.4, 0.0]])


def body_length(setup, rows):
    return np.linalg.norm(np.diff(rows, axis=0) * setup.checker.motion_scale, axis=1).sum()


def test_a_detour_is_cut_short_and_stays_valid(make_setup):
    setup = make_setup(boxes=POST, planner={"step_m": 0.005})
    assert setup.edges.path_valid(DETOUR)
    assert not setup.edges.check_edge(DETOUR[0], DETOUR[-1])
    rows = shorten(setup.edges, DETOUR, seed=1)
    np.testing.assert_array_equal(rows[[0, -1]], DETOUR[[0, -1]])
    assert body_length(setup, rows) < 0.75 * body_length(setup, DETOUR)
    # A checker without memory, and the scene itself at states that neither of them chose.
    assert EdgeChecker(setup.checker, 0.005).path_valid(rows)
    fine = EdgeChecker(setup.checker, 0.0003).densify(rows)
    positions, rotations, _ = setup.checker.world_poses(fine)
    assert setup.scene.clearance(positions, rotations).min() >= setup.scenario.planner.clearance_m


def test_nothing_in_the_way_leaves_the_straight_edge(make_setup):
    setup = make_setup(planner={"step_m": 0.005})
    np.testing.assert_array_equal(shorten(setup.edges, DETOUR, seed=1), DETOUR[[0, -1]])


def test_corners_get_rounder(make_setup):
    setup = make_setup(boxes=POST, planner={"step_m": 0.005})

    def sharpest(rows):
        legs = np.diff(rows, axis=0)
        legs /= np.linalg.norm(legs, axis=1)[:, None]
        return np.arccos(np.clip((legs[:-1] * legs[1:]).sum(axis=1), -1.0, 1.0)).max()

    angular = shorten(setup.edges, DETOUR, seed=1, corners=0)
    rounded = shorten(setup.edges, DETOUR, seed=1, corners=2)
    assert sharpest(rounded) < sharpest(angular)
    assert body_length(setup, rounded) < body_length(setup, angular)


def test_the_same_seed_gives_the_same_path(make_setup):
    setup = make_setup(boxes=POST, planner={"step_m": 0.005})
    first, again, other = (shorten(setup.edges, DETOUR, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


def test_a_deadline_that_has_passed_leaves_the_path(make_setup):
    setup = make_setup(boxes=POST)
    np.testing.assert_array_equal(shorten(setup.edges, DETOUR, seed=1, deadline=time.monotonic()), DETOUR)


@pytest.mark.parametrize("count", [1, 2])
def test_short_paths_are_left(make_setup, count):
    setup = make_setup()
    np.testing.assert_array_equal(shorten(setup.edges, DETOUR[:count], seed=1), DETOUR[:count])


def test_a_cost_of_ones_own_decides(make_setup):
    setup = make_setup(planner={"step_m": 0.005})

    def avoid_origin(row_a, row_b):
        share = np.linspace(0.0, 1.0, 50)[:, None]
        places = row_a + share * (row_b - row_a)
        return float(np.linalg.norm(row_b - row_a) * (1.0 / (0.1 + np.linalg.norm(places, axis=1) ** 4)).mean())

    ring = 2.0 * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0.0, np.pi, 7)])
    rows = shorten(setup.edges, ring, seed=1, cost=avoid_origin)
    assert path_cost(rows, avoid_origin) <= path_cost(ring, avoid_origin)
    assert len(rows) > 2
