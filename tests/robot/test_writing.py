"""A robot that is written reads back equal."""

from __future__ import annotations

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.robot import load_robot, write_robot

NAMES = ["bench", "helical", "paper", "two_segment"]


@pytest.mark.parametrize("name", NAMES)
def test_a_written_robot_is_the_same_robot(root, tmp_path, name):
    robot = load_robot(root / f"models/robots/{name}.toml").scaled(stiffness=1.0 / 3.0, mass=1.1)
    path = tmp_path / "robot.toml"
    write_robot(robot, path, "Calibrated from a file.\n\nThree lines.")
    assert load_robot(path) == robot
    assert path.read_text(encoding="utf-8").startswith("# Calibrated from a file.\n#\n# Three lines.\nformat = ")


def test_points_names_and_tapers_survive(plain, read, tmp_path):
    plain["name"] = 'say "robot" \\ \t ü'
    del plain["backbone"]["radius_m"]
    plain["backbone"]["radius_points_m"] = [[0.0, 0.0006], [0.2, 0.0004]]
    plain["segments"][0] |= {"disk_positions_m": [0.01, 0.03, 0.05, 0.07, 0.1]}
    plain["tendons"][0] = {"segment": 1, "max_tension_n": 5.0, "points_m": [[0.0, 8e-3, 0.0], [0.1, 7e-3, 1e-17]]}
    robot = read(plain)
    write_robot(robot, tmp_path / "robot.toml")
    assert load_robot(tmp_path / "robot.toml") == robot


def test_a_place_that_cannot_be_written_is_named(paper_robot, tmp_path):
    (tmp_path / "robot.toml").mkdir()
    with pytest.raises(FormatError, match="robot.toml: .*folder"):
        write_robot(paper_robot, tmp_path / "robot.toml")
