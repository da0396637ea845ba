"""Paths of tendons: offsets, their derivatives, and the lengths of known curves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner.robot.paths import SplinePath, polar_path

START, END = 0.03, 0.18
numbers = st.tuples(st.floats(-360, 360), st.floats(1e-3, 0.01), st.floats(1e-3, 0.01), st.floats(-3, 3))


@given(numbers)
def test_derivatives_are_those_of_the_offset(said: tuple[float, float, float, float]) -> None:
    path = polar_path(START, END, *said)
    s, step = np.linspace(START, END, 9), 1e-5
    for order in (1, 2):
        above, below = path.derivative(s + step, order - 1), path.derivative(s - step, order - 1)
        # The central difference of a curve that winds at most 3 times in 0.15 m: step^2 / 6 times its third
        # (fourth) derivative, 0.01 m x (126 rad/m)^(2 + order).
        np.testing.assert_allclose(
            path.derivative(s, order), (above - below) / (2 * step), atol=1e-12 * 126.0 ** (2 + order)
        )


@given(numbers)
def test_angle_and_radius_hold_at_the_ends(said: tuple[float, float, float, float]) -> None:
    angle, first, last, turns = said
    ends = polar_path(START, END, *said).derivative(np.array([START, END]), 0)
    for offset, radius, degrees in zip(ends, (first, last), (angle, angle + 360.0 * turns), strict=True):
        expected = radius * np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
        np.testing.assert_allclose(offset, expected, atol=1e-14)


def test_a_positive_turn_is_right_handed_about_z() -> None:
    path = polar_path(0.0, 1.0, 0.0, 0.01, None, 0.25)
    np.testing.assert_allclose(path.derivative(np.array([1.0]), 0), [[0.0, 0.01]], atol=1e-17)
    assert path.kinds == {"helical tendons"}


def test_lengths_of_helix_and_cone_are_the_closed_forms(plain, read):
    plain["tendons"][0] |= {"segment": 2, "turns": 1.5}
    plain["tendons"][1] |= {"segment": 2, "end_radius_m": 0.002}
    robot = read(plain)
    helix, cone, straight = robot.rest_path_lengths[:3]
    assert helix == pytest.approx(math.hypot(0.2, 2.0 * math.pi * 1.5 * 0.008), rel=1e-13)
    assert cone == pytest.approx(math.hypot(0.2, 0.006), rel=1e-13)
    assert straight == 0.1


def test_a_helix_straight_between_disks_is_a_polygon(plain, read):
    plain["tendons"][0] |= {"segment": 2, "turns": 1.0, "between_disks": "straight"}
    robot = read(plain)
    chord = 2.0 * 0.008 * math.sin(math.pi / 10.0)
    assert robot.rest_path_lengths[0] == pytest.approx(10.0 * math.hypot(0.02, chord), rel=1e-13)


def test_a_straight_tendon_written_as_points_is_the_straight_tendon(plain, read):
    x, y = 0.008 * math.cos(math.radians(60.0)), 0.008 * math.sin(math.radians(60.0))
    straight = read(plain).tendons[0]
    plain["tendons"][0] = {"segment": 1, "max_tension_n": 5.0, "points_m": [[s, x, y] for s in (0.0, 0.03, 0.07, 0.1)]}
    robot = read(plain)
    points, s = robot.tendons[0], np.linspace(0.0, 0.1, 33)
    np.testing.assert_allclose(points.offsets(s), straight.offsets(s), atol=1e-15)
    np.testing.assert_allclose(points.slopes(s), 0.0, atol=1e-13)
    np.testing.assert_allclose(points.bends(s), 0.0, atol=1e-11)
    assert points.straight_path is None
    assert robot.features == {"tendons through points"}


def test_points_on_a_helix_give_the_helix() -> None:
    helix = polar_path(0.0, 0.2, 30.0, 0.008, None, 1.0)
    errors = []
    for count in (21, 41, 81):
        s = np.linspace(0.0, 0.2, count)
        spline = SplinePath.through(np.column_stack([s, helix.derivative(s, 0)]))
        fine = np.linspace(0.0, 0.2, 333)
        errors.append(np.abs(spline.derivative(fine, 0) - helix.derivative(fine, 0)).max())
    # A cubic spline is of fourth order, 16 a halving; its ends come to that slowly.
    assert errors[0] / errors[1] > 10.0
    assert errors[1] / errors[2] > 13.0
    assert errors[2] < 1e-8


def test_two_points_are_a_line_and_three_a_parabola() -> None:
    line = SplinePath.through(np.array([[0.0, 0.004, 0.0], [0.1, 0.008, 0.002]]))
    np.testing.assert_allclose(line.derivative(np.array([0.05]), 0), [[0.006, 0.001]], atol=1e-17)
    parabola = SplinePath.through(np.array([[0.0, 0.0, 0.0], [0.1, 0.01, 0.0], [0.2, 0.04, 0.0]]))
    np.testing.assert_allclose(parabola.derivative(np.array([0.0, 0.17]), 2)[:, 0], [2.0, 2.0], rtol=1e-12)
