"""Proposed scenarios read back as what was proposed."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.collision.meshes import Entry
from tdcr_planner.robot import load_robot
from tdcr_planner.survey.centreline import Centreline
from tdcr_planner.survey.proposal import propose, quoted, relative_name, vector
from tdcr_planner.survey.sized_robot import DIAMETER_FRACTION, sized_robot

LINE = Centreline(
    np.stack([np.linspace(0.0, 0.2, 21), np.zeros(21), np.zeros(21)], axis=1),
    np.full(21, 0.01),
    np.linspace(0, 0.2, 21),
)
ENTRY = Entry(np.array([0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))


@given(st.text())
def test_any_text_is_quoted_as_toml_reads_it(text: str) -> None:
    assert tomllib.loads(f"x = {quoted(text)}")["x"] == text


@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
def test_vectors_keep_seven_digits(values: list[float]) -> None:
    assert tomllib.loads(f"x = {vector(np.array(values))}")["x"] == pytest.approx(values, rel=1e-6)


def test_goals_lie_on_the_line_within_reach_the_deepest_first(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(sized_robot(0.02))
    robot = load_robot(file)
    proposals = propose(ENTRY, LINE, robot, "[[meshes]]\n", "robot.toml", None)
    depths = [proposal.goal[0] for proposal in proposals]
    assert depths == sorted(depths, reverse=True)
    table = tomllib.loads(proposals[0].to_toml('a "title"'))
    assert table["title"] == 'a "title"'
    assert table["planner"]["validity"] == "reference"
    # At insertion 0 the straight robot ends before the mouth; fully in, its base is still outside.
    base, travel = table["base"]["position_m"][0], table["base"]["insertion_m"][1]
    assert base + robot.length < 0.0
    assert base + travel < 0.0
    assert depths[0] <= base + travel + robot.length


@pytest.mark.parametrize("mouth", [0.004, 0.02, 0.3])
def test_a_sized_robot_fits_its_mouth(mouth: float, tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(sized_robot(mouth))
    assert 2.0 * load_robot(file).disk_radii.max() == pytest.approx(DIAMETER_FRACTION * mouth, rel=1e-5)


def test_names_are_relative_to_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    assert relative_name(tmp_path / "a.stl", tmp_path / "out") == "../a.stl"
