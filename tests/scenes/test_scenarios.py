"""The shipped scenarios: each loads, starts as it says it does, and asks for something that can be had."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.sweep.suite import load_suite

SCENES = Path(__file__).resolve().parents[2] / "scenes"
NAMES = sorted(str(path.relative_to(SCENES)) for path in SCENES.glob("*/scenario_*.toml"))
ROLES = {"duct": {"cavity"}, "airway": {"cavity"}, "blades": {"obstacle"}, "port": {"cavity", "obstacle"}}
ROBOTS = {"duct": {"paper", "inspection"}, "airway": {"two_segment"}, "blades": {"inspection"}, "port": {"borescope"}}

# Scenes of real files keep the axes of their files.
FLAT = [name for name in NAMES if name.split("/")[0] in ROLES]


@pytest.mark.parametrize("name", NAMES)
def test_says_what_it_asks(name):
    assert (SCENES / name).read_text(encoding="utf-8").startswith("# ")
    assert load_scenario(SCENES / name).file.title


@pytest.mark.parametrize("name", FLAT)
def test_keeps_the_conventions(name):
    scene = name.split("/")[0]
    scenario = load_scenario(SCENES / name)
    assert scenario.robot.name in ROBOTS[scene]
    assert {mesh.role for mesh in scenario.file.meshes} <= ROLES[scene]
    assert {mesh.unit for mesh in scenario.file.meshes} == {"mm"}
    np.testing.assert_array_equal(scenario.gravity, [0.0, 0.0, -9.81])
    # the robot lies flat: gravity pulls across it
    np.testing.assert_allclose(scenario.base_rotation[:, 2], [1.0, 0.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(scenario.base_rotation[:, 0], [0.0, 0.0, 1.0], atol=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_start_is_as_the_scenario_expects(name, reference_setup):
    setup = reference_setup(name)
    start = setup.scenario.file.start
    row = setup.space.row_of(start)
    expected = setup.scenario.file.expected_status
    assert setup.checker.valid(row[None])[0] == (expected != "invalid_start")


@pytest.mark.parametrize("name", NAMES)
def test_goal_configurations_are_free(name, reference_setup):
    setup = reference_setup(name)
    for goal in setup.scenario.goals:
        if goal.bending_n is not None:
            row = setup.space.row_of(goal)
            assert setup.checker.valid(row[None])[0]


@pytest.mark.parametrize("scene", ROLES)
def test_scene_has_what_people_ask_for(scene):
    files = [load_scenario(SCENES / name).file for name in NAMES if name.startswith(f"{scene}/")]
    assert len(files) >= 6
    assert any(file.base.insertion_m for file in files)
    assert any(goal.tip_position_m for file in files for goal in ([file.goal] if file.goal else file.goals))


def test_scenes_cover_roll_views_tours_and_failures():
    files = {name: load_scenario(SCENES / name).file for name in NAMES}
    assert {name for name in FLAT if files[name].base.roll_deg} == {
        "airway/scenario_roll.toml",
        "blades/scenario_roll.toml",
        "duct/scenario_roll.toml",
    }
    assert sum(bool(file.goal and file.goal.view_direction) for file in files.values()) >= 3
    assert sum(file.goals is not None for file in files.values()) >= 2
    statuses = {name: file.expected_status for name, file in files.items() if file.expected_status != "verified"}
    assert statuses == {"duct/scenario_orifice.toml": "no_path", "blades/scenario_touching.toml": "invalid_start"}


def test_touching_start_names_what_touches(reference_setup):
    setup = reference_setup("blades/scenario_touching.toml")
    start = setup.scenario.file.start
    positions, rotations, _ = setup.checker.world_poses(setup.space.row(start.bending_n, start.insertion_m)[None])
    contact = setup.scene.first_contact(positions[0], rotations[0])
    assert contact.mesh == "casing.stl"
    assert contact.part.startswith(("disk", "gap"))


def test_suite_holds_every_feasible_scenario_in_three_difficulties():
    suite = load_suite(SCENES / "benchmark.toml")
    files = {name: load_scenario(SCENES / name).file for name in NAMES}
    feasible = {name for name, file in files.items() if file.expected_status == "verified" and file.shape_model}
    assert {entry.file for entry in suite.file.scenarios} == feasible
    assert len(feasible) >= 24
    assert suite.difficulties == ("easy", "medium", "hard")
    for scene in ("duct", "airway", "blades", "port"):
        levels = {entry.difficulty for entry in suite.file.scenarios if entry.file.startswith(f"{scene}/")}
        assert levels == {"easy", "medium", "hard"}


def test_suite_and_scenarios_agree_on_the_difficulty():
    for entry in load_suite(SCENES / "benchmark.toml").file.scenarios:
        first = (SCENES / entry.file).read_text(encoding="utf-8").splitlines()[0]
        assert first.lower().startswith(f"# {entry.difficulty}:"), entry.file
