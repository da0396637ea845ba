"""Slack in and between states: against exact clearances, and against dense states in between."""

from __future__ import annotations

import fcl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.collision.body import RobotBody, place_solids
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene, Verdict
from tdcr_planner.collision.self_slack import self_slack, solids_apart

CELLS = 20_000
# What a distance counts less than it is, so that rounding never counts for it; twice that of the collision tests.
SPARE = 2e-6
KINDS = ["pipe", "pipe entered aslant", "room", "sphere", "thin wall"]


@pytest.fixture(scope="module")
def scene_meshes(shapes):
    wall, faces = shapes.pipe(radius=0.02, straight=0.1)
    return {
        "pipe": SceneMesh.from_arrays("pipe", wall, faces, "cavity", [0, 0, 0], [0, 0, 1]),
        "pipe entered aslant": SceneMesh.from_arrays("pipe", wall, faces, "cavity", [0, 0, 0.05], [0.2, 0.1, 1]),
        "room": SceneMesh.from_arrays("room", *shapes.box((0.4, 0.4, 0.5), fine=2), "cavity"),
        "sphere": SceneMesh.from_arrays("sphere", *shapes.sphere(0.05), "obstacle"),
        "thin wall": SceneMesh.from_arrays("thin", *shapes.box((0.2, 0.2, 0.0001)), "obstacle"),
    }


@pytest.fixture(scope="module")
def scenes(paper, scene_meshes):
    """Returns a function that gives the scene of a mesh with the robot's body grown by a margin."""
    body = RobotBody(paper)
    bare = {kind: CollisionScene([mesh], body, cells=CELLS) for kind, mesh in scene_meshes.items()}
    return lambda kind, margin: bare[kind].with_margins(np.full(paper.disk_count, margin))


def free_poses(scene, draw_poses, paper, rng, count, **how):
    poses = draw_poses(paper, rng, count, **how)
    free = scene.check(*poses) == Verdict.FREE
    return poses[0][free], poses[1][free]


@pytest.mark.parametrize("kind", KINDS)
def test_the_slack_of_a_state_is_never_above_what_it_keeps(paper, scenes, draw_poses, kind):
    rng = np.random.default_rng(3)
    scene = scenes(kind, 0.001)
    poses = free_poses(scene, draw_poses, paper, rng, 300, bending=0.3, along=(-0.25, 0.1))
    assert len(poses[0]) > 20
    kept = scene.clearance(*poses) - 0.001
    for cap in (0.0005, 0.005):
        slack = scene.prover.slack(*poses, cap)
        assert (slack <= np.minimum(kept, cap) + 1e-12).all()
        assert (slack >= 0.0).all()
        # Where nothing but the walls is near it is the distance itself; behind the entry plane the plane counts too.
        apart = np.array(
            [self_slack(scene._self_pairs, scene.body.arrays, *pose, 1.0) for pose in zip(*poses, strict=True)]
        )
        if "pipe" not in kind:
            np.testing.assert_allclose(slack, np.minimum(np.minimum(kept, cap), 0.5 * apart), atol=SPARE)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_comes_nearer_than_it_must_in_an_interval_that_is_proved(paper, scenes, draw_poses, kind):
    """Bodies that move straight on, so that nothing strays: the whole way must be free where it counts as proved."""
    rng = np.random.default_rng(7)
    proved = left_open = 0
    share = np.linspace(0.0, 1.0, 33)[:, None, None]
    for margin in (0.0, 0.001):
        scene, bare = scenes(kind, margin), scenes(kind, 0.0)
        start, frames = free_poses(scene, draw_poses, paper, rng, 500, bending=0.3, along=(-0.22, 0.12))
        step = rng.normal(size=(len(start), 1, 3)) * rng.choice([0.002, 0.01, 0.04], (len(start), 1, 1))
        good = scene.check(start + step, frames) == Verdict.FREE
        for place, frame, move in zip(start[good], frames[good], step[good], strict=True):
            positions, rotations = np.stack([place, place + move]), np.stack([frame, frame])
            motion = np.full((1, paper.disk_count), np.linalg.norm(move))
            for stray, exact_below in ((0.0, 0.0), (np.inf, np.inf)):
                record = scene.prover.record(2)
                _, moved = scene.prover.open_intervals(
                    positions, rotations, np.arange(2), motion, np.full_like(motion, stray), record, exact_below
                )
                if moved[0] > 0.0:
                    left_open += 1
                    continue
                proved += 1
                between = place + share * move, np.repeat(frame[None], len(share), axis=0)
                assert (bare.check(*between) == Verdict.FREE).all()
                assert (bare.clearance(*between) >= margin).all()
    assert proved > 20
    assert left_open > 20


def test_a_wall_between_two_states_leaves_their_interval_open(paper, scenes, draw_poses):
    scene = scenes("thin wall", 0.0)
    pose = draw_poses(paper, np.random.default_rng(1), 1, bending=0.0)
    # The robot is 200 mm long: below the wall, and above it.
    positions = np.concatenate([pose[0] - [0.0, 0.0, 0.21], pose[0] + [0.0, 0.0, 0.02]])
    rotations = np.repeat(pose[1], 2, axis=0)
    assert (scene.check(positions, rotations) == Verdict.FREE).all()
    motion = np.full((1, paper.disk_count), 0.23)
    for stray in (0.0, np.inf):
        record = scene.prover.record(2)
        strays = np.full_like(motion, stray)
        _, moved = scene.prover.open_intervals(positions, rotations, np.arange(2), motion, strays, record, 1.0)
        assert moved[0] == pytest.approx(0.23)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_how_far_solids_are_apart_is_fcls_distance_at_most(paper, draw_poses, seed):
    rng = np.random.default_rng(seed)
    arrays = RobotBody(paper, rng.uniform(0.0, 0.002, paper.disk_count)).arrays
    positions, rotations = (part[0] for part in draw_poses(paper, rng, 1, bending=1.0))
    centres, frames, halves = place_solids(arrays, positions, rotations)
    for one, other in rng.integers(0, len(halves), (10, 2)).tolist():
        if one == other:
            continue
        solids = [
            fcl.CollisionObject(
                (fcl.Capsule if arrays.round_ends[k] else fcl.Cylinder)(float(arrays.radius[k]), 2.0 * halves[k]),
                fcl.Transform(frames[k], centres[k]),
            )
            for k in (one, other)
        ]
        distance = fcl.distance(*solids, fcl.DistanceRequest(), fcl.DistanceResult())
        bound = solids_apart(arrays, one, other, positions, rotations, np.inf)
        # FCL's distance of two curved solids is sharp to about a micrometre.
        assert bound <= max(distance, 0.0) + 2e-6
        if distance > 1e-3:
            assert bound > 0.9 * distance
