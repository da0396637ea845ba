from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.files import parse_table
from tdcr_planner.robot import Backbone, RobotSpec, load_robot


def robot_table(root: Path, name: str = "paper") -> dict[str, Any]:
    return tomllib.loads((root / f"models/robots/{name}.toml").read_text(encoding="utf-8"))


def test_shipped_robots_have_the_stated_layout(paper_robot: RobotSpec, two_segment_robot: RobotSpec) -> None:
    assert (paper_robot.disk_count, paper_robot.tendon_count, paper_robot.length) == (21, 3, 0.2)
    np.testing.assert_allclose(paper_robot.arc_lengths, np.linspace(0.0, 0.2, 21), atol=1e-16)
    assert paper_robot.disk_masses[0] == 0.0
    assert two_segment_robot.disk_count == 21
    np.testing.assert_array_equal(two_segment_robot.tendon_segments, [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(two_segment_robot.disk_segments, [0] * 11 + [1] * 10)
    np.testing.assert_allclose(np.linalg.norm(two_segment_robot.tendon_offsets, axis=1), [0.0065] * 3 + [0.005] * 3)


def test_section_constants_are_the_textbook_ones() -> None:
    tube = Backbone(youngs_modulus_pa=70e9, poisson_ratio=0.25, radius_m=2e-3, inner_radius_m=1e-3)
    assert tube.area == pytest.approx(np.pi * 3e-6, rel=1e-12)
    assert tube.second_moment == pytest.approx(np.pi / 4 * 15e-12, rel=1e-12)
    assert tube.shear_modulus == pytest.approx(28e9, rel=1e-12)
    assert tube.stiffness_bending_torsion == pytest.approx(
        (70e9 * np.pi / 4 * 15e-12, 70e9 * np.pi / 4 * 15e-12, 28e9 * np.pi / 2 * 15e-12), rel=1e-12
    )


angles = st.sampled_from([(90.0, -30.0, 210.0), (0.0, 90.0, 180.0, 270.0), (10.0, 100.0, 230.0), (0, 0, 130, 250, 300)])


@given(angles, st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(0.0, 1.0))
def test_tensions_from_bending_solve_the_linear_programme(
    tendon_angles: tuple[float, ...], x: float, y: float, pretension: float
) -> None:
    table = robot_table(Path(__file__).parents[2])
    table["segments"][0] |= {"tendon_angles_deg": tendon_angles, "pretension_n": pretension}
    robot = parse_table(RobotSpec, table, "robot")
    tensions = robot.tensions_from_bending([[[x, y]]])[0] - pretension
    directions = np.stack([np.cos(robot.tendon_angles), np.sin(robot.tendon_angles)])
    expected = linprog(np.ones(robot.tendon_count), A_eq=directions, b_eq=[x, y], method="highs")
    assert (tensions >= 0.0).all()
    # HiGHS works to a feasibility tolerance of 1e-7.
    np.testing.assert_allclose(directions @ tensions, [x, y], atol=1e-12)
    assert tensions.sum() == pytest.approx(expected.fun, abs=1e-6)


def test_bending_from_tensions_inverts_the_map(any_robot: RobotSpec, random: np.random.Generator) -> None:
    bending = random.uniform(-2.0, 2.0, (50, any_robot.segment_count, 2))
    recovered = any_robot.bending_from_tensions(any_robot.tensions_from_bending(bending))
    np.testing.assert_allclose(recovered, bending, atol=1e-14)


def test_negative_and_misshaped_tensions_are_refused(paper_robot: RobotSpec) -> None:
    with pytest.raises(InputError, match=r"got -0\.5 in row 1, tendon 2"):
        paper_robot.check_tensions([[0, 0, 0], [1, 0, -0.5]])
    with pytest.raises(InputError, match=r"expected shape \(n, 3\), got shape \(1, 4\)"):
        paper_robot.check_tensions([[0, 0, 0, 0]])


def test_hash_follows_mechanics_and_nothing_else(root: Path) -> None:
    original = parse_table(RobotSpec, robot_table(root), "robot").mechanics_hash
    same = robot_table(root)
    same["name"] = "other"
    same["segments"][0] |= {"disk_radius_m": 0.012, "max_tension_n": 9.0}
    assert parse_table(RobotSpec, same, "robot").mechanics_hash == original
    for place, key, value in (("backbone", "radius_m", 0.0006), ("segments", "disk_mass_kg", 0.001)):
        other = robot_table(root)
        (other[place][0] if place == "segments" else other[place])[key] = value
        assert parse_table(RobotSpec, other, "robot").mechanics_hash != original


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length_m": 0.0}, "segments[1].length_m: input should be greater than 0, got 0.0"),
        ({"tendon_angles_deg": [0.0, 120.0]}, "segments[1].tendon_angles_deg: expected three or more tendons, got 2"),
        ({"tendon_angles_deg": [0.0, 60.0, 120.0]}, "widest gap between neighbours must be below 180 degrees, got 240"),
        ({"tendon_circle_radius_m": 0.02}, "tendon_circle_radius_m must be below disk_radius_m = 0.01, got 0.02"),
        ({"pretension_n": 5.0}, "pretension_n must be below max_tension_n = 3.5, got 5.0"),
        ({"disk_thickness_m": 0.01}, "disk_thickness_m must be below the disk spacing"),
        ({"disks": 0}, "segments[1].disks: input should be greater than or equal to 1, got 0"),
        ({"disk_mass_kg": float("nan")}, "segments[1].disk_mass_kg: input should be a finite number"),
        ({"lenght_m": 0.2}, "segments[1].lenght_m: unknown key; did you mean 'length_m'?"),
    ],
)
def test_faulty_segments_are_refused(root: Path, change: dict[str, Any], message: str) -> None:
    table = robot_table(root)
    table["segments"][0] |= change
    with pytest.raises(FormatError, match=re.escape(message)):
        parse_table(RobotSpec, table, "robot.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"youngs_modulus_pa": 0.0}, "backbone.youngs_modulus_pa: input should be greater than 0"),
        ({"inner_radius_m": 0.0005}, "inner_radius_m must be below radius_m"),
        ({"poisson_ratio": 0.7}, "backbone.poisson_ratio: input should be less than or equal to 0.5"),
    ],
)
def test_faulty_backbones_are_refused(root: Path, change: dict[str, Any], message: str) -> None:
    table = robot_table(root)
    table["backbone"] |= change
    with pytest.raises(FormatError, match=re.escape(message)):
        parse_table(RobotSpec, table, "robot.toml")


def test_missing_robot_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"mine\.toml: no such file"):
        load_robot(tmp_path / "mine.toml")


def test_a_copy_derives_its_own_arrays(paper_robot: RobotSpec) -> None:
    assert paper_robot.arc_lengths[-1] == 0.2
    segment = paper_robot.segments[0].model_copy(update={"length_m": 0.3})
    longer = paper_robot.model_copy(update={"segments": (segment,)})
    assert longer.arc_lengths[-1] == pytest.approx(0.3)
    assert longer.mechanics_hash != paper_robot.mechanics_hash


def test_scaling_multiplies_every_modulus_and_every_mass_and_nothing_else(any_robot: RobotSpec) -> None:
    own = any_robot.backbone.model_copy(update={"youngs_modulus_pa": 30e9})
    segments = [any_robot.segments[0].model_copy(update={"backbone": own}), *any_robot.segments[1:]]
    robot = any_robot.model_copy(update={"segments": segments, "tip": {"mass_kg": 0.003}})
    scaled = robot.scaled(stiffness=2.0, mass=3.0)
    assert scaled.tip.mass_kg == pytest.approx(0.009)
    np.testing.assert_allclose(scaled.disk_masses, 3.0 * robot.disk_masses)
    for after, before in zip(scaled.segment_backbones, robot.segment_backbones, strict=True):
        assert after.youngs_modulus_pa == 2.0 * before.youngs_modulus_pa
        assert after.weight_per_length_kg_m == pytest.approx(3.0 * before.weight_per_length_kg_m)
        assert after.area == before.area
    assert robot.scaled() == robot
