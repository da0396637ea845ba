import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.planning.planner import SearchOutcome, SearchStatus
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.query.paths import check_outcome

START, GOAL = np.zeros(2), np.array([1.0, 0.0])


def outcome(rows, goals=(1,), order=(0,)):
    return SearchOutcome(SearchStatus.FOUND, "", rows, goals, order)


def test_a_path_from_the_start_to_the_goal_is_taken_as_it_is(make_scenario):
    scenario = make_scenario()
    rows = np.stack([START, GOAL])
    np.testing.assert_array_equal(check_outcome(scenario, ConfigurationSpace(scenario), outcome(rows)), rows)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (outcome(None), "finite rows"),
        (outcome(np.zeros((2, 3))), r"shape \(k, 2\)"),
        (outcome(np.array([START, [np.nan, 0.0]])), "finite rows"),
        (outcome(np.stack([GOAL, GOAL])), "the start"),
        (outcome(np.stack([START, 0.9 * GOAL])), "the goal 1"),
        (outcome(np.stack([START, GOAL]), goals=()), "each of 1 goals"),
        (outcome(np.stack([START, GOAL]), goals=(2,)), "below 2"),
        (outcome(np.stack([START, GOAL]), order=(1,)), "order"),
    ],
)
def test_what_is_no_path_from_start_to_goal_is_refused_and_the_planner_named(make_scenario, answer, message):
    scenario = make_scenario()
    with pytest.raises(InputError, match=f"planner 'RRTConnect'.*{message}"):
        check_outcome(scenario, ConfigurationSpace(scenario), answer)
