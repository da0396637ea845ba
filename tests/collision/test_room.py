from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.part_room import HELD, room_slopes
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.robot import load_robot

HOLE, OUTER, THICKNESS = 0.0024, 0.02, 0.01  # radii and thickness of a plate about the z axis, m


@pytest.fixture(scope="module")
def plate(root):
    robot = load_robot(root / "models/robots/borescope.toml")
    mesh = trimesh.creation.annulus(HOLE / np.cos(np.pi / 64), OUTER, THICKNESS, sections=64)
    scene_mesh = SceneMesh.from_arrays("plate.stl", np.array(mesh.vertices), np.array(mesh.faces), "obstacle")
    return CollisionScene([scene_mesh], RobotBody(robot, np.zeros(robot.disk_count)))


def straight(scene, x=0.0, count=1):
    """Returns poses of the straight robot along z with its middle in the plate, beside the axis by x, m."""
    robot = scene.body.robot
    positions = np.zeros((count, robot.disk_count, 3))
    positions[:, :, 2] = robot.arc_lengths - 0.5 * robot.length
    positions[:, :, 0] = x
    return positions, np.tile(np.eye(3), (count, robot.disk_count, 1, 1))


@pytest.mark.parametrize("x", [0.0, 0.0003, 0.0006, 0.0008])
def test_room_of_a_body_in_a_hole_is_the_gap(plate, x):
    rooms = plate.part_rooms(*straight(plate, x), 0.01)[0]
    assert rooms.min() == pytest.approx(HOLE - 0.0015 - x, abs=5e-5)


def test_room_falls_below_zero_in_a_wall_and_grows_with_depth(plate):
    least = [plate.part_rooms(*straight(plate, x), 0.01).min() for x in (0.0011, 0.002, 0.004, 0.006)]
    assert max(least) < 0.0
    assert (np.diff(least) < 0.0).all()


def test_room_is_capped_and_margins_are_taken_off(plate):
    positions, rotations = straight(plate)
    assert plate.part_rooms(positions, rotations, 1e-4).max() == 1e-4
    grown = plate.with_margins(np.full(plate.body.robot.disk_count, 2e-4))
    change = plate.part_rooms(positions, rotations, 0.01).min() - grown.part_rooms(positions, rotations, 0.01).min()
    assert change == pytest.approx(2e-4, abs=2e-5)


def test_room_agrees_with_the_verdict_but_for_its_own_error(plate):
    generator = np.random.default_rng(3)
    positions, rotations = straight(plate, count=200)
    positions[:, :, :2] += generator.uniform(-0.0015, 0.0015, (200, 1, 2))
    rooms = plate.part_rooms(positions, rotations, 0.01).min(axis=1)
    free = plate.check(positions, rotations) == 0
    assert free.any()
    assert not free.all()
    assert free[rooms > 1e-4].all()
    assert not free[rooms < -2e-4].any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("broken", ["positions", "rotations"])
def test_a_pose_that_is_not_finite_has_no_room_and_leaves_the_others_theirs(plate, broken, value):
    positions, rotations = straight(plate, count=3)
    known = plate.part_rooms(positions, rotations, 0.01)
    (positions if broken == "positions" else rotations)[1, 5] = value
    rooms = plate.part_rooms(positions, rotations, 0.01)
    assert (rooms[1] == -np.inf).all()
    np.testing.assert_array_equal(rooms[[0, 2]], known[[0, 2]])


def test_distance_of_a_point_is_signed(plate):
    inside, name = plate.nearest_mesh([0.01, 0.0, 0.0])
    assert inside == pytest.approx(-0.005, abs=1e-6)
    assert name == "plate.stl"
    assert plate.nearest_mesh([0.0, 0.0, 0.0])[0] == pytest.approx(HOLE, rel=2e-3)
    empty = CollisionScene([], plate.body)
    assert empty.nearest_mesh([0.0, 0.0, 0.0]) == (np.inf, "")


def test_room_in_a_hole_is_right_at_every_depth_and_a_pose_that_is_no_number_has_none(plate):
    positions, rotations = straight(plate, count=200)
    positions[:, :, 2] += np.linspace(-0.05, 0.05, 200)[:, None]
    through = np.abs(np.linspace(-0.05, 0.05, 200)) < 0.04
    rooms = plate.part_rooms(positions, rotations, 0.01).min(axis=1)
    np.testing.assert_allclose(rooms[through], HOLE - 0.0015, atol=1e-4)
    positions[0], rotations[1] = np.nan, np.nan
    rooms = plate.part_rooms(positions, rotations, 0.01).min(axis=1)
    assert (rooms[:2] == -np.inf).all()
    assert np.isfinite(rooms[2:]).all()


def test_slopes_are_those_of_the_room_by_differences(plate):
    generator = np.random.default_rng(9)
    positions, rotations = straight(plate, count=40)
    positions[:, :, :2] += generator.uniform(-0.0009, 0.0009, (40, 1, 2))
    held = np.zeros((40, len(plate.body.part_names), HELD))
    rooms = plate.part_rooms(positions, rotations, 0.01, held)
    way = generator.normal(size=(40, 1, 3))
    way *= 1e-5 / np.linalg.norm(way, axis=2, keepdims=True)
    slopes = np.empty((40, 1, rooms.shape[1]))
    lacking = rooms < 0.01
    room_slopes(held, lacking, positions, rotations, (positions + way)[:, None], rotations[:, None], slopes)
    change = plate.part_rooms(positions + way, rotations, 0.01) - rooms
    error = np.abs(slopes[:, 0] - change)[lacking]
    # A distance has kinks in the middle between walls and at their edges, where any slope is one of several.
    assert np.quantile(error, 0.9) < 1e-6
    assert (np.abs(slopes) <= 1.05e-5 * np.sqrt(3.0)).all()
