from __future__ import annotations

import itertools

import numpy as np
import pytest

from tdcr_planner.planning.goal import TipGoal
from tdcr_planner.planning.planner import SearchStatus
from tdcr_planner.planning.planners import search
from tdcr_planner.planning.relaxation import Relaxation, offers_room, within_limits
from tdcr_planner.planning.retraction import Retraction, thinned


@pytest.fixture(scope="module")
def goal_states(port):
    setup = port()
    source = TipGoal(setup.checker, setup.scenario.goals[0], 1)
    for _ in range(4):
        if not source.rows:
            source.search()
    return source.rows


def test_goal_states_behind_a_narrow_hole_are_found_in_few_rounds(port, goal_states):
    setup = port()
    assert goal_states
    assert setup.checker.valid(np.array(goal_states)).all()
    positions, _, _ = setup.checker.world_poses(np.array(goal_states))
    tolerance = setup.scenario.goals[0].tip_tolerance_m
    assert np.linalg.norm(positions[:, -1] - [0.05, 0.02, 0.0], axis=1).max() <= tolerance


def test_relaxation_never_makes_a_shape_worse_and_frees_what_touches(port, goal_states):
    setup = port()
    generator = np.random.default_rng(1)
    moves = generator.normal(size=(24, 5)) * 5e-4 / setup.checker.motion_scale
    rows = within_limits(setup.checker, goal_states[0] + moves)
    relaxation = Relaxation(setup.checker, 5e-4, 5e-4)
    before, after = relaxation.measure(rows), relaxation.relax(rows, rounds=8, longest=0.005)
    assert (after.costs <= before.costs + 1e-12).all()
    assert setup.checker.valid(after.rows).sum() > setup.checker.valid(rows).sum()
    fixed = relaxation.relax(rows, rounds=3, longest=0.005, fixed=(4,))
    np.testing.assert_array_equal(fixed.rows[:, 4], rows[:, 4])


def test_a_state_behind_a_hole_is_pulled_out_along_valid_edges(port, goal_states):
    setup = port()
    tree = Retraction(setup.edges, goal_states[0], 1)
    tree.grow(150, np.inf)
    insertions = np.array(tree.rows)[:, 4]
    assert insertions.min() < 0.5 * insertions[0]
    chain = tree.chain(int(np.argmin(insertions)))
    np.testing.assert_array_equal(chain[-1], goal_states[0])
    assert all(setup.edges.check_edge(a, b) for a, b in itertools.pairwise(chain))
    short = thinned(setup.edges, chain)
    assert len(short) <= len(chain)
    np.testing.assert_array_equal(short[[0, -1]], chain[[0, -1]])
    assert all(setup.edges.check_edge(a, b) for a, b in itertools.pairwise(short))


def test_the_same_seed_grows_the_same_tree(port, goal_states):
    setup = port()
    one, other = (Retraction(setup.edges, goal_states[0], 2) for _ in range(2))
    for tree in (one, other):
        tree.grow(15, np.inf)
    np.testing.assert_array_equal(one.rows, other.rows)


def test_retraction_answers_where_neither_plain_motions_nor_a_first_tree_do(port):
    setup = port()
    scenario = setup.scenario.with_planner(time_limit_s=200.0, parameters={"plain_motions": False})
    outcome = search(scenario, setup.session.space, setup.session.checker(), seed=1)
    assert outcome.status is SearchStatus.FOUND, outcome.message
    assert outcome.statistics["answered_by"] in ("retraction", "planner")
    if outcome.statistics["answered_by"] == "retraction":
        assert outcome.statistics["retraction"]["states"] > 1
    assert all(setup.edges.check_edge(a, b) for a, b in itertools.pairwise(outcome.rows))


def test_a_hole_too_small_ends_the_search_for_goal_states_with_what_is_missing(port):
    setup = port(2.8)
    outcome = search(setup.scenario, setup.session.space, setup.checker, seed=1, time_limit_s=500.0)
    assert outcome.status is SearchStatus.NO_PATH
    assert outcome.statistics["iterations"] == 0
    assert "plate_2.8.stl" in outcome.message
    assert "required" in outcome.message


def test_a_scene_that_knows_no_rooms_offers_none(make_setup, port):
    assert not offers_room(make_setup().checker)
    assert offers_room(port().checker)
