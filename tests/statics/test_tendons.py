"""Tendon lengths and displacements against the circular arc."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.profile import rod_profile
from tdcr_planner.statics.solver import SolverSettings, solve_statics
from tdcr_planner.statics.tendons import tendon_displacements, tendon_lengths


def test_tendons_of_an_arc_are_arcs(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of()
    solution = solve_statics(robot, [[3.0, 0.0, 0.0]])
    backbone = robot.backbone
    curvature = 3.0 * 0.008 / backbone.stiffness_bending_torsion[0]
    axis = 1.0 - 3.0 / (backbone.youngs_modulus_pa * backbone.area)
    # Parallel tendons at a distance y on the side of the bend (here +y) are shorter by curvature x y.
    expected = 0.2 * (axis - curvature * robot.tendon_offsets[:, 1])
    np.testing.assert_allclose(tendon_lengths(robot, solution)[0], expected, rtol=2e-6)
    np.testing.assert_allclose(tendon_displacements(robot, solution)[0], 0.2 - expected, atol=1e-6)
    assert tendon_displacements(robot, solution)[0, 0] > 0.0


def test_straight_and_unloaded_nothing_is_pulled(any_robot: RobotSpec) -> None:
    solution = solve_statics(any_robot, np.zeros((1, any_robot.tendon_count)))
    np.testing.assert_allclose(tendon_displacements(any_robot, solution), 0.0, atol=1e-15)
    ends = any_robot.segment_ends[any_robot.tendon_segments]
    np.testing.assert_allclose(tendon_lengths(any_robot, solution)[0], ends, rtol=1e-14)


def test_elastic_stretch_adds_to_the_pull(robot_of: Callable[..., RobotSpec]) -> None:
    stiff = robot_of(circles=(0.008, 0.006))
    elastic = robot_of(circles=(0.008, 0.006), segments=({}, {"tendon_axial_stiffness_n": 2000.0}))
    tensions = np.array([[1.0, 0.5, 0.0, 2.0, 1.0, 0.2]])
    plain, stretched = (
        tendon_displacements(robot, solve_statics(robot, tensions), tensions) for robot in (stiff, elastic)
    )
    lengths = tendon_lengths(stiff, solve_statics(stiff, tensions))
    np.testing.assert_allclose(stretched[:, :3], plain[:, :3], atol=1e-15)
    np.testing.assert_allclose(stretched[:, 3:] - plain[:, 3:], (tensions * lengths)[:, 3:] / 2000.0, rtol=1e-9)


def test_lengths_agree_with_a_polygon_of_tendon_points(
    general_robot: RobotSpec, loads_of: Callable, random: np.random.Generator
) -> None:
    tensions, loads = loads_of(general_robot, random, 1, share=0.4, everything=True)
    solution = solve_statics(general_robot, tensions, **loads, settings=SolverSettings(steps_per_gap=8))
    points = solution.positions[0, :, None] + np.einsum(
        "dij,tj->dti", solution.rotations[0], general_robot.tendon_offsets
    )
    polygon = np.linalg.norm(np.diff(points, axis=0), axis=2)
    lengths = tendon_lengths(general_robot, solution)[0]
    assert rod_profile(general_robot, solution).arc_lengths[-1, -1] == pytest.approx(general_robot.length)
    for tendon, segment in enumerate(general_robot.tendon_segments):
        passed = general_robot.disk_segments[1:] <= segment
        # Chords between disks are shorter than the arcs by (curvature x spacing)^2 / 24, here up to 5e-3.
        chords = polygon[passed, tendon].sum()
        assert chords <= lengths[tendon] < chords * (1.0 + 5e-3)


def test_negative_tensions_are_refused(paper_robot: RobotSpec) -> None:
    solution = solve_statics(paper_robot, np.ones((1, 3)))
    with pytest.raises(InputError, match="only pull"):
        tendon_displacements(paper_robot, solution, -np.ones((1, 3)))
