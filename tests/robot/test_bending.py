"""The bending map against the lengths of arcs, for tendons with and without symmetry."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.errors import InputError


def arc_shortening(robot, bending: np.ndarray) -> np.ndarray:
    """How much shorter each tendon's channel gets where each segment bends by its vector, from polygons."""
    taken = np.zeros(robot.tendon_count)
    for index, (vector, segment) in enumerate(zip(bending, robot.segments, strict=True)):
        radius = np.linalg.norm(robot.tendon_offsets[robot.tendon_segments == index][0])
        turn = np.linalg.norm(vector) / radius
        direction = vector / np.linalg.norm(vector)
        angles = np.linspace(0.0, turn, 2001)
        bent = segment.length_m / turn
        for tendon in np.flatnonzero(robot.tendon_segments >= index):
            towards = robot.tendon_offsets[tendon, :2] @ direction
            points = np.column_stack([bent - (bent - towards) * np.cos(angles), (bent - towards) * np.sin(angles)])
            taken[tendon] += segment.length_m - np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    return taken


@pytest.mark.parametrize("name", ["inspection", "two_segment", "bench"])
def test_compensated_displacements_bend_each_segment_by_its_own_vector(name, table, read, random):
    robot = read(table(name))
    for bending in random.uniform(-0.004, 0.004, (5, robot.segment_count, 2)):
        found = robot.displacements_from_bending(bending[None], compensated=True)[0]
        # Polygons of 2000 sides of turns up to 1.3 rad are shorter than their arcs by 2e-8 of their length.
        np.testing.assert_allclose(found, arc_shortening(robot, bending), atol=1e-8)


def test_without_compensation_each_tendon_follows_its_segment_alone(table, read):
    robot = read(table("bench"))
    bending = np.array([[[0.003, 0.0], [0.0, 0.002], [-0.001, -0.001]]])
    found = robot.displacements_from_bending(bending)[0]
    for tendon, (segment, angle) in enumerate(zip(robot.tendon_segments, robot.tendon_angles, strict=True)):
        x, y = bending[0, segment]
        assert found[tendon] == pytest.approx(x * np.cos(angle) + y * np.sin(angle), abs=1e-18)
    # The three tendons of a segment stand around it: what one is pulled the others are released.
    np.testing.assert_allclose(found.reshape(3, 3).sum(axis=1), 0.0, atol=1e-17)


def test_tendons_in_any_order_get_the_same_tensions(plain, read, random):
    robot = read(plain)
    order = random.permutation(6)
    plain["tendons"] = [plain["tendons"][i] for i in order]
    shuffled = read(plain)
    bending = random.uniform(-3.0, 3.0, (20, 2, 2))
    expected = robot.tensions_from_bending(bending)[:, order]
    np.testing.assert_allclose(shuffled.tensions_from_bending(bending), expected, atol=1e-15)
    assert shuffled.features == {"tendons not in the order of the segments"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"turns": 0.5},
            r"robot 'plain': expected straight tendons, .* got tendon 1 .helical tendons.; robot.tendons has",
        ),
        ({"end_radius_m": 0.004}, "got tendon 1 .converging tendons."),
        ({"radius_m": 0.006}, r"segment 1 of robot 'plain': expected tendons on one circle, got .* 0\.006 to 0\.008 m"),
        ({"angle_deg": 180.0}, r"segment 1 of robot 'plain': expected three or more tendons .* got a gap of 240 deg"),
        ({"end_disk": 8, "segment": None}, r"segment 1 of robot 'plain': expected three .* got 2; give tensions or"),
    ],
)
def test_without_symmetry_there_is_no_bending_map(plain, read, change, message):
    changed = plain["tendons"][0] | change
    plain["tendons"][0] = {key: value for key, value in changed.items() if value is not None}
    robot = read(plain)
    with pytest.raises(InputError, match=message):
        robot.tensions_from_bending(np.zeros((1, 2, 2)))
    with pytest.raises(InputError, match=message):
        robot.displacements_from_bending(np.zeros((1, 2, 2)), compensated=True)
