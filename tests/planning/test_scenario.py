from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.planning.spaces import ConfigurationSpace

Make = Callable[..., Scenario]


def test_a_scenario_resolves_its_files_and_robot(make_scenario: Make, tmp_path: Path) -> None:
    scenario = make_scenario()
    assert scenario.resolve("box.stl") == tmp_path / "box.stl"
    assert scenario.robot.name == "paper"
    assert scenario.shape_model_path is None
    assert len(scenario.sha256) == 64


def test_planner_settings_can_be_replaced_and_stay_checked(make_scenario: Make) -> None:
    scenario = make_scenario()
    assert scenario.with_planner(seed=7).planner.seed == 7
    assert scenario.planner.seed == 1
    with pytest.raises(ValueError, match="seed"):
        scenario.with_planner(seed=-1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": 0}, "planner.seed: expected 1 to 2147483647 .*, got 0"),
        ({"step_m": 1.0}, "planner.step_m: expected less than or equal to 0.1, got 1.0"),
        (
            {"validity": "guess"},
            "planner.validity: expected 'learned', 'reference' or .*, got 'guess'",
        ),
        ({"sed": 1}, r"^planner: got 'sed'; did you mean 'seed'\? valid: "),
    ],
)
def test_settings_that_cannot_be_are_named(make_scenario: Make, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_scenario().with_planner(**changes)


def test_base_frame(make_scenario: Make) -> None:
    half = float(np.sqrt(0.5))
    scenario = make_scenario(base={"position_m": [1.0, 2.0, 3.0], "quaternion_wxyz": [half, 0.0, half, 0.0]})
    np.testing.assert_allclose(scenario.base_rotation @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_array_equal(scenario.base_position, [1, 2, 3])


mesh = {"file": "box.stl", "unit": "mm", "role": "obstacle"}
FAULTS: list[tuple[dict[str, Any], str]] = [
    ({"meshes": [{"file": "box.stl", "role": "obstacle"}]}, "meshes[1].unit: missing, and it is required"),
    ({"meshes": [mesh | {"role": "wall"}]}, "meshes[1].role: expected 'cavity' or 'obstacle', got 'wall'"),
    ({"meshes": [mesh | {"unit": "km"}]}, "meshes[1].unit: input should be 'm', 'cm', 'mm' or 'in', got 'km'"),
    ({"meshes": [mesh | {"file": "none.stl"}]}, "meshes[1].file: no such file"),
    (
        {"meshes": [mesh | {"entry": {"point_m": [0.0, 0, 0], "normal": [0.0, 0, 1]}}]},
        "entry belongs to a mesh of role",
    ),
    ({"robot": "nobot.toml"}, "scenario.toml: robot: no such file: /"),
    ({"base": {"insertion_m": [0, 160]}}, "base.insertion_m: a travel of 160 m is 800 times the robot's length"),
    (
        {"planner": {"name": "os:system", "validity": "reference"}},
        "planner.name: expected a planner's name, got 'os:system'",
    ),
    ({"start": {"bending_n": [0.4, 0.0]}}, "start.bending_n: expected a row [x, y] a segment, such as [[0.4, 0.0]]"),
    ({"gravity_m_s2": 9.81}, "gravity_m_s2: expected a list, got 9.81"),
    ({"start": 0.0}, "start: expected a table of keys, got 0.0"),
    ({"meshes": []}, "meshes: tuple should have at least 1 item"),
    ({"gravty": [0.0, 0.0, 0.0]}, "gravty: unknown key; did you mean 'gravity_m_s2'?"),
    ({"start": {"bending_n": [[0.0, 0.0], [0.0, 0.0]]}}, "start.bending_n: expected 1 rows, one for each segment"),
    ({"start": {"bending_n": [[0.0, 0.0]], "insertion_m": 0.1}}, "start.insertion_m: got 0.1, but [base] has no"),
    (
        {"goal": {"bending_n": [[0.0, 0.0]], "tip_position_m": [0.0, 0, 0]}},
        "exactly one of bending_n and tip_position_m",
    ),
    ({"goal": {"bending_n": [[0.0, 0.0]], "tip_tolerance_m": 0.1}}, "tip_tolerance_m does not belong to a goal"),
    ({"goal": {"tip_position_m": [0.0, 0, 0], "view_tolerance_deg": 5.0}}, "view_tolerance_deg needs a view_direction"),
    ({"goal": {"tip_position_m": [0.0, 0, 0], "view_direction": [0.0, 0, 0]}}, "a direction of length above 0"),
    ({"goals": [{"bending_n": [[0.0, 0.0]]}]}, "expected either one [goal] or a list of [[goals]]"),
    ({"base": {"insertion_m": [0.1, 0.0]}}, "base.insertion_m: expected a range [low, high] with low below high"),
    ({"base": {"quaternion_wxyz": [0.0, 0, 0, 0]}}, "base.quaternion_wxyz: expected a quaternion of length above 0"),
    ({"planner": {"validity": "learned"}}, "shape_model: missing, and planner.validity = 'learned' needs it"),
    ({"planner": {"validity": "magic"}}, "planner.validity: expected 'learned', 'reference'"),
    ({"planner": {"step_m": 0.0}}, "planner.step_m"),
    ({"planner": {"seed": 0}}, "planner.seed"),
    ({"shape_model": "none.pt"}, "shape_model: no such file"),
    ({"format": "tdcr-scenario/9"}, "format: is a tdcr-scenario/9 file, expected tdcr-scenario/1"),
]


@pytest.mark.parametrize(("change", "message"), FAULTS)
def test_faulty_scenarios_are_refused(make_scenario: Make, change: dict[str, Any], message: str) -> None:
    with pytest.raises(FormatError, match=re.escape(message)) as caught:
        make_scenario(**change)
    assert "scenario.toml" in str(caught.value)


def test_a_fault_inside_of_a_list_is_not_counted_against_the_list(make_scenario: Make) -> None:
    with pytest.raises(FormatError) as caught:
        make_scenario(meshes=[{"file": "box.stl", "role": "obstacle"}])
    assert caught.value.place == "meshes[1].unit"
    assert caught.value.problem == "missing, and it is required"


def test_a_file_of_another_format_is_named_as_what_it_is() -> None:
    robot = Path(__file__).parents[2] / "models/robots/paper.toml"
    with pytest.raises(FormatError) as caught:
        load_scenario(robot)
    assert str(caught.value) == f"{robot}: format: is a tdcr-robot/1 file, expected tdcr-scenario/1"


def test_missing_scenario_is_named(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"none\.toml: no such file"):
        load_scenario(tmp_path / "none.toml")


MOVING = {"insertion_m": [0.0, 0.25], "roll_deg": [-12.0, 12.0]}


@pytest.mark.parametrize("end", [-12.0, 12.0])
def test_a_start_within_rounding_of_a_range_end_counts_as_the_end(
    end: float, make_scenario: Make, random: np.random.Generator
) -> None:
    # 1e-9 of the ranges: 24 degrees and 0.25 m.
    for offset in random.uniform(-0.99e-9, 0.99e-9, 5):
        start = {"bending_n": [[0.0, 0.0]], "insertion_m": 0.25 * (1.0 + offset), "roll_deg": end + 24.0 * offset}
        space = ConfigurationSpace(make_scenario(base=MOVING, start=start))
        row = space.row(((0.0, 0.0),), start["insertion_m"], start["roll_deg"])
        assert (row >= space.lower).all()
        assert (row <= space.upper).all()


def test_a_start_beyond_its_range_is_refused(make_scenario: Make) -> None:
    start = {"bending_n": [[0.0, 0.0]], "roll_deg": 12.001}
    with pytest.raises(FormatError, match=re.escape("start.roll_deg: got 12.001, but the range of [base] roll_deg is")):
        make_scenario(base=MOVING, start=start)


def test_lengths_that_a_scenario_leaves_open_follow_the_thinnest_disk(make_scenario: Make) -> None:
    goal = {"tip_position_m": [0.0, 0.0, 0.2]}
    paper = make_scenario(goal=goal)
    assert (paper.planner.step_m, paper.planner.clearance_m) == pytest.approx((0.002, 0.0005))
    assert paper.goals[0].tip_tolerance_m == pytest.approx(0.002)
    thin = make_scenario("two_segment", goal=goal)
    assert (thin.planner.step_m, thin.planner.clearance_m) == pytest.approx((0.0012, 0.0003))
    assert thin.goals[0].tip_tolerance_m == pytest.approx(0.0012)
    stated = make_scenario("two_segment", goal={**goal, "tip_tolerance_m": 0.01})
    assert stated.goals[0].tip_tolerance_m == 0.01


def test_lengths_that_a_scenario_states_stand(make_scenario: Make) -> None:
    planner = {"validity": "constant_curvature", "step_m": 0.003, "clearance_m": 0.0}
    scenario = make_scenario("two_segment", planner=planner)
    assert (scenario.planner.step_m, scenario.planner.clearance_m) == (0.003, 0.0)
    assert scenario.with_planner(seed=3).planner.step_m == 0.003
