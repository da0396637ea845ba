"""Friction states: which are tried, and what verification makes of them, with a robot driven by displacement."""

import json

import numpy as np
import pytest

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.query.friction_states import describe_state, friction_states
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.report.results import read_result, write_result_data
from tdcr_planner.statics.solver import solve_statics

pytest.importorskip("ompl")

BENT = [[0.002, 0.0], [0.0, 0.001], [0.0, 0.0]]
MORE = [[0.0025, 0.0], [0.0, 0.001], [0.0, 0.0]]


@pytest.fixture
def bench(make_scenario):
    return make_scenario(
        "bench",
        start={"bending_m": BENT},
        goal={"bending_m": MORE},
        planner={"validity": "reference", "time_limit_s": 60.0, "step_m": 0.01},
    )


def test_all_combinations_of_few_tendons_and_some_of_many(bench, make_scenario):
    robot = bench.robot
    states = friction_states(robot)
    assert len(states) == 1 + 2 + 2 * robot.tendon_count + 8
    assert states[0] is None
    few = robot.model_copy(update={"tendons": [table.model_dump() for table in robot.tendon_tables[:3]]})
    assert len(set(friction_states(few))) == 1 + 2**3
    assert friction_states(make_scenario("paper").robot) == [None]
    assert describe_state(("pull", "release")) == "with tendon 2 sliding away from the drive and the others towards it"


def test_a_robot_with_displacement_drive_and_friction_plans_verified(bench, tmp_path):
    result = PlanningSession(bench).plan()
    assert result.status == "verified"
    # q_i = b . (cos a_i, sin a_i): what the result says the drive does is what the configuration asks.
    driven = ConfigurationSpace(bench).coordinates.driven(result.path.drive)
    np.testing.assert_allclose(result.path.tendon_displacements, driven, atol=1e-12)
    assert (result.path.tensions >= 0.0).all()
    write_result_data(result, tmp_path / "out")
    table = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert np.shape(table["path"]["bending_m"])[1:] == (3, 2)
    assert "bending_n" not in table["path"]
    assert table["verification"]["friction"]["spread_m"] > 1e-4
    header = (tmp_path / "out" / "trajectory.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    assert "bending_1_x_m" in header
    again = read_result(tmp_path / "out")
    np.testing.assert_allclose(again.path.drive, result.path.drive)
    assert again.verification.friction == result.verification.friction


def test_the_wrong_key_is_refused_by_name(make_scenario):
    with pytest.raises(FormatError, match="expected bending_m, since robot 'bench' is driven by displacement"):
        make_scenario("bench", start={"bending_n": BENT}, planner={"validity": "reference"})
    with pytest.raises(FormatError, match="expected bending_n"):
        make_scenario("paper", start={"bending_m": [[0.001, 0.0]]})


def test_the_learned_model_says_what_to_use_instead(make_scenario):
    scenario = make_scenario(
        "bench", start={"bending_m": BENT}, goal={"bending_m": MORE}, planner={"validity": "constant_curvature"}
    )
    with pytest.raises(InputError, match="validity = 'reference'"):
        PlanningSession(scenario)


def test_single_tendons_drive_a_robot_whose_tendons_wind(make_scenario):
    scenario = make_scenario(
        "helical",
        start={"tendon_n": [0.0, 0.0, 0.0, 0.0]},
        goal={"tendon_n": [1.0, 0.5, 0.0, 0.0]},
        planner={"validity": "reference", "time_limit_s": 60.0, "step_m": 0.01},
    )
    result = PlanningSession(scenario).plan()
    assert result.status == "verified"
    np.testing.assert_allclose(result.path.tensions[-1], [1.0, 0.5, 0.0, 0.0], atol=1e-9)
    assert result.verification.friction is None


def test_friction_with_displacement_drive_lies_between_the_capstan_bounds(bench):
    space = ConfigurationSpace(bench)
    driven = space.coordinates.driven(space.drive(space.row_of(bench.file.start)[None]))
    free = solve_statics(bench.robot, displacements=driven)
    for friction in ("pull", "release"):
        solution = solve_statics(bench.robot, displacements=driven, friction=friction)
        assert solution.converged.all()
        # A tendon that turns by an angle a in all changes by a factor exp(mu a) at most: mu 0.1, a below 2 rad.
        taut = free.tensions > 0.2
        ratio = solution.tensions[taut] / free.tensions[taut]
        assert (np.abs(np.log(ratio)) < 0.2).all()
        assert (np.abs(np.log(ratio)) > 1e-4).any()
