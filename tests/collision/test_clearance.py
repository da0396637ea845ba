"""Clearance against closed forms, another algorithm, and the verdicts of FCL."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.collision.body import Kind, RobotBody, place_solids
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.collision.tree import nearest_distances

CELLS = 20_000


def _straight(robot, shift=(0.0, 0.0, 0.0)):
    positions = np.zeros((1, robot.disk_count, 3))
    positions[0, :, 2] = robot.arc_lengths
    return positions + np.asarray(shift), np.broadcast_to(np.eye(3), (1, robot.disk_count, 3, 3)).copy()


def _scenes(mesh, robot, margins=None):
    body = RobotBody(robot, margins)
    return CollisionScene([mesh], body, cells=CELLS), CollisionScene([mesh], body, field=None)


def test_beside_a_block_it_is_the_gap_and_margins_do_not_count(paper, shapes):
    mesh = SceneMesh.from_arrays("block", *shapes.box((0.1, 1.0, 1.0), (0.1, 0.0, 0.0)), "obstacle")
    for scene in _scenes(mesh, paper, np.full(paper.disk_count, 0.02)):
        # The block's face is at x = 0.05, the disks reach to x = 0.01.
        assert scene.clearance(*_straight(paper))[0] == pytest.approx(0.04, abs=1e-12)


def test_in_a_tube_it_is_the_difference_of_the_radii(paper, shapes):
    around = 64
    mesh = SceneMesh.from_arrays(
        "tube", *shapes.pipe(radius=0.02, straight=0.4, angle=0.01, around=around), "cavity", [0, 0, 0], [0, 0, 1]
    )
    sagitta = 0.02 * (1.0 - np.cos(np.pi / around))
    for scene in _scenes(mesh, paper):
        value = scene.clearance(*_straight(paper, (0.004, 0.0, 0.1)))[0]
        # Off the axis by 4 mm; the facets lie up to their sagitta inside the tube.
        assert 0.006 - sagitta - 1e-12 <= value <= 0.006 + 1e-12


def test_before_a_sphere_it_is_the_distance_from_the_last_disks_face(paper, shapes):
    mesh = SceneMesh.from_arrays("ball", *shapes.sphere(0.05, (0.0, 0.0, 0.3), subdivisions=5), "obstacle")
    for scene in _scenes(mesh, paper):
        # Facets lie up to 3e-4 of the radius inside the sphere.
        assert scene.clearance(*_straight(paper))[0] == pytest.approx(0.3 - 0.05 - 0.201, abs=2e-5)


def test_depth_is_negative_and_grows_with_penetration(paper, shapes):
    mesh = SceneMesh.from_arrays("block", *shapes.box((0.1, 1.0, 1.0), (0.1, 0.0, 0.0)), "obstacle")
    for scene in _scenes(mesh, paper):
        values = [scene.clearance(*_straight(paper, (0.04 + depth, 0.0, 0.0)))[0] for depth in (1e-6, 0.002, 0.008)]
        # Rim points towards the block lie on the ring that is sampled, so the estimate is the depth itself.
        np.testing.assert_allclose(values, [-1e-6, -0.002, -0.008], atol=2e-9)
        assert scene.clearance(*_straight(paper, (0.1, 0.0, 0.0)))[0] < -0.04


def test_wholly_on_the_wrong_side_is_negative(paper, shapes, pipe_mesh):
    room = SceneMesh.from_arrays("solid", *shapes.box((1.0, 1.0, 1.0)), "obstacle")
    for scene in _scenes(room, paper):
        # The point of the body that is deepest inside is 0.5 m from the nearest face, less what is off the middle.
        assert scene.clearance(*_straight(paper))[0] == pytest.approx(-0.5, abs=0.012)
    for scene in _scenes(pipe_mesh, paper):
        assert scene.clearance(*_straight(paper, (0.1, 0.0, 0.0)))[0] < -0.05


def test_on_a_sheet_it_is_negative_while_touching_and_positive_on_both_sides(paper, shapes):
    mesh = SceneMesh.from_arrays("sheet", *shapes.sheet(0.5, height=0.1055), "obstacle")
    for scene in _scenes(mesh, paper):
        assert scene.clearance(*_straight(paper))[0] < 0.0
        # Above the sheet the round end of the backbone's capsule at the base is nearest, below it the last disk's face.
        end = max(scene.body.arrays.radius[scene.body.arrays.kind == Kind.BACKBONE])
        assert scene.clearance(*_straight(paper, (0.0, 0.0, 0.12)))[0] == pytest.approx(0.0145 - end, abs=1e-9)
        assert scene.clearance(*_straight(paper, (0.0, 0.0, -0.12)))[0] == pytest.approx(0.0245, abs=1e-9)


@pytest.mark.parametrize("between", ["backbone", "tendons", "sleeve"])
def test_it_is_the_least_distance_of_points_spread_over_the_body(paper, pipe_mesh, draw_poses, between):
    robot = paper.model_copy(update={"body": paper.body.model_copy(update={"between_disks": between})})
    rng = np.random.default_rng(6)
    positions, rotations = draw_poses(robot, rng, 60, bending=0.03, along=(-0.2, -0.1))
    fielded, plain = _scenes(pipe_mesh, robot)
    values = fielded.clearance(positions, rotations)
    np.testing.assert_allclose(plain.clearance(positions, rotations), values, rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(plain.check(positions, rotations) == 0, values > 0.0)
    arrays = RobotBody(robot).arrays
    angle = 2 * np.pi * np.arange(48) / 48
    for row in np.flatnonzero(values > 0.0)[:6]:
        centres, frames, halves = place_solids(arrays, positions[row], rotations[row])
        least = np.inf
        for k, (centre, frame, half) in enumerate(zip(centres, frames, halves, strict=True)):
            circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * arrays.radius[k]
            rings = [circle + np.array([0, 0, z]) for z in np.linspace(-half, half, 9)]
            least = min(
                least, nearest_distances(pipe_mesh.wall_tree, np.concatenate(rings) @ frame.T + centre)[0].min()
            )
        # Points 1/48 of a turn apart on a rim of 10 mm miss the nearest one by up to 0.01 (1 - cos(pi / 48)) = 2.1e-5.
        assert values[row] - 1e-12 <= least <= values[row] + 3e-5


def test_several_meshes_give_the_least(paper, shapes, pipe_mesh):
    ball = SceneMesh.from_arrays("ball", *shapes.sphere(0.02, (0.0, 0.0, 0.09)), "obstacle")
    body = RobotBody(paper)
    poses = _straight(paper, (0.0, 0.0, -0.15))
    alone = [CollisionScene([mesh], body, cells=CELLS).clearance(*poses)[0] for mesh in (ball, pipe_mesh)]
    assert CollisionScene([ball, pipe_mesh], body, cells=CELLS).clearance(*poses)[0] == min(alone)
    assert CollisionScene([], body).clearance(*poses)[0] == np.inf
