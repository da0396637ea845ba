from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.planning import ompl_run
from tdcr_planner.planning.goal import ConfigurationGoal
from tdcr_planner.planning.objectives import Objective, PathCost
from tdcr_planner.planning.offered import OMPL_TRAITS as PLANNERS
from tdcr_planner.planning.ompl_run import PlannerRun
from tdcr_planner.planning.smoothing import path_cost

POST = [[[0.06, 0.06, 0.12], [0.10, 0.10, 0.17]]]
# No arc within the tension limits gets past the plate between start and goal.
PLATE = [[[-0.0005, -0.3, 0.1], [0.0005, 0.3, 0.4]]]
IMPROVING = ("RRTstar", "InformedRRTstar", "SORRTstar", "BITstar")
ASKING_FOR_COSTS = ("RRTstar", "InformedRRTstar", "SORRTstar", "BITstar", "FMT", "BFMT")


def planner_run(setup, name, *, weights=None, seconds=30.0, progress=None, **parameters):
    cost = PathCost(Objective(**(weights or {})), setup.checker)
    return PlannerRun(setup.checker, setup.edges, name, parameters, time.monotonic() + seconds, cost, progress)


def around_post(make_setup):
    setup = make_setup(boxes=POST, planner={"step_m": 0.02})
    return setup, np.array([0.0, 2.4]), ConfigurationGoal(setup.checker, np.array([2.4, 0.0]))


def beyond_plate(make_setup):
    setup = make_setup(boxes=PLATE, planner={"step_m": 0.02})
    return setup, np.array([-2.8, 0.0]), ConfigurationGoal(setup.checker, np.array([2.8, 0.0]))


class BrokenError(Exception):
    pass


def failing(answer, after):
    """Returns a function that raises at one call and must not be called again after that."""
    calls = itertools.count(1)

    def ask(*arguments):
        number = next(calls)
        assert number <= after, "asked again after the error"
        if number == after:
            raise BrokenError
        return answer(*arguments)

    return ask


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("place", ["state", "edge", "progress", "goal"])
def test_an_error_in_any_callback_ends_the_search_and_comes_out(make_setup, monkeypatch, name, place):
    setup, start, goal = beyond_plate(make_setup)
    run = planner_run(setup, name, **({"num_samples": 100} if "FMT" in name else {}))
    if place == "state":
        monkeypatch.setattr(setup.edges, "state_valid", failing(setup.edges.state_valid, 1))
    elif place == "edge":
        monkeypatch.setattr(setup.edges, "check_edge", failing(setup.edges.check_edge, 5))
    elif place == "progress":
        monkeypatch.setattr(ompl_run, "_PROGRESS_PERIOD_S", -1.0)
        run.progress = failing(lambda share, text: None, 3)
    else:
        monkeypatch.setattr(goal, "due", failing(goal.due, 3))
    with pytest.raises(BrokenError):
        run.run(start, goal, 1)
    # Nothing of it is left: the same run answers the next question.
    monkeypatch.undo()
    run.progress, run.deadline = None, time.monotonic() + 0.05
    assert run.run(start, ConfigurationGoal(setup.checker, np.array([2.8, 0.0])), 1) is None


@pytest.mark.parametrize("name", ASKING_FOR_COSTS)
def test_an_error_in_the_cost_ends_the_search_and_comes_out(make_setup, name):
    setup, start, goal = around_post(make_setup)
    run = planner_run(setup, name, weights={"clearance": 1.0})
    run.cost.edge = failing(run.cost.edge, 4)
    with pytest.raises(BrokenError):
        run.run(start, goal, 1)


@pytest.mark.parametrize("name", ["RRTConnect", "BKPIECE1"])
def test_errors_that_are_kept_do_not_disturb_later_searches(make_setup, name):
    setup, start, goal = beyond_plate(make_setup)
    ask, kept = setup.edges.check_edge, []
    for _ in range(30):
        setup.edges.check_edge = failing(ask, 6)
        goal._taken = False
        with pytest.raises(BrokenError) as caught:
            planner_run(setup, name).run(start, goal, 1)
        kept.append(caught)


INTERRUPTED = """
import runpy, signal, sys, time
import numpy as np
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.goal import ConfigurationGoal
from tdcr_planner.planning.objectives import PathCost
from tdcr_planner.planning.offered import OMPL_TRAITS as PLANNERS
from tdcr_planner.planning.ompl_run import PlannerRun
from tdcr_planner.planning.scenario import Objective, load_scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import ValidityChecker
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

class Plate(runpy.run_path(sys.argv[2])["BoxScene"]):
    def gaps(self, positions, rotations):
        return np.repeat(np.abs(positions[:, -1:, 0]) - 0.005, positions.shape[1] - 1, axis=1)

signal.signal(signal.SIGINT, signal.default_int_handler)
scenario = load_scenario(sys.argv[1])
robot = scenario.robot
plate = Plate(np.empty((0, 2, 3)), np.zeros(robot.disk_count), robot.disk_radii)
checker = ValidityChecker(ConfigurationSpace(scenario), ConstantCurvatureShape(robot), plate)
edges = EdgeChecker(checker, 0.005)
for name in PLANNERS:
    goal = ConfigurationGoal(checker, np.array([2.8, 0.0]))
    cost = PathCost(Objective(clearance=1.0), checker)
    run = PlannerRun(checker, edges, name, {}, time.monotonic() + 60.0, cost)
    try:
        print("ready", name, flush=True)
        run.run(np.array([-2.8, 0.0]), goal, 1)
        print("ended", name, flush=True)
    except KeyboardInterrupt:
        print("stopped", name, flush=True)
"""


def test_ctrl_c_from_outside_ends_every_planner_and_none_takes_the_process_with_it(make_scenario):
    boxes = Path(__file__).with_name("conftest.py")
    command = [sys.executable, "-c", INTERRUPTED, str(make_scenario().path), str(boxes)]
    waits = np.random.default_rng(1).uniform(0.02, 0.3, len(PLANNERS))
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for name, wait in zip(PLANNERS, waits, strict=True):
            assert process.stdout.readline() == f"ready {name}\n"
            time.sleep(wait)
            process.send_signal(signal.SIGINT)
            assert process.stdout.readline() == f"stopped {name}\n"
    assert process.returncode == 0


@pytest.mark.parametrize("name", ["RRTConnect", "RRT", "KPIECE1", "BKPIECE1"])
def test_a_tree_that_takes_too_long_is_started_again_and_all_iterations_count(make_setup, monkeypatch, name):
    setup, start, goal = beyond_plate(make_setup)
    run = planner_run(setup, name, iterations=100)
    built = []
    monkeypatch.setattr(run, "_configure", built.append)
    monkeypatch.setattr(run, "_tree", 10)
    monkeypatch.setattr(run, "_renewal", 10)
    assert run.run(start, goal, 1) is None
    assert run.iterations == 100
    # Trees of 10, 20, 40 and the first 30 iterations of one of 80.
    assert len(built) == 4


@pytest.mark.parametrize("name", ["RRTConnect", "RRT", "KPIECE1"])
def test_a_path_is_found_by_a_later_tree_the_same_for_the_same_seed(make_setup, monkeypatch, name):
    monkeypatch.setattr(ompl_run, "FIRST_TREE", 4)
    monkeypatch.setattr(ompl_run, "_DEFAULT_RANGE", 0.05)
    setup, start, _ = around_post(make_setup)
    found = []
    for _ in range(2):
        run = planner_run(setup, name)
        found.append(run.run(start, ConfigurationGoal(setup.checker, np.array([2.4, 0.0])), 1))
        assert run.iterations > 4
    assert setup.edges.path_valid(found[0])
    np.testing.assert_array_equal(*found)
    np.testing.assert_allclose(found[0][[0, -1]], [[0.0, 2.4], [2.4, 0.0]], atol=1e-9)


@pytest.mark.parametrize(("name", "iterations"), [(name, 300 if name == "BITstar" else 80) for name in IMPROVING])
def test_improving_planners_find_cheaper_paths_with_more_iterations(make_setup, name, iterations):
    costs = []
    for most in (iterations, 5 * iterations):
        setup, start, goal = around_post(make_setup)
        run = planner_run(setup, name, iterations=most)
        costs.append(path_cost(run.run(start, goal, 1), run.cost.edge))
    # The same seed goes the same way and on from there.
    assert costs[1] < costs[0]


def test_kpiece_goes_as_far_as_a_motion_is_valid(make_setup):
    setup, start, goal = beyond_plate(make_setup)
    seen = []
    run = planner_run(setup, "KPIECE1", iterations=200)
    ask = setup.edges.check_edge

    def check(row_a, row_b):
        seen.append((row_a, row_b, ask(row_a, row_b)))
        return seen[-1][2]

    setup.edges.check_edge = check
    run.run(start, goal, 1)
    halved = [
        (first, second)
        for first, second in itertools.pairwise(seen)
        if np.allclose(second[1], 0.5 * (first[0] + first[1])) and np.array_equal(first[0], second[0])
    ]
    assert halved
    assert not any(valid for (_, _, valid), _ in halved)
    # What a shortened motion ends at is where later motions start.
    ends = {row_b.round(9).tobytes() for _, (_, row_b, valid) in halved if valid}
    starts = {row_a.round(9).tobytes() for row_a, _, _ in seen}
    assert ends & starts
    # It is asked for nothing shorter when all of a motion must be valid.
    whole = planner_run(setup, "KPIECE1", iterations=200, min_valid_path_fraction=0.9)
    seen.clear()
    whole.run(start, goal, 1)
    assert not any(
        np.array_equal(first[0], second[0]) and np.allclose(second[1], 0.5 * (first[0] + first[1]))
        for first, second in itertools.pairwise(seen)
    )


def test_no_edge_is_valid_once_the_time_is_over(make_setup):
    # A planner that asks about edges for ever, and never whether to go on, ends by it.
    setup, _, _ = around_post(make_setup)
    run = planner_run(setup, "AORRTC", seconds=-1.0)
    assert not run.edge_valid([0.0, 0.0], [0.0, 0.0])
    assert setup.edges.edges_checked == 0
    assert planner_run(setup, "AORRTC").edge_valid([0.0, 0.0], [0.0, 0.0])
