from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdcr_planner.compare.comparison import Disagreement
from tdcr_planner.report.disagreement import describe_disagreement, disks_past_plane


@pytest.fixture
def wrong(inspection_robot):
    disks = inspection_robot.disk_count
    positions, rotations = np.zeros((disks, 3)), np.tile(np.eye(3), (disks, 1, 1))
    return Disagreement(
        "constant_curvature", "false_valid", 7, "clearance", np.zeros(2), -0.002, 0.04,
        positions, rotations, positions, rotations,
    )  # fmt: skip


def test_says_who_is_wrong_and_why(wrong):
    who, why, how = describe_disagreement(wrong)
    assert who == "State 7 is called valid by the constant curvature model, but is not"
    assert why.startswith("The reference rejects it: the body comes too near")
    assert "clearance \N{MINUS SIGN}2.00 mm" in how
    cautious = replace(wrong, kind="false_invalid", cause="tension_limit", deviation=3e-7)
    assert describe_disagreement(cautious)[1] == "The model rejects it: tension limit."
    assert "0.3 µm from it" in describe_disagreement(cautious)[2]


def test_how_far_disks_pass_a_plane_is_that_of_their_rims(inspection_robot, random):
    robot, states = inspection_robot, 5
    positions = 0.05 * random.normal(size=(states, robot.disk_count, 3))
    rotations = Rotation.random(states * robot.disk_count, rng=random).as_matrix().reshape(states, -1, 3, 3)
    point, normal = np.array([0.01, -0.02, 0.03]), np.array([2.0, -1.0, 2.0]) / 3.0
    angle = np.linspace(0.0, 2.0 * np.pi, 3601)
    expected = np.full(states, -np.inf)
    for disk in range(robot.disk_count):
        for side in (-0.5, 0.5):
            rim = robot.disk_radii[disk] * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
            rim[:, 2] = side * robot.disk_thicknesses[disk]
            world = positions[:, disk, None] + rim @ np.swapaxes(rotations[:, disk], 1, 2)
            expected = np.maximum(expected, ((world - point) @ normal).max(axis=1))
    # Chords of 0.1 degrees fall short of a circle of 10 mm by 4e-9 m.
    np.testing.assert_allclose(disks_past_plane(robot, positions, rotations, point, normal), expected, atol=1e-8)
