from __future__ import annotations

import pytest

from tdcr_planner.planning.planner import SearchStatus
from tdcr_planner.planning.planners import search
from tdcr_planner.planning.refusals import impossible_tip, missed_entries


def test_a_tip_position_inside_of_a_wall_is_refused_at_once_with_the_missing_distance(port):
    setup = port(goal=(0.005, 0.02, 0.0))
    message = impossible_tip(setup.checker, setup.scenario.goals[0])
    # 5 mm deep; 0.5 mm of disk and 0.1 mm of margin less 2 mm of tolerance
    assert "5 mm on the wrong side of plate_4.8.stl" in message
    assert "lacks 3.6 mm" in message
    outcome = search(setup.scenario, setup.session.space, setup.checker, seed=1)
    assert outcome.status is SearchStatus.INVALID_GOAL
    assert message in outcome.message


@pytest.mark.parametrize("goal", [(0.05, 0.02, 0.0), (0.012, 0.02, 0.0)])
def test_a_tip_position_that_the_tolerance_frees_is_not_refused(port, goal):
    setup = port(goal=goal)
    assert impossible_tip(setup.checker, setup.scenario.goals[0]) == ""


def test_scenes_without_meshes_or_entries_refuse_nothing(make_setup, port):
    setup = make_setup(goal={"tip_position_m": [0.0, 0.0, 0.2]})
    assert impossible_tip(setup.checker, setup.scenario.goals[0]) == ""
    assert missed_entries(setup.checker) == ""
    assert missed_entries(port().checker) == ""
