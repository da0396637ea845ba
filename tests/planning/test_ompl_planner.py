import itertools

import numpy as np
import pytest

from tdcr_planner.planning.ompl_planner import PLANNERS, SearchStatus, search

POST = [[[0.06, 0.06, 0.12], [0.10, 0.10, 0.17]]]
AROUND = {
    "base": {"insertion_m": [0.0, 0.05]},
    "start": {"bending_n": [[0.0, 2.4]]},
    "goal": {"bending_n": [[2.4, 0.0]]},
}


def run(setup, **arguments):
    return search(setup.scenario, setup.space, setup.checker, **arguments)


@pytest.mark.parametrize("name", PLANNERS)
def test_every_offered_planner_finds_a_path_whose_every_edge_is_valid(make_setup, name):
    iterations = {"RRTstar": 40, "InformedRRTstar": 40, "SORRTstar": 40, "AORRTC": 40, "BITstar": 600}.get(name, 0)
    planner = {"name": name, "step_m": 0.01, "parameters": {"iterations": iterations}}
    setup = make_setup(boxes=POST, planner=planner, **AROUND)
    outcome = run(setup, seed=3, time_limit_s=20.0)
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
