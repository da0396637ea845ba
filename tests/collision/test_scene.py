"""Verdicts, contacts and sides against cases whose answer is plain, and against dense points on the body."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.meshes import SceneMesh, load_scene_mesh
from tdcr_planner.collision.scene import CollisionScene, Verdict
from tdcr_planner.errors import InputError


def _straight(robot, shift=(0.0, 0.0, 0.0)):
    positions = np.zeros((1, robot.disk_count, 3))
    positions[0, :, 2] = robot.arc_lengths
    return positions + np.asarray(shift), np.broadcast_to(np.eye(3), (1, robot.disk_count, 3, 3)).copy()


def test_a_body_wholly_inside_a_solid_is_in_collision(paper, shapes):
    mesh = SceneMesh.from_arrays("block", *shapes.box((1.0, 1.0, 1.0)), "obstacle")
    scene = CollisionScene([mesh], RobotBody(paper))
    assert scene.check(*_straight(paper)).tolist() == [Verdict.OBSTACLE]
    contact = scene.first_contact(*(array[0] for array in _straight(paper)))
    assert contact.verdict is Verdict.OBSTACLE
    assert contact.triangle == -1
    assert "inside of block" in str(contact)
    assert scene.check(*_straight(paper, (2.0, 0.0, 0.0))).tolist() == [Verdict.FREE]


def test_a_body_wholly_outside_a_cavity_is_in_collision(paper, pipe_mesh):
    scene = CollisionScene([pipe_mesh], RobotBody(paper))
    verdicts = [scene.check(*_straight(paper, shift))[0] for shift in ((0.1, 0, 0), (0, 0, -0.15), (0, 0, -0.05))]
    assert verdicts == [Verdict.CAVITY, Verdict.FREE, Verdict.CAVITY]
    # Behind the entry plane the body may be outside, also beside the tube.
    assert scene.check(*_straight(paper, (0.1, 0, -0.25))).tolist() == [Verdict.FREE]


def test_the_wall_counts_behind_the_entry_plane_too(paper, shapes):
    vertices, faces = shapes.pipe(straight=0.3, angle=0.05)
    mesh = SceneMesh.from_arrays("pipe", vertices, faces, "cavity", [0, 0, 0.25], [0, 0, 1])
    scene = CollisionScene([mesh], RobotBody(paper))
    assert scene.check(*_straight(paper)).tolist() == [Verdict.FREE]
    assert scene.check(*_straight(paper, (0.016, 0, 0))).tolist() == [Verdict.CAVITY]
    assert scene.check(*_straight(paper, (0.1, 0, 0))).tolist() == [Verdict.FREE]


def test_a_part_that_only_reaches_over_the_entry_plane_is_judged_there(paper, pipe_mesh):
    # The last disk's centre is 0.5 mm behind the plane and 0.1 m beside the tube; its face is 0.5 mm in front.
    scene = CollisionScene([pipe_mesh], RobotBody(paper))
    assert scene.check(*_straight(paper, (0.1, 0, -0.2005))).tolist() == [Verdict.CAVITY]
    assert scene.check(*_straight(paper, (0.0, 0, -0.2005))).tolist() == [Verdict.FREE]


def test_a_body_must_not_poke_out_of_the_far_opening(paper, shapes):
    vertices, faces = shapes.pipe(straight=0.15, angle=0.01)
    mesh = SceneMesh.from_arrays("stub", vertices, faces, "cavity", [0, 0, 0], [0, 0, 1])
    scene = CollisionScene([mesh], RobotBody(paper))
    assert scene.check(*_straight(paper)).tolist() == [Verdict.CAVITY]
    assert scene.check(*_straight(paper, (0, 0, -0.06))).tolist() == [Verdict.FREE]


def test_first_contact_names_part_triangle_and_point(paper, shapes):
    mesh = SceneMesh.from_arrays("post", *shapes.box((0.02, 0.02, 0.015), (0.0185, 0.0, 0.1)), "obstacle")
    scene = CollisionScene([mesh], RobotBody(paper))
    positions, rotations = _straight(paper)
    contact = scene.first_contact(positions[0], rotations[0])
    assert contact.mesh == "post"
    assert contact.part == "disk 10"
    assert contact.verdict is Verdict.OBSTACLE
    assert 0 <= contact.triangle < len(mesh.faces)
    assert np.linalg.norm(contact.point - positions[0, 10]) < 0.0102
    assert scene.first_contact(positions[0] - [0.1, 0, 0], rotations[0]) is None


def test_contacts_name_every_part_that_touches(paper, shapes):
    # a wall through disks 9 to 11 (90 to 110 mm): their spacing is 10 mm, so the wall's ends lie in gaps
    mesh = SceneMesh.from_arrays("wall", *shapes.box((0.02, 0.02, 0.026), (0.0185, 0.0, 0.1)), "obstacle")
    scene = CollisionScene([mesh], RobotBody(paper))
    positions, rotations = _straight(paper)
    contacts = scene.contacts(positions[0], rotations[0])
    assert [contact.part for contact in contacts] == ["disk 11", "disk 10", "disk 9"]
    assert str(contacts[0]) == str(scene.first_contact(positions[0], rotations[0]))
    assert scene.contacts(positions[0] - [0.1, 0, 0], rotations[0]) == []
    inside = CollisionScene(
        [SceneMesh.from_arrays("block", *shapes.box((1.0, 1.0, 1.0)), "obstacle")], RobotBody(paper)
    )
    assert [contact.triangle for contact in inside.contacts(positions[0], rotations[0])] == [-1]


def test_margins_decide(paper, shapes):
    mesh = SceneMesh.from_arrays("plate", *shapes.box((0.02, 0.2, 0.2), (0.021, 0.0, 0.1)), "obstacle")
    scene = CollisionScene([mesh], RobotBody(paper))
    poses = _straight(paper)
    assert scene.check(*poses).tolist() == [Verdict.FREE]
    assert scene.with_margins(np.full(paper.disk_count, 0.0009)).check(*poses).tolist() == [Verdict.FREE]
    assert scene.with_margins(np.full(paper.disk_count, 0.0011)).check(*poses).tolist() == [Verdict.OBSTACLE]


def test_a_pose_that_is_not_finite_is_never_free(paper, pipe_mesh):
    scene = CollisionScene([pipe_mesh], RobotBody(paper))
    positions, rotations = _straight(paper, (0, 0, -0.15))
    positions, rotations = np.repeat(positions, 3, axis=0), np.repeat(rotations, 3, axis=0)
    positions[1, 5, 2] = np.nan
    rotations[2, 7, 0, 0] = np.inf
    assert scene.check(positions, rotations).tolist() == [Verdict.FREE, Verdict.UNDEFINED, Verdict.UNDEFINED]
    assert scene.clearance(positions, rotations)[1:].tolist() == [-np.inf, -np.inf]
    assert scene.first_contact(positions[2], rotations[2]).part == "disk 7"


def test_shapes_are_checked(paper, pipe_mesh):
    scene = CollisionScene([pipe_mesh], RobotBody(paper))
    with pytest.raises(InputError, match=r"positions: expected shape \(n, 21, 3\), got shape \(1, 20, 3\)"):
        scene.check(np.zeros((1, 20, 3)), np.zeros((1, 20, 3, 3)))
    with pytest.raises(InputError, match="rotations"):
        scene.check(np.zeros((1, 21, 3)), np.zeros((2, 21, 3, 3)))


def test_an_empty_batch_has_no_verdicts(paper, pipe_mesh):
    scene = CollisionScene([pipe_mesh], RobotBody(paper))
    assert scene.check(np.zeros((0, 21, 3)), np.zeros((0, 21, 3, 3))).shape == (0,)


def test_verdict_and_clearance_agree_on_random_states(paper, pipe_mesh, draw_poses):
    scene = CollisionScene([pipe_mesh], RobotBody(paper))
    poses = draw_poses(paper, np.random.default_rng(3), 150, bending=0.03, along=(-0.2, -0.05))
    free = scene.check(*poses) == Verdict.FREE
    clearance = scene.clearance(*poses)
    assert 10 < free.sum() < 140
    # Another algorithm (closed-form distances) than FCL's: a state within 1e-9 m of touching could differ, none is.
    np.testing.assert_array_equal(free, clearance > 0.0)


def test_a_mesh_in_the_wrong_unit_is_hinted_at(paper, shapes, caplog):
    length = paper.length
    for size, hint in ((0.2, False), (19.9 * length, False), (20.1 * length, True), (0.0005, True)):
        mesh = SceneMesh.from_arrays("part.stl", *shapes.box((size, size, size)), "obstacle")
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            CollisionScene([mesh], RobotBody(paper), field=None)
        assert ("part.stl: its size is" in caplog.text) == hint


def test_the_hint_at_units_names_the_size_and_the_unit(paper, shapes, tmp_path, caplog):
    vertices, faces = shapes.box((90.0, 195.0, 80.0))
    trimesh.Trimesh(vertices, faces).export(tmp_path / "part.stl")
    mesh = load_scene_mesh(tmp_path / "part.stl", "in", "obstacle")
    with caplog.at_level(logging.WARNING):
        CollisionScene([mesh], RobotBody(paper), field=None)
    ratio = f"{195.0 * 0.0254 / paper.length:.0f}"
    assert f"part.stl: its size after unit 'in' is 2286 x 4953 x 2032 mm, {ratio} times the robot" in caplog.text


def test_the_same_margins_give_the_same_scene(paper):
    scene = CollisionScene([], RobotBody(paper))
    grown = scene.with_margins(np.full(paper.disk_count, 0.001))
    assert grown.with_margins(np.full(paper.disk_count, 0.002)) is scene.with_margins(np.full(paper.disk_count, 0.002))
    assert scene.with_margins(np.full(paper.disk_count, 0.001)) is grown
    np.testing.assert_array_equal(grown.body.margins, 0.001)
