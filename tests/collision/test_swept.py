"""Motions proved by one cylinder: against the exact clearance of what lies in between."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.robot import load_robot

HOLE, LENGTH = 0.0017, 0.06  # radius and length of a hole about the z axis, m; the robot's radius is 0.0015 m
ROBOT = 0.0015
SPARE = 2e-6  # above what the collision tests keep for rounding, m


@pytest.fixture(scope="module")
def hole(root):
    robot = load_robot(root / "models/robots/borescope.toml")
    mesh = trimesh.creation.annulus(HOLE / np.cos(np.pi / 64), 0.02, LENGTH, sections=64)
    scene_mesh = SceneMesh.from_arrays("hole.stl", np.array(mesh.vertices), np.array(mesh.faces), "obstacle")
    return CollisionScene([scene_mesh], RobotBody(robot, np.zeros(robot.disk_count)))


@pytest.fixture(scope="module")
def judge(hole):
    """Returns a function that says whether all of the way between two states is shown to keep a distance.

    No ball about a part fits into the hole, and slack is not asked for, so that only the cylinders can show it.
    """

    def judge(kept, positions, rotations):
        disks = hole.body.robot.disk_count
        prover = hole.make_prover(np.full(disks, kept))
        motion = np.linalg.norm(positions[1:] - positions[:1], axis=2)
        stray = np.zeros_like(motion)
        order, record = np.arange(2), prover.record(2)
        _, moved = prover.open_intervals(positions, rotations, order, motion, stray, record, 0.0)
        return moved[0] == 0.0

    return judge


def straight(scene, push=0.0, aside=0.0):
    robot = scene.body.robot
    positions = np.zeros((2, robot.disk_count, 3))
    positions[:, :, 2] = robot.arc_lengths - 0.5 * robot.length
    positions[1, :, 2] += push
    positions[1, :, 0] += aside
    return positions, np.tile(np.eye(3), (2, robot.disk_count, 1, 1))


@pytest.mark.parametrize("push", [0.001, 0.01, 0.05])
def test_a_push_along_the_axis_keeps_the_gap_however_far_it_goes(hole, judge, push):
    assert judge(HOLE - ROBOT - SPARE, *straight(hole, push))
    assert not judge(HOLE - ROBOT + SPARE, *straight(hole, push))


def test_a_motion_aside_takes_what_it_moves(hole, judge):
    aside = 1e-4
    # The cylinder is wider than the body and lies aslant, so that its ends reach farther aside than the body's.
    assert judge(HOLE - ROBOT - 1.7 * aside, *straight(hole, 0.005, aside))
    assert not judge(HOLE - ROBOT - aside + SPARE, *straight(hole, 0.005, aside))


def test_what_is_proved_keeps_the_distance_at_all_states_between(hole, judge):
    generator = np.random.default_rng(5)
    share = np.linspace(0.0, 1.0, 41)[:, None, None]
    kept, proved, left_open = 5e-5, 0, 0
    for _ in range(60):
        positions, rotations = straight(hole, generator.uniform(0.0, 0.01))
        wave = generator.uniform(0.0, 2.0e-4) * np.sin(positions[:, :, 2:] * 60.0 + generator.uniform(0.0, 6.0))
        turn = generator.uniform(0.0, 2.0 * np.pi, (2, 1))
        positions[:, :, :2] += wave * np.stack([np.cos(turn), np.sin(turn)], axis=2)
        if (hole.clearance(positions, rotations) <= 0.0).any():
            continue
        between = positions[:1] + share * (positions[1:] - positions[:1])
        least = hole.clearance(between, np.repeat(rotations[:1], len(share), axis=0)).min()
        if judge(kept, positions, rotations):
            proved += 1
            assert least >= kept
        else:
            left_open += 1
    assert proved > 5
    assert left_open > 5
