"""The rod along its length: taper, measured stiffness, rigid stretches."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.robot import Backbone

TAPER = [[0.0, 0.001], [0.1, 0.0006], [0.2, 0.0006]]


@pytest.fixture
def tapered(plain, read):
    del plain["backbone"]["radius_m"]
    plain["backbone"] |= {"radius_points_m": TAPER, "inner_radius_m": 0.0002}
    return read(plain)


def test_a_tapered_rod_has_the_textbook_section_everywhere(tapered):
    s = np.array([0.0, 0.03, 0.1, 0.17])
    radius = np.array([0.001, 0.00088, 0.0006, 0.0006])
    np.testing.assert_allclose(tapered.backbone_radius_at(s), radius, rtol=1e-13)
    area, second = np.pi * (radius**2 - 4e-8), np.pi / 4.0 * (radius**4 - 16e-16)
    shear = 60e9 / 2.6
    expected = np.stack([shear * area, shear * area, 60e9 * area, 60e9 * second, 60e9 * second, 2 * shear * second])
    np.testing.assert_allclose(tapered.stiffness_at(s), expected.T, rtol=1e-12)
    np.testing.assert_allclose(tapered.mass_per_length_at(s), 8000.0 * area, rtol=1e-12)


def test_the_mass_of_a_tapered_rod_is_that_of_a_frustum(tapered):
    frustum = np.pi * 0.1 / 3.0 * (0.001**2 + 0.001 * 0.0006 + 0.0006**2)
    rest = np.pi * 0.1 * 0.0006**2
    assert tapered.backbone_mass == pytest.approx(8000.0 * (frustum + rest - np.pi * 0.2 * 4e-8), rel=1e-12)
    assert tapered.backbone.radius_m == 0.001
    assert tapered.joins.tolist() == pytest.approx([0.1, 0.2])
    assert tapered.features == {"taper"}


def test_a_rod_of_one_radius_has_its_constants_everywhere(any_robot):
    s = np.linspace(0.0, any_robot.length, 7)
    rod = any_robot.backbone
    expected = [*rod.stiffness_shear_extension, *rod.stiffness_bending_torsion]
    np.testing.assert_array_equal(any_robot.stiffness_at(s), np.tile(expected, (7, 1)))
    np.testing.assert_array_equal(any_robot.mass_per_length_at(s), np.full(7, rod.weight_per_length_kg_m))
    np.testing.assert_array_equal(any_robot.rest_strain_at(s), np.tile([0, 0, 1.0, *rod.rest_curvature_1_m], (7, 1)))
    assert not any_robot.rigid_at(s).any()


def test_measured_stiffness_takes_the_place_of_the_modulus(plain, read):
    plain["backbone"] |= {"bending_stiffness_n_m2": [0.002, 0.003], "axial_stiffness_n": 4e4}
    own = {"youngs_modulus_pa": 1e9, "poisson_ratio": 0.3, "radius_m": 0.001, "rest_curvature_1_m": [0.0, 2.0, 0.0]}
    plain["segments"][1]["backbone"] = own | {"torsional_stiffness_n_m2": 0.004, "shear_stiffness_n": 7e3}
    robot = read(plain)
    first, second = robot.stiffness_at([0.1, 0.1 + 1e-9])
    np.testing.assert_array_equal(first[2:5], [4e4, 0.002, 0.003])
    np.testing.assert_allclose(second, [7e3, 7e3, np.pi * 1e3, np.pi / 4e3, np.pi / 4e3, 0.004], rtol=1e-12)
    assert robot.rest_strain_at([0.15])[0].tolist() == [0.0, 0.0, 1.0, 0.0, 2.0, 0.0]
    scaled = robot.scaled(stiffness=2.0).stiffness_at([0.05, 0.15])
    np.testing.assert_allclose(scaled, 2.0 * robot.stiffness_at([0.05, 0.15]), rtol=1e-14)
    assert robot.features == {"stiffness by axis"}


def test_rigid_stretches_count_from_where_their_rod_starts(plain, read):
    plain["backbone"]["rigid_stretches_m"] = [[0.01, 0.02]]
    plain["segments"][1]["backbone"] = plain["backbone"] | {"rigid_stretches_m": [[0.0, 0.03]]}
    robot = read(plain)
    s = [0.005, 0.015, 0.025, 0.105, 0.129, 0.131]
    assert robot.rigid_at(s).tolist() == [False, True, False, True, True, False]
    np.testing.assert_allclose(robot.joins, [0.01, 0.02, 0.1, 0.13, 0.2], rtol=1e-14)


def test_a_rigid_segment_is_rigid_as_a_whole(plain, read):
    plain["segments"][1]["rigid"] = True
    robot = read(plain)
    assert robot.rigid_at([0.05, 0.1, 0.1001, 0.2]).tolist() == [False, False, True, True]
    assert robot.features == {"rigid stretches"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius_points_m": [[0.0, 0.001]]}, "expected two or more points [arc length, radius], got 1"),
        ({"radius_points_m": [[0.1, 0.001], [0.1, 0.002]]}, "arc lengths must increase, got 0.1 m after 0.1 m"),
        ({"radius_points_m": [[0.0, 0.001], [0.25, 0.0008]]}, "must be at most the robot's length = 0.2 m, got 0.25"),
        ({"radius_points_m": [[0.0, 0.001], [0.1, -0.0008]]}, "radius_points_m[2][2]: input should be greater than 0"),
        (
            {"radius_points_m": [[0.0, 0.001], [0.1, 0.0002]], "inner_radius_m": 0.0003},
            "inner_radius_m must be below the smallest radius of radius_points_m = 0.0002, got 0.0003",
        ),
        ({"radius_points_m": TAPER, "radius_m": 0.002}, "radius_m must be left out, or be the largest radius"),
        ({"radius_points_m": TAPER, "axial_stiffness_n": 1e4}, "radius_points_m and axial_stiffness_n exclude one"),
        ({"bending_stiffness_n_m2": [0.1]}, "backbone.bending_stiffness_n_m2[2]: missing"),
        ({"bending_stiffness_n_m2": 0.0}, "input should be greater than 0, got 0"),
        ({"rigid_stretches_m": [[0.02, 0.01]]}, "a stretch must end after its start, got [0.02, 0.01]"),
        (
            {"rigid_stretches_m": [[0.05, 0.08], [0.01, 0.06]]},
            "stretches must not overlap, got one from 0.05 m and one that ends at 0.06 m",
        ),
        ({"rigid_stretches_m": [[0.0, 0.3]]}, "backbone.rigid_stretches_m: arc lengths must be at most"),
        ({"rigid_stretches_m": [[0.0, 0.2]]}, "segments: rigid all along: a robot needs a stretch that bends"),
        ({"radius_m": 1e-100}, "radius_m = 1e-100 and inner_radius_m = 0 leave so thin a wall that a stiffness is 0"),
        ({"rest_curvature_1_m": [3000.0, 0.0, 0.0]}, "must be below 1 / radius_m = 2000, got 3000 1/m"),
    ],
)
def test_rods_that_cannot_be_are_refused(plain, read, change, message):
    if "radius_points_m" in change and "radius_m" not in change:
        del plain["backbone"]["radius_m"]
    plain["backbone"] |= change
    with pytest.raises(FormatError, match=re.escape(message)):
        read(plain)


def test_a_rigid_segment_and_a_rigid_stretch_in_it_overlap(plain, read):
    plain["backbone"]["rigid_stretches_m"] = [[0.15, 0.16]]
    plain["segments"][1]["rigid"] = True
    with pytest.raises(FormatError, match=r"segments\[2\]\.rigid: .* overlaps it with \[0\.15, 0\.16\]"):
        read(plain)


def test_one_stiffness_stands_for_both_axes():
    rod = Backbone(youngs_modulus_pa=1e9, poisson_ratio=0.3, radius_m=1e-3, bending_stiffness_n_m2=0.5)
    assert rod.bending_stiffness_n_m2 == (0.5, 0.5)
    assert rod.is_isotropic
