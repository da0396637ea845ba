"""The rod's arrays: steps, joins, tendons in each step, masses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.rod import GapColumn, gap_table, rod_arrays


def test_steps_end_at_disks_and_joins(routed: Callable[..., RobotSpec]) -> None:
    robot = routed(
        [{"angle_deg": 0.0, "radius_m": 0.008}],
        disks=7,
        backbone={"radius_points_m": [[0.0, 0.0007], [0.05, 0.0005]], "rigid_stretches_m": [[0.11, 0.13]]},
    )
    rod = rod_arrays(robot, 2)
    ends = rod.ends
    for place in (*robot.arc_lengths[1:], *robot.joins):
        assert np.abs(ends - place).min() < 1e-12
    np.testing.assert_allclose(ends[rod.step_disks >= 0], robot.arc_lengths[1:], atol=1e-14)
    middles = rod.stage_lengths[:, 1]
    np.testing.assert_array_equal(rod.rigid, (middles > 0.11) & (middles < 0.13))
    # Joins start a step: the base, the end of the taper, both ends of the rigid stretch.
    starts = ends - rod.step_lengths
    np.testing.assert_allclose(starts[rod.joins], [0.0, 0.05, 0.11, 0.13], atol=1e-14)


def test_a_taper_is_followed_at_every_stage_point(routed: Callable[..., RobotSpec]) -> None:
    robot = routed(
        [{"angle_deg": 0.0, "radius_m": 0.008}], backbone={"radius_points_m": [[0.0, 0.0007], [0.2, 0.0004]]}
    )
    rod = rod_arrays(robot)
    radius = 0.0007 - 0.0015 * rod.stage_lengths[:, [0, 1, 3]]
    np.testing.assert_allclose(rod.stiffness[..., 3], 60e9 * np.pi / 4.0 * radius**4, rtol=1e-7)
    # The volume of a frustum, and of its first half.
    for column, part in ((0, radius[:, :2]), (1, radius[:, [0, 2]])):
        length = rod.step_lengths * (0.5 if column == 0 else 1.0)
        volume = np.pi * length / 3.0 * (part[:, 0] ** 2 + part[:, 0] * part[:, 1] + part[:, 1] ** 2)
        np.testing.assert_allclose(rod.step_masses[:, column], 8000.0 * volume, rtol=1e-8)


def test_tendons_stand_in_the_steps_that_they_run_through(routed: Callable[..., RobotSpec]) -> None:
    tendons = [
        {"angle_deg": 0.0, "radius_m": 0.008, "segment": None, "end_disk": 5},
        {"angle_deg": 90.0, "radius_m": 0.007, "start_disk": 5, "turns": 0.5},
        {"angle_deg": 180.0, "radius_m": 0.006},
    ]
    robot = routed(tendons, disks=10)
    rod = rod_arrays(robot, 1)
    assert rod.tendon_counts.tolist() == [2] * 10
    assert [rod.tendons[c, :2].tolist() for c in (0, 4, 5, 9)] == [[0, 2], [0, 2], [1, 2], [1, 2]]
    steps, columns = rod.steps_of(1)
    assert steps.tolist() == [5, 6, 7, 8, 9]
    s = rod.stage_lengths[:, [0, 1, 3]][steps]
    angle = np.pi / 2.0 + np.pi * (s - 0.1) / 0.1
    expected = 0.007 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    np.testing.assert_allclose(rod.offsets[steps, :, columns], expected, atol=1e-12)
    slopes = 0.007 * np.pi / 0.1 * np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    np.testing.assert_allclose(rod.slopes[steps, :, columns], slopes, atol=1e-10)


def test_holes_of_straight_tendons_are_joined_by_straight_lines(routed: Callable[..., RobotSpec]) -> None:
    tendon = {"angle_deg": 0.0, "radius_m": 0.008, "turns": 0.5, "between_disks": "straight"}
    robot = routed([tendon], disks=5)
    rod = rod_arrays(robot, 2)
    holes = robot.tendons[0].offsets(robot.arc_lengths)
    np.testing.assert_allclose(rod.offsets[::2, 0, 0], holes[:-1], atol=1e-14)
    np.testing.assert_allclose(rod.offsets[1::2, 2, 0], holes[1:], atol=1e-14)
    np.testing.assert_allclose(rod.offsets[1::2, 0, 0], 0.5 * (holes[1:] + holes[:-1]), atol=1e-14)
    np.testing.assert_allclose(rod.chords[:, 0, 0], 0.02, atol=1e-14)
    np.testing.assert_allclose(rod.chords[:2, :, 1], [[-0.02, -0.01, 0.0], [0.0, 0.01, 0.02]], atol=1e-14)
    with pytest.raises(InputError, match="all tendons in channels, or all straight"):
        rod_arrays(routed([tendon, {"angle_deg": 90.0, "radius_m": 0.008}], disks=5))


def test_rows_of_a_version_1_robot(general_robot: RobotSpec) -> None:
    rod = rod_arrays(general_robot, 1)
    assert len(rod.step_lengths) == general_robot.disk_count - 1
    assert rod.repeats.sum() == len(rod.repeats) - 3
    table = gap_table(rod)
    backbone = general_robot.segment_backbones[2]
    np.testing.assert_allclose(table[-1, GapColumn.BENDING_X], backbone.stiffness_bending_torsion[0], rtol=1e-12)
    np.testing.assert_allclose(table[-1, GapColumn.REST_TWIST], 3.0, rtol=1e-12)
    np.testing.assert_allclose(table[-1, GapColumn.DISK_MASS], 0.0013, rtol=1e-12)
    np.testing.assert_allclose(table[:, GapColumn.LENGTH].sum(), 0.24, rtol=1e-12)
