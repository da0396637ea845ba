"""Values that no robot has are doubted with the unit that was probably meant; impossible robots are refused."""

from __future__ import annotations

import logging
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.errors import FormatError
from tdcr_planner.files import parse_table
from tdcr_planner.plausibility import doubts
from tdcr_planner.robot import RobotSpec, format_robot, load_robot

ROOT = Path(__file__).parents[1]


def changed(place: str, key: str, value: Any) -> dict[str, Any]:
    """The inspection robot's table with one value replaced."""
    table = tomllib.loads((ROOT / "models/robots/inspection.toml").read_text(encoding="utf-8"))
    target = table["segments"][0] if place == "segments" else table[place]
    target[key] = value
    return table


@pytest.mark.parametrize("name", ["paper", "inspection", "two_segment", "borescope", "bench", "helical"])
def test_shipped_robots_are_not_doubted(name: str) -> None:
    assert doubts(load_robot(ROOT / f"models/robots/{name}.toml")) == []


SLIPS = [
    ("backbone", "youngs_modulus_pa", 60.0, "youngs_modulus_pa = 60 .* in GPa"),
    ("backbone", "youngs_modulus_pa", 60e3, "youngs_modulus_pa = 60000 in MPa"),
    ("backbone", "youngs_modulus_pa", 60e12, "stiffer than diamond"),
    ("backbone", "density_kg_m3", 8.0, r"density_kg_m3 = 8 .* in g/cm\^3"),
    ("backbone", "density_kg_m3", 8e6, "denser than any metal"),
    ("backbone", "max_strain", 3.0, "max_strain = 3 .* in %"),
    ("segments", "disk_mass_kg", 0.5, r"disk_mass_kg = 0\.5 .* in g"),
    ("segments", "max_tension_n", 3500.0, "max_tension_n = 3500 .* in mN"),
    ("segments", "max_tendon_displacement_m", 5.0, "max_tendon_displacement_m = 5 .* in mm"),
    ("segments", "disk_radius_m", 10.0, "disk_radius_m = 10 .* in mm"),
    ("segments", "length_m", 200.0, "is length_m in mm"),
    ("backbone", "rest_curvature_1_m", [0.0, 200.0, 0.0], "expected in 1/m"),
    ("tip", "mass_kg", 2.0, r"is tip\.mass_kg in g"),
]


@pytest.mark.parametrize(("place", "key", "value", "words"), SLIPS)
def test_a_slipped_unit_is_named(place: str, key: str, value: Any, words: str) -> None:
    robot = parse_table(RobotSpec, changed(place, key, value), "robot.toml")
    found = doubts(robot)
    assert any(re.search(words, doubt) for doubt in found), found


@given(st.floats(0.2, 5.0), st.floats(0.1, 10.0), st.floats(0.3, 3.0))
def test_robots_of_other_sizes_and_stiffness_are_not_doubted(scale: float, stiffness: float, tension: float) -> None:
    table = changed("backbone", "youngs_modulus_pa", 60e9 * stiffness)
    table["backbone"]["radius_m"] *= scale
    segment = table["segments"][0]
    for key in ("length_m", "disk_radius_m", "disk_thickness_m", "tendon_circle_radius_m"):
        segment[key] *= scale
    segment["disk_mass_kg"] *= scale**3
    table["tip"]["mass_kg"] *= scale**3
    segment["max_tension_n"] *= tension * scale**2 * stiffness
    assert doubts(parse_table(RobotSpec, table, "robot.toml")) == []


IMPOSSIBLE = [
    ("backbone", "radius_m", 0.5, "must be below disk_radius_m = 0.01, got 0.5"),
    ("backbone", "radius_m", 0.009, "tendon_circle_radius_m must be above the backbone's radius_m = 0.009"),
    ("backbone", "rest_curvature_1_m", [0.0, 4000.0, 0.0], "must be below 1 / radius_m = 2000, got 4000 1/m"),
    ("body", "tendon_radius_m", 0.2, "body.tendon_radius_m must be below tendon_circle_radius_m = 0.008"),
    ("segments", "tendon_circle_radius_m", 0.02, "tendon_circle_radius_m must be below disk_radius_m"),
    ("segments", "tendon_angles_deg", [1.5708, -0.5236, 3.6652], "are these radians? degrees are expected"),
]


@pytest.mark.parametrize(("place", "key", "value", "message"), IMPOSSIBLE)
def test_what_cannot_be_is_refused(place: str, key: str, value: Any, message: str) -> None:
    with pytest.raises(FormatError, match=re.escape(message)):
        parse_table(RobotSpec, changed(place, key, value), "robot.toml")


def test_tendons_pass_inside_the_disks_of_the_segments_before_theirs() -> None:
    table = tomllib.loads((ROOT / "models/robots/two_segment.toml").read_text(encoding="utf-8"))
    table["segments"][1] |= {"tendon_circle_radius_m": 0.0085, "disk_radius_m": 0.01}
    message = "segments[2].tendon_circle_radius_m must be below disk_radius_m = 0.008 of segments[1], got 0.0085"
    with pytest.raises(FormatError, match=re.escape(message)):
        parse_table(RobotSpec, table, "robot.toml")


def test_reading_a_file_warns_once_and_names_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = parse_table(RobotSpec, changed("segments", "disk_mass_kg", 0.5), "robot.toml")
    path = tmp_path / "mine.toml"
    path.write_text(format_robot(robot))
    with caplog.at_level(logging.WARNING):
        load_robot(path)
        load_robot(path)
    assert len(caplog.records) == 1
    assert "mine.toml: segments[1].disk_mass_kg = 0.5" in caplog.text


SLIPS_2 = [
    (("drive", "transmission_stiffness_n_m"), 7.0, "transmission_stiffness_n_m = 7 .* in N/mm"),
    (("tip", "offset_m"), [0.0, 0.0, 4.0], r"tip\.offset_m: 4 m .* in mm"),
    (("camera", "range_m"), [5.0, 60.0], r"camera\.range_m: .* 60 m .* in mm"),
    (("tendons", 0, "axial_stiffness_n"), 0.1, "axial_stiffness_n = 0.1 is softer"),
    (("tendons", 3, "max_tension_n"), 3500.0, r"tendons\[4\]\.max_tension_n = 3500 .* in mN"),
    (("tendons", 0, "turns"), 20.5, r"tendons\[1\]: its path leans from the backbone by up to 84 degrees"),
]


@pytest.mark.parametrize(("place", "value", "words"), SLIPS_2)
def test_a_slipped_unit_of_version_2_is_named(place: tuple[str | int, ...], value: Any, words: str) -> None:
    table: Any = tomllib.loads((ROOT / "models/robots/bench.toml").read_text(encoding="utf-8"))
    target = table
    for step in place[:-1]:
        target = target[step]
    target[place[-1]] = value
    for tendon in table["tendons"]:
        tendon["between_disks"] = "channel"
    found = doubts(parse_table(RobotSpec, table, "robot.toml"))
    assert any(re.search(words, doubt) for doubt in found), found
