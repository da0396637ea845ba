"""Tendons: the list in the file's order, what each says, and what is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from tdcr_planner.errors import FormatError


def test_version_1_tendons_are_straight_and_in_the_order_of_the_arrays(any_robot):
    assert len(any_robot.tendons) == any_robot.tendon_count
    for index, tendon in enumerate(any_robot.tendons):
        s = np.array([0.0, 0.3 * tendon.end_arc_length, tendon.end_arc_length])
        np.testing.assert_array_equal(tendon.offsets(s), np.tile(any_robot.tendon_offsets[index, :2], (3, 1)))
        assert not tendon.slopes(s).any()
        assert not tendon.bends(s).any()
        assert (tendon.start_disk, tendon.start_arc_length, tendon.between_disks) == (0, 0.0, "channel")
        assert tendon.end_arc_length == any_robot.segment_ends[tendon.segment]
        assert any_robot.disk_segments[tendon.end_disk] == tendon.segment == any_robot.tendon_segments[index]
        assert tendon.max_tension == any_robot.max_tensions[index]
        assert (tendon.friction_coefficient, tendon.sheath_angle, tendon.axial_stiffness) == (0.0, 0.0, math.inf)


def test_version_2_tendons_say_what_the_file_says(plain, read):
    plain["tendons"][3] = {
        "start_disk": 2,
        "end_disk": 7,
        "angle_deg": 90.0,
        "radius_m": 0.006,
        "end_radius_m": 0.003,
        "turns": 0.5,
        "between_disks": "straight",
        "max_tension_n": 7.0,
        "friction_coefficient": 0.15,
        "sheath_angle_deg": 90.0,
        "axial_stiffness_n": 2e4,
    }
    plain["drive"] = {"pretension_n": [0.5] * 3 + [1.5] + [0.5] * 2}
    robot = read(plain)
    tendon = robot.tendons[3]
    assert (tendon.start_disk, tendon.end_disk, tendon.segment) == (2, 7, 1)
    assert (tendon.start_arc_length, tendon.end_arc_length) == pytest.approx((0.04, 0.14))
    np.testing.assert_allclose(tendon.offsets([0.04, 0.14]), [[0.0, 0.006], [0.0, -0.003]], atol=1e-17)
    assert (tendon.friction_coefficient, tendon.axial_stiffness, tendon.max_tension) == (0.15, 2e4, 7.0)
    assert tendon.sheath_angle == pytest.approx(math.pi / 2.0)
    assert (tendon.pretension, robot.pretensions.tolist()) == (1.5, [0.5, 0.5, 0.5, 1.5, 0.5, 0.5])
    np.testing.assert_allclose(robot.joins, [0.04, 0.1, 0.14, 0.2], rtol=1e-14)
    assert robot.tendon_segments.tolist() == [0, 0, 0, 1, 1, 1]


def test_one_tendon_a_robot_is_enough(plain, read):
    plain["tendons"] = plain["tendons"][5:]
    robot = read(plain)
    assert (robot.tendon_count, robot.segment_count) == (1, 2)
    assert robot.features == {"tendons that do not surround the backbone on one circle"}


HELIX_POINTS = [[0.0, 0.008, 0.0], [0.05, 0.0, 0.008], [0.1, -0.008, 0.0]]
CROSSING_POINTS = [[0.0, 0.008, 0.0], [0.05, 0.0, 0.0], [0.1, -0.008, 0.0]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"friction_coefficient": -0.1}, "tendons[1].friction_coefficient: input should be greater than or equal to 0"),
        ({"friction_coefficient": 2.5}, "friction_coefficient: input should be less than or equal to 2, got 2.5"),
        ({"sheath_angle_deg": -1.0}, "sheath_angle_deg: input should be greater than or equal to 0, got -1"),
        ({"axial_stiffness_n": 0.0}, "axial_stiffness_n: input should be greater than 0, got 0"),
        ({"radius_m": 0.012}, "tendons[1].radius_m: a tendon must pass within its disks: below disk_radius_m = 0.01"),
        ({"end_radius_m": 0.012}, "below disk_radius_m = 0.01 at disk 5, got 0.012"),
        ({"end_radius_m": 0.0004}, "must run outside of the backbone: above the backbone's radius = 0.0005 at s = 0.1"),
        ({"turns": "1"}, "tendons[1].turns: input should be a valid number, got '1'"),
        ({"segment": 3}, "tendons[1].segment: expected a segment from 1 to 2, got 3"),
        ({"segment": 0}, "tendons[1].segment: input should be greater than or equal to 1, got 0"),
        ({"segment": None, "end_disk": 11}, "tendons[1].end_disk: expected a disk from 1 to 10, the last, got 11"),
        ({"end_disk": 3}, "tendons[1]: expected either segment or end_disk, to say where the tendon ends, got both"),
        ({"segment": None}, "expected either segment or end_disk, to say where the tendon ends, got neither"),
        ({"start_disk": 5}, "tendons[1].start_disk: a tendon must start before the disk 5 at which it ends, got 5"),
        ({"angle_deg": None}, "expected angle_deg and radius_m, or points_m, to say where the tendon runs; angle_deg"),
        ({"points_m": HELIX_POINTS}, "points_m and angle_deg exclude one another; give one of them"),
        (
            {"between_disks": "sheath"},
            "tendons[1].between_disks: input should be 'channel' or 'straight', got 'sheath'",
        ),
        ({"angel_deg": 3.0}, "tendons[1].angel_deg: unknown key; did you mean 'angle_deg'?"),
        ({"max_tension_n": None}, "tendons[1].max_tension_n: missing, and it is required with tension drive"),
    ],
)
def test_tendons_that_cannot_be_are_refused(plain, read, change, message):
    changed = plain["tendons"][0] | change
    plain["tendons"][0] = {key: value for key, value in changed.items() if value is not None}
    with pytest.raises(FormatError, match=re.escape(message)):
        read(plain)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (HELIX_POINTS[:1], "points_m: a curve needs two or more points [s, x, y], got 1"),
        ([HELIX_POINTS[i] for i in (0, 2, 1)], "a tendon must not double back: arc lengths must increase, got 0.05 m"),
        (
            HELIX_POINTS[:2],
            "must run from disk 0 at 0 m to disk 5 at 0.1 m, got 0 to 0.05 m; they count from the robot",
        ),
        (CROSSING_POINTS, "tendons[1].points_m: a tendon must run outside of the backbone"),
        ([[0.0, 8.0, 0.0], [0.1, 8.0, 0.0]], "below disk_radius_m = 0.01, got 8 m in row 1; are x and y in mm?"),
        (
            [[0.0, 0.002, 0.0], [0.04, 0.0098, 0.0], [0.06, 0.0098, 0.0], [0.1, 0.002, 0.0]],
            "a tendon must run within the robot: below disk_radius_m = 0.01 at s =",
        ),
        ([[0.0, 0.008], [0.1, 0.008]], "tendons[1].points_m[1][3]: missing"),
    ],
)
def test_curves_that_cannot_be_are_refused(plain, read, points, message):
    plain["tendons"][0] = {"segment": 1, "max_tension_n": 5.0, "points_m": points}
    with pytest.raises(FormatError, match=re.escape(message)):
        read(plain)


def test_a_chord_between_disks_must_not_cross_the_backbone(plain, read):
    plain["tendons"][0] |= {"turns": 2.5}
    read(plain)
    plain["tendons"][0] |= {"between_disks": "straight"}
    with pytest.raises(FormatError, match="must run outside of the backbone: above the backbone's radius"):
        read(plain)


def test_tendons_pass_the_narrower_disks_of_segments_before_theirs(plain, read):
    plain["segments"][0]["disk_radius_m"] = 0.0075
    plain["tendons"] = plain["tendons"][3:]
    with pytest.raises(FormatError, match=r"below disk_radius_m = 0\.0075 at disk 0, got 0\.008"):
        read(plain)
    # From disk 6, the first of the second segment, it passes none of them; its channel begins there.
    for tendon in plain["tendons"]:
        tendon["start_disk"] = 6
    assert read(plain).tendons[0].start_arc_length == pytest.approx(0.12)


def test_a_robot_without_tendons_is_refused(plain, read):
    del plain["tendons"]
    with pytest.raises(FormatError, match=r"tendons: missing, and it is required: one or more \[\[tendons\]\]"):
        read(plain)
