"""The drive: one number for all or one a tendon, and its limits."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tdcr_planner.errors import FormatError, InputError


def test_numbers_stand_for_all_tendons_and_lists_for_each(plain, read):
    plain["drive"] = {
        "kind": "displacement",
        "transmission_stiffness_n_m": 7000.0,
        "pretension_n": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
        "backlash_m": 1e-4,
        "max_displacement_m": [[-0.02, 0.01 * i] for i in range(1, 7)],
        "spool_radius_m": 0.02,
    }
    drive = read(plain).drive
    assert drive.kind == "displacement"
    np.testing.assert_array_equal(drive.transmission_stiffness, [7000.0] * 6)
    np.testing.assert_array_equal(drive.pretension, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    np.testing.assert_array_equal(drive.backlash, [1e-4] * 6)
    np.testing.assert_array_equal(drive.max_displacement[0], [-0.02] * 6)
    np.testing.assert_allclose(drive.max_displacement[1], [0.01, 0.02, 0.03, 0.04, 0.05, 0.06])
    np.testing.assert_allclose(drive.spool_angles([[0.01, 0, 0, 0, 0, -0.01]]), [[0.5, 0, 0, 0, 0, -0.5]])


def test_without_a_drive_table_tensions_are_set(plain, read, any_robot):
    for robot in (read(plain), any_robot):
        drive, count = robot.drive, robot.tendon_count
        assert drive.kind == "tension"
        np.testing.assert_array_equal(drive.transmission_stiffness, [np.inf] * count)
        np.testing.assert_array_equal(drive.pretension, robot.pretensions)
        np.testing.assert_array_equal(drive.max_displacement, [[-np.inf] * count, [np.inf] * count])
        with pytest.raises(InputError, match="states spool_radius_m"):
            drive.spool_angles(np.zeros((1, count)))


def test_version_1_displacement_limits_are_the_drives(two_segment_robot):
    first, second = two_segment_robot.segments
    limited = first.model_copy(update={"max_tendon_displacement_m": 0.02})
    drive = two_segment_robot.model_copy(update={"segments": [limited, second]}).drive
    np.testing.assert_array_equal(drive.max_displacement[1], [0.02] * 3 + [np.inf] * 3)
    np.testing.assert_array_equal(drive.max_displacement[0], -drive.max_displacement[1])


def test_tension_limits_are_optional_with_displacement_drive(plain, read):
    plain["drive"] = {"kind": "displacement"}
    for tendon in plain["tendons"]:
        del tendon["max_tension_n"]
    robot = read(plain)
    assert np.isinf(robot.max_tensions).all()
    with pytest.raises(InputError, match=r"0 N or more .* got -0\.5 in row 0, tendon 1"):
        robot.check_tensions([[0.0, -0.5, 0.0, 1e4, 0.0, 0.0]])
    assert robot.with_tension_limits_times(2.0) == robot


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({"kind": "motor"}, "drive.kind: input should be 'tension' or 'displacement', got 'motor'"),
        (
            {"transmission_stiffness_n_m": [1e3, 1e3]},
            "drive.transmission_stiffness_n_m: expected one for all tendons or one for each of 6, got 2",
        ),
        ({"transmission_stiffness_n_m": 0.0}, "input should be greater than 0, got 0"),
        ({"pretension_n": 6.0}, "drive.pretension_n: must be below max_tension_n = 5 of tendons[1], got 6"),
        ({"pretension_n": -1.0}, "drive.pretension_n[1]: input should be greater than or equal to 0, got -1"),
        ({"pretension_n": []}, "expected one for all tendons or one for each of 6, got 0"),
        ({"backlash_m": "a"}, "drive.backlash_m: expected a list, got 'a'"),
        ({"max_displacement_m": [0.01, 0.02]}, "max_displacement_m must be [lowest, highest] and hold 0"),
        ({"max_displacement_m": [0.0, 0.0]}, "max_displacement_m must be [lowest, highest] and hold 0"),
        (
            {"max_displacement_m": [-0.05, 0.15]},
            "must be below the length 0.1 m of tendons[1] inside the robot, got [-0.05, 0.15]; is it in mm?",
        ),
        ({"max_displacement_m": [-0.05]}, "drive.max_displacement_m"),
        ({"spool_radius_m": [0.01] * 5}, "expected one for all tendons or one for each of 6, got 5"),
        ({"stiffness": 3.0}, "drive.stiffness: unknown key"),
    ],
)
def test_drives_that_cannot_be_are_refused(plain, read, drive, message):
    plain["drive"] = drive
    with pytest.raises(FormatError, match=re.escape(message)):
        read(plain)


def test_displacements_are_checked_against_the_tendons(plain, read):
    plain["drive"] = {"kind": "displacement"}
    robot = read(plain)
    np.testing.assert_array_equal(robot.check_displacements([[-0.02] * 6]), [[-0.02] * 6])
    with pytest.raises(InputError, match=r"less than the 0\.1 m of the tendon .* got 10 m in row 0, tendon 2; .* mm"):
        robot.check_displacements([[0.0, 0.0, 10.0, 0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match=r"expected shape \(n, 6\), got shape \(1, 3\)"):
        robot.check_displacements([[0.0, 0.0, 0.0]])
