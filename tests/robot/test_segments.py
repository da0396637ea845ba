"""Disks at given places and of given mass."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tdcr_planner.errors import FormatError


def test_disks_stand_where_the_file_says(plain, read):
    del plain["segments"][0]["disks"]
    del plain["segments"][0]["disk_mass_kg"]
    plain["segments"][0] |= {"disk_positions_m": [0.02, 0.05, 0.1], "disk_masses_kg": [0.001, 0.0, 0.002]}
    robot = read(plain)
    np.testing.assert_allclose(robot.arc_lengths, [0.0, 0.02, 0.05, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2], rtol=1e-15)
    assert robot.disk_masses.tolist() == [0.0, 0.001, 0.0, 0.002, *[0.001] * 5]
    assert (robot.disk_count, robot.segments[0].disks) == (9, 3)
    assert robot.scaled(mass=2.0).disk_masses.tolist() == [0.0, 0.002, 0.0, 0.004, *[0.002] * 5]
    assert robot.features == {"disks at given places"}
    assert [tendon.end_disk for tendon in robot.tendons] == [3, 3, 3, 8, 8, 8]


def test_a_segment_may_end_behind_its_last_disk_but_the_robot_may_not(plain, read):
    del plain["segments"][0]["disks"]
    plain["segments"][0]["disk_positions_m"] = [0.04, 0.08]
    robot = read(plain)
    np.testing.assert_allclose(robot.joins, [0.08, 0.1, 0.2], rtol=1e-14)
    plain["segments"][1] |= {"disk_positions_m": [0.03, 0.06], "disks": 2}
    with pytest.raises(FormatError, match=r"segments\[2\]\.disk_positions_m: the robot's last disk is its tip"):
        read(plain)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"disk_positions_m": [0.05, 0.02, 0.1]}, "disk_positions_m must increase, got 0.02 m after 0.05 m"),
        ({"disk_positions_m": [0.05, 0.12]}, "must be at most length_m = 0.1, got 0.12: they count from the segment's"),
        ({"disk_positions_m": [0.05, 0.051, 0.1]}, "disk_thickness_m must be below the least disk spacing 0.001"),
        ({"disk_positions_m": []}, "segments[1].disk_positions_m"),
        ({"disk_positions_m": [0.05, 0.1], "disks": 3}, "disks must be left out, or count disk_positions_m = 2, got 3"),
        ({"disks": 2, "disk_masses_kg": [0.001]}, "expected a mass for each of 2 disks, got 1"),
        ({"disks": 1, "disk_masses_kg": [1e-3], "disk_mass_kg": 1e-3}, "exclude one another; give one of them"),
        ({"disks": 2, "rigid": 1}, "segments[1].rigid: input should be a valid boolean, got 1"),
    ],
)
def test_disks_that_cannot_be_are_refused(plain, read, change, message):
    segment = {key: plain["segments"][0][key] for key in ("length_m", "disk_radius_m", "disk_thickness_m")}
    plain["segments"][0] = segment | change
    with pytest.raises(FormatError, match=re.escape(message)):
        read(plain)
