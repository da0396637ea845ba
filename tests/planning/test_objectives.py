from __future__ import annotations

import itertools

import numpy as np
import pytest

from tdcr_planner.planning.objectives import NEAR_M, Objective, PathCost
from tdcr_planner.planning.planners import search
from tdcr_planner.planning.smoothing import path_cost

POST = [[[0.06, 0.06, 0.12], [0.10, 0.10, 0.17]]]
ENDS = {"start": {"bending_n": [[0.0, 2.4]]}, "goal": {"bending_n": [[2.4, 0.0]]}}


def cost_of(setup, **weights):
    return PathCost(Objective(**weights), setup.checker)


def test_length_is_body_motion(make_setup):
    setup = make_setup(base={"insertion_m": [0.0, 0.1]})
    cost = cost_of(setup, length=2.0)
    assert cost.plain
    # Inserting by 50 mm moves every point by 50 mm.
    assert cost.edge(np.zeros(3), np.array([0.0, 0.0, 0.05])) == pytest.approx(0.1, rel=1e-5)
    assert cost.edge(np.zeros(3), np.zeros(3)) == 0.0


def test_effort_is_the_sum_of_tensions(make_setup):
    cost = cost_of(make_setup(), length=0.0, effort=3.0)
    assert cost.state(np.array([0.0, 2.0])) == pytest.approx(6.0)
    assert cost.state(np.zeros(2)) == 0.0
    # Opposite to tendon 1 the other two share the work: 2 N each for a bending vector of 2 N.
    assert cost.state(np.array([0.0, -2.0])) == pytest.approx(12.0)


def test_nearness_is_one_at_a_surface_and_a_half_at_its_scale(make_setup):
    # The straight robot's disks end 10 mm beside the axis.
    for gap, expected in ((1e-9, 1.0), (NEAR_M, 0.5), (3 * NEAR_M, 0.25)):
        setup = make_setup(boxes=[[[0.01 + gap, -0.1, 0.0], [0.2, 0.1, 0.3]]])
        assert cost_of(setup, clearance=1.0).state(np.zeros(2)) == pytest.approx(expected, rel=1e-6)


def test_an_edge_never_costs_less_than_its_heuristic(make_setup, random):
    setup = make_setup(boxes=POST)
    cost = cost_of(setup, length=1.0, clearance=2.0, effort=0.5)
    for row_a, row_b in itertools.pairwise(random.uniform(-2.0, 2.0, (20, 2))):
        assert cost.edge(row_a, row_b) >= cost.length(row_a, row_b)
        assert cost.edge(row_a, row_b) == pytest.approx(cost.edge(row_b, row_a))


@pytest.mark.parametrize("name", ["RRTstar", "InformedRRTstar", "SORRTstar", "RRTConnect"])
@pytest.mark.parametrize("weights", [{"clearance": 20.0}, {"effort": 5.0}])
def test_planners_follow_the_objective(make_setup, name, weights):
    costs = {}
    for label, objective in (("asked", {"length": 0.1, **weights}), ("length", {"length": 1.0})):
        parameters = {"iterations": 150, "range": 0.1} if name != "RRTConnect" else {}
        planner = {"name": name, "step_m": 0.02, "objective": objective, "parameters": parameters}
        setup = make_setup(boxes=POST, planner=planner, **ENDS)
        outcome = search(setup.scenario, setup.space, setup.checker, seed=2, time_limit_s=30.0)
        assert outcome.found
        fine = setup.edges.densify(outcome.rows, 0.01)
        costs[label] = path_cost(fine, cost_of(setup, length=0.1, **weights).edge)
    # A path made for the objective costs no more than one made for length (1 % for what smoothing leaves to chance).
    assert costs["asked"] <= 1.01 * costs["length"]


def test_an_error_in_the_objective_comes_out(make_setup):
    planner = {"name": "RRTstar", "objective": {"clearance": 1.0}, "step_m": 0.02}
    setup = make_setup(boxes=POST, planner=planner, **ENDS)

    def fail(positions, rotations):
        raise OSError("no clearance")

    setup.scene.clearance = fail
    with pytest.raises(OSError, match="no clearance"):
        search(setup.scenario, setup.space, setup.checker, seed=1, time_limit_s=10.0)


# On the straight way between these ends the tip's disk passes some 13 mm beside the box.
BESIDE = {
    "boxes": [[[0.1, -0.1, 0.1], [0.2, 0.1, 0.25]]],
    "start": {"bending_n": [[1.5, -1.5]]},
    "goal": {"bending_n": [[1.5, 1.5]]},
}


@pytest.mark.parametrize("name", ["RRTstar", "InformedRRTstar"])
@pytest.mark.parametrize("weight", ["clearance", "effort"])
def test_weights_buy_clearance_and_lower_tensions(make_setup, name, weight):
    seen = {}
    for label, objective in (("asked", {"length": 0.1, weight: 20.0}), ("length", {"length": 1.0})):
        planner = {"name": name, "step_m": 0.01, "objective": objective, "parameters": {"iterations": 150}}
        setup = make_setup(planner=planner, **BESIDE)
        outcome = search(setup.scenario, setup.space, setup.checker, seed=2, time_limit_s=30.0)
        fine = setup.edges.densify(outcome.rows, 0.002)
        positions, rotations, _ = setup.checker.world_poses(fine)
        moved = np.linalg.norm(np.diff(fine, axis=0) * setup.checker.motion_scale, axis=1)
        gaps = setup.scene.clearance(positions, rotations)
        tensions = setup.space.actuate(fine).tensions.sum(axis=1)
        seen[label] = {
            "length": moved.sum(),
            "clearance": np.average(gaps[1:], weights=moved),
            "effort": np.average(tensions[1:], weights=moved),
        }
    if weight == "clearance":
        assert seen["asked"]["clearance"] > 1.2 * seen["length"]["clearance"]
        assert seen["asked"]["length"] > seen["length"]["length"]
    else:
        assert seen["asked"]["effort"] < seen["length"]["effort"]
