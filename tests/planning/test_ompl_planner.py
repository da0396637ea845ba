from __future__ import annotations

import itertools
import os
import re
import signal
import time

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.planning.offered import OMPL_TRAITS as PLANNERS
from tdcr_planner.planning.offered import REFUSED
from tdcr_planner.planning.planner import SearchStatus
from tdcr_planner.planning.planners import find_planner, search

POST = [[[0.06, 0.06, 0.12], [0.10, 0.10, 0.17]]]
AROUND = {
    "base": {"insertion_m": [0.0, 0.05]},
    "start": {"bending_n": [[0.0, 2.4]]},
    "goal": {"bending_n": [[2.4, 0.0]]},
}


# Those that improve their path until the time is over end by iterations here, which makes them repeatable.
PARAMETERS = {
    **{key: {"iterations": 80, "range": 0.1} for key in ("RRTstar", "InformedRRTstar", "SORRTstar")},
    "AORRTC": {"iterations": 80},
    "BITstar": {"iterations": 400},
}


def run(setup, **arguments):
    return search(setup.scenario, setup.space, setup.checker, **arguments)


@pytest.mark.parametrize("name", PLANNERS)
def test_every_offered_planner_finds_a_path_whose_every_edge_is_valid(make_setup, name):
    parameters = {"num_samples": 200} if "FMT" in name else PARAMETERS.get(name, {})
    parameters = {**parameters, "plain_motions": False}
    setup = make_setup(boxes=POST, planner={"name": name, "step_m": 0.01, "parameters": parameters}, **AROUND)
    outcome = run(setup, seed=3, time_limit_s=30.0)
    assert outcome.status is SearchStatus.FOUND, outcome.message
    assert outcome.found
    assert np.array_equal(outcome.rows[0], [0.0, 2.4, 0.0])
    assert np.array_equal(outcome.rows[-1], [2.4, 0.0, 0.0])
    # Independent of the edge checker: 500 states an edge keep the clearance asked for.
    fine = np.concatenate(
        [a + np.linspace(0.0, 1.0, 500)[:, None] * (b - a) for a, b in itertools.pairwise(outcome.rows)]
    )
    positions, rotations, _ = setup.checker.world_poses(fine)
    assert setup.scene.clearance(positions, rotations).min() > setup.scenario.planner.clearance_m
    assert outcome.statistics["name"] == name
    assert outcome.statistics["states_checked"] > 0
    assert outcome.statistics["edges_checked"] > 0


def test_the_straight_way_is_blocked(make_setup):
    setup = make_setup(boxes=POST, **AROUND)
    assert not setup.edges.check_edge(np.array([0.0, 2.4, 0.0]), np.array([2.4, 0.0, 0.0]))


@pytest.mark.parametrize("name", [name for name in PLANNERS if name not in ("FMT", "BFMT")])
def test_the_same_seed_gives_the_same_path(make_setup, name):
    planner = {"name": name, "step_m": 0.02, "parameters": {**PARAMETERS.get(name, {}), "plain_motions": False}}
    setup = make_setup(boxes=POST, planner=planner, **AROUND)
    first, again, other = (run(setup, seed=seed, time_limit_s=30.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.rows, again.rows)
    assert first.rows.shape != other.rows.shape or not np.allclose(first.rows, other.rows)


class BrokenError(Exception):
    pass


@pytest.mark.parametrize("name", PLANNERS)
def test_an_exception_in_a_callback_ends_the_search_and_comes_out(make_setup, name):
    planner = {"name": name, "step_m": 0.02, "parameters": {"plain_motions": False}}
    setup = make_setup(boxes=POST, planner=planner, **AROUND)
    run(setup, seed=1, time_limit_s=0.05)  # start and goal are asked outside of OMPL
    ask = setup.scene.check
    calls = []

    def fail(positions, rotations):
        calls.append(len(positions))
        if len(calls) == 12:
            raise BrokenError("no answer")
        assert len(calls) < 12, "asked again after the error"
        return ask(positions, rotations)

    setup.scene.check = fail
    with pytest.raises(BrokenError, match="no answer"):
        run(setup, seed=1, time_limit_s=30.0)


@pytest.mark.parametrize("name", PLANNERS)
def test_ctrl_c_ends_the_search(make_setup, name, as_in_a_terminal):
    planner = {"name": name, "step_m": 0.02, "parameters": {"plain_motions": False}}
    setup = make_setup(boxes=POST, planner=planner, **AROUND)
    ask = setup.scene.check
    calls = []

    def interrupt(positions, rotations):
        calls.append(1)
        if len(calls) == 10:
            os.kill(os.getpid(), signal.SIGINT)
        return ask(positions, rotations)

    setup.scene.check = interrupt
    with pytest.raises(KeyboardInterrupt):
        run(setup, seed=1, time_limit_s=30.0)


def test_a_progress_callback_sees_the_time_pass_and_may_end_the_search(make_setup):
    enclosed = {**AROUND, "goal": {"bending_n": [[2.4, 0.0]], "insertion_m": 0.05}}
    wall = [[[0.03, -0.2, 0.05], [0.031, 0.2, 0.4]]]
    setup = make_setup(boxes=wall, planner={"step_m": 0.02}, **enclosed)
    setup.scene.margins = np.full_like(setup.scene.margins, 1e-4)
    seen = []
    outcome = run(setup, seed=1, time_limit_s=0.6, progress=lambda share, text: seen.append((share, text)))
    assert outcome.status in (SearchStatus.NO_PATH, SearchStatus.INVALID_GOAL)

    def stop(share, text):
        raise BrokenError

    if seen:
        assert [share for share, _ in seen] == sorted(share for share, _ in seen)
        assert "edges" in seen[0][1]
        with pytest.raises(BrokenError):
            run(setup, seed=1, time_limit_s=5.0, progress=stop)


@pytest.mark.parametrize("name", ["RRTconnect", "PRM", "LazyPRM", "Dijkstra"])
def test_planners_that_are_not_offered_are_refused_with_the_reason(name):
    with pytest.raises(InputError, match="valid: AORRTC") as caught:
        find_planner(name)
    assert ("did you mean 'RRTConnect'" in str(caught.value)) == (name == "RRTconnect")
    assert (REFUSED.get(name, "nothing") in str(caught.value)) == (name in REFUSED)


@pytest.mark.parametrize("name", PLANNERS)
def test_parameters_reach_the_planner_and_wrong_ones_are_named(name):
    known = find_planner(name).parameters()
    assert known
    samples = {bool: True, int: 3, float: 0.5}
    find_planner(name).check_parameters({key: samples[kind] for key, kind in known.items()})
    for key, kind in known.items():
        wrong = "yes" if kind is not bool else 1
        with pytest.raises(InputError, match=key):
            find_planner(name).check_parameters({key: wrong})
    with pytest.raises(InputError, match="did you mean"):
        find_planner(name).check_parameters({f"{next(iter(known))}x": 1})


def test_parameters_change_the_search(make_setup):
    lengths = {}
    for reach in (0.02, 0.2):
        planner = {"name": "RRT", "step_m": 0.02, "parameters": {"range": reach, "plain_motions": False}}
        setup = make_setup(boxes=POST, planner=planner, **AROUND)
        lengths[reach] = run(setup, seed=1, time_limit_s=30.0).statistics["iterations"]
    assert lengths[0.02] > 2 * lengths[0.2]


def test_an_invalid_start_names_disk_and_mesh(make_setup):
    setup = make_setup(boxes=[[[-0.02, -0.02, 0.1], [0.02, 0.02, 0.12]]], start={"bending_n": [[0.0, 0.0]]})
    outcome = run(setup)
    assert outcome.status is SearchStatus.INVALID_START
    assert "disk" in outcome.message
    assert "box.stl" in outcome.message
    assert outcome.rows is None
    assert not outcome.found


def test_an_invalid_goal_configuration_is_named(make_setup):
    setup = make_setup(boxes=[[[0.08, -0.1, 0.0], [0.2, 0.1, 0.3]]], goal={"bending_n": [[2.5, 0.0]]})
    outcome = run(setup)
    assert outcome.status is SearchStatus.INVALID_GOAL
    assert "box.stl" in outcome.message


def test_a_tip_goal_out_of_reach_is_an_invalid_goal(make_setup):
    outcome = run(make_setup(goal={"tip_position_m": [0.0, 0.0, 0.5]}))
    assert outcome.status is SearchStatus.INVALID_GOAL
    assert "nearest" in outcome.message


def test_a_tip_goal_that_is_reached_only_in_collision_is_no_path(make_setup):
    # The goal lies inside a box: shapes reach it, none of them free.
    target = [0.1, 0.0, 0.16]
    box = [[[0.085, -0.015, 0.145], [0.115, 0.015, 0.175]]]
    outcome = run(make_setup(goal={"tip_position_m": target}, boxes=box), time_limit_s=1.0)
    free = run(make_setup(goal={"tip_position_m": target}), time_limit_s=1.0)
    assert free.status is SearchStatus.FOUND
    assert outcome.status is SearchStatus.NO_PATH
    assert re.search(r"free of collision \(\d+ that reach it were tried; in the way of one: obstacle", outcome.message)


def test_a_reachable_goal_behind_a_wall_is_no_path(make_setup):
    # The plate stands in the plane between start and goal, and no arc within the tension limits stays below it.
    plate = [[[-0.0005, -0.3, 0.1], [0.0005, 0.3, 0.4]]]
    ends = {"start": {"bending_n": [[-2.8, 0.0]]}, "goal": {"bending_n": [[2.8, 0.0]]}}
    setup = make_setup(boxes=plate, planner={"step_m": 0.01}, **ends)
    outcome = run(setup, seed=1, time_limit_s=1.0)
    assert outcome.status is SearchStatus.NO_PATH
    assert re.search(r"within the time given; states were rejected most often for obstacle \([\d,]+\)", outcome.message)
    assert outcome.statistics["rejected"]["obstacle"] > 0


@pytest.mark.parametrize("name", ["RRTConnect", "RRT", "RRTstar", "BITstar", "KPIECE1"])
def test_a_tip_goal_is_reached(make_setup, name):
    target = [0.08, 0.0, 0.2]
    planner = {"name": name, "step_m": 0.01, "parameters": PARAMETERS.get(name, {})}
    base = {"insertion_m": [0.0, 0.05]}
    setup = make_setup(boxes=POST, planner=planner, base=base, start=AROUND["start"], goal={"tip_position_m": target})
    outcome = run(setup, seed=1, time_limit_s=30.0)
    assert outcome.found, outcome.message
    positions, _, _ = setup.checker.world_poses(outcome.rows[-1:])
    assert np.linalg.norm(positions[0, -1] - target) <= 0.002
    assert outcome.statistics["goal_states"] >= 1


def test_a_tour_visits_its_goals_in_the_order_given_or_in_the_best(make_setup):
    goals = [{"bending_n": [[x, 0.0]]} for x in (2.0, -2.0, 1.0, -1.0)]
    tour = {"goals": goals, "start": {"bending_n": [[0.1, 0.0]]}, "planner": {"step_m": 0.01}}
    ways = {}
    for order in ("given", "best"):
        setup = make_setup(goal_order=order, **tour)
        outcome = run(setup, seed=1)
        assert outcome.found
        for index, number in zip(outcome.goals, outcome.order, strict=True):
            np.testing.assert_allclose(outcome.rows[index], [*goals[number]["bending_n"][0]], atol=1e-12)
        stops = [0.1, *(goals[number]["bending_n"][0][0] for number in outcome.order)]
        ways[order] = np.abs(np.diff(stops)).sum()
        assert order == "best" or outcome.order == (0, 1, 2, 3)
    # From 0.1 to 2 and back down to -2 (or the other way round with the nearer end last) there is no shorter way.
    assert ways["best"] == pytest.approx(1.9 + 4.0)
    assert ways["given"] == pytest.approx(1.9 + 4.0 + 3.0 + 2.0)


def test_a_long_tour_is_ordered_as_well(make_setup):
    angles = np.deg2rad([0, 160, 40, 200, 80, 240, 120, 280])
    goals = [{"bending_n": [[2.0 * np.cos(a), 2.0 * np.sin(a)]]} for a in angles]
    setup = make_setup(goals=goals, goal_order="best", start={"bending_n": [[2.0, 0.0]]})
    outcome = run(setup, seed=1)
    assert outcome.order == (0, 2, 4, 6, 1, 3, 5, 7)


def test_an_open_way_is_answered_without_a_tree_and_an_improving_planner_has_nothing_to_improve(make_setup):
    for name in ("RRTConnect", "RRTstar"):
        outcome = run(make_setup(planner={"name": name, "step_m": 0.02}, **AROUND), seed=1, time_limit_s=30.0)
        assert len(outcome.rows) == 2
        assert outcome.statistics["answered_by"] == "plain_motions"
        assert outcome.statistics["iterations"] == 0


def test_an_improving_planner_returns_no_worse_than_the_plain_motion(make_setup):
    lengths = {}
    for plain in (True, False):
        parameters = {"iterations": 20, "range": 0.1, "plain_motions": plain}
        setup = make_setup(boxes=POST, planner={"name": "RRTstar", "step_m": 0.02, "parameters": parameters}, **AROUND)
        outcome = run(setup, seed=2, time_limit_s=30.0)
        scaled = outcome.rows * setup.checker.motion_scale if outcome.found else np.array([[0.0], [np.inf]])
        lengths[plain] = np.linalg.norm(np.diff(scaled, axis=0), axis=1).sum()
    # Shortening draws its places at random, so that equal ways may end a little apart.
    assert lengths[True] <= 1.1 * lengths[False]


def test_start_and_goal_may_be_the_same(make_setup):
    setup = make_setup(goal={"bending_n": [[0.0, 0.0]]})
    outcome = run(setup)
    assert outcome.found
    assert np.abs(outcome.rows).max() == 0.0


def test_a_time_limit_is_kept(make_setup):
    planner = {"name": "RRTstar", "step_m": 0.02, "parameters": {"plain_motions": False}}
    setup = make_setup(planner=planner, **AROUND)
    setup.edges.check_edge(np.array([0.0, 2.4, 0.0]), np.array([0.0, 2.0, 0.0]))  # compiles what is not yet compiled
    begin = time.monotonic()
    assert run(setup, seed=1, time_limit_s=1.0).found
    # A tenth is left to shortening; one edge or one round of goal states may still be under way when the time is over.
    assert 0.85 < time.monotonic() - begin < 6.0


@pytest.mark.parametrize("name", ["RRTstar", "SORRTstar"])
def test_a_planner_that_takes_all_of_its_time_leaves_some_for_shortening(make_setup, name):
    parameters = {"range": 0.02, "plain_motions": False}
    setup = make_setup(planner={"name": name, "step_m": 0.02, "parameters": parameters}, **AROUND)
    np.testing.assert_allclose(run(setup, seed=1, time_limit_s=1.5).rows, [[0.0, 2.4, 0.0], [2.4, 0.0, 0.0]])
