"""The field's bounds against exact distances, its cache, and its verdicts against FCL alone."""

from __future__ import annotations

import hashlib
import logging

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.collision.body import RobotBody, Shaft
from tdcr_planner.collision.containment import make_side
from tdcr_planner.collision.field import LEAST_CELLS, MOST_FIELDS, bounds_at, build_field, share_nodes
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene

CELLS = 20_000


@pytest.fixture(scope="module")
def scene_meshes(shapes):
    """A mesh of each kind that a scene can hold, all within reach of a robot that is moved by up to 0.1 m."""
    wall, faces = shapes.pipe(radius=0.03, straight=0.1)
    room = shapes.box((0.5, 0.5, 0.5), fine=2)
    # A hollow block: the inner shell is turned inwards, so what it encloses is not solid.
    block, void = shapes.box((0.6, 0.6, 0.6)), shapes.box((0.5, 0.5, 0.5))
    hollow = np.concatenate([block[0], void[0]]), np.concatenate([block[1], void[1][:, ::-1] + len(block[0])])
    return {
        "pipe": SceneMesh.from_arrays("pipe", wall, faces, "cavity", [0, 0, 0], [0, 0, 1]),
        "pipe entered through its side of the world": SceneMesh.from_arrays(
            "pipe", wall, faces, "cavity", [0, 0, 0.05], [0.2, 0.1, 1]
        ),
        "room": SceneMesh.from_arrays("room", *room, "cavity"),
        "box": SceneMesh.from_arrays("box", *shapes.box((0.1, 0.06, 0.08)), "obstacle"),
        "sphere": SceneMesh.from_arrays("sphere", *shapes.sphere(0.05), "obstacle"),
        "sheet": SceneMesh.from_arrays("sheet", *shapes.sheet(0.15), "obstacle"),
        "thin wall": SceneMesh.from_arrays("thin", *shapes.box((0.2, 0.2, 0.0001)), "obstacle"),
        "shell": SceneMesh.from_arrays("shell", *hollow, "obstacle"),
    }


KINDS = [
    "pipe", "pipe entered through its side of the world", "room", "box", "sphere", "sheet", "thin wall", "shell",
]  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_hold_the_exact_distance_and_side(scene_meshes, kind):
    mesh = scene_meshes[kind]
    field = build_field(mesh, make_side(mesh), CELLS)
    rng = np.random.default_rng(5)
    low, high = mesh.bounds - 0.02 * np.array([[1.0], [-1.0]])
    points = rng.uniform(low, high, (400, 3))
    # trimesh's own search over its r-tree is the other algorithm.
    walls = trimesh.Trimesh(mesh.wall_vertices, mesh.wall_faces, process=False)
    distance = trimesh.proximity.closest_point(walls, points)[1]
    inside = mesh.contains(points)
    front = np.ones(len(points), bool) if mesh.entry is None else mesh.entry.depth(points) > 0.0
    right = (inside | ~front) if mesh.role == "cavity" else ~inside
    told = 0
    for k, point in enumerate(points):
        lower, upper, side = bounds_at(field, *point, np.inf)
        assert lower <= distance[k] <= upper
        if ((mesh.bounds[0] <= point) & (point <= mesh.bounds[1])).all():
            # A corner is at most a cell's diagonal away, so neither bound misses the truth by more than twice that.
            assert upper - lower <= 2.0 * np.sqrt(3.0) * field.spacing
        assert side in (0, 1 if right[k] else -1)
        told += side != 0
    assert told > 200


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("between", ["tendons", "sleeve"])
def test_field_and_fcl_give_the_answers_of_fcl_alone(paper, two_segment, scene_meshes, draw_poses, kind, between):
    rng = np.random.default_rng(11)
    robot = (paper if between == "tendons" else two_segment).model_copy(
        update={"body": paper.body.model_copy(update={"between_disks": between})}
    )
    margins = rng.uniform(0.0, 0.003, robot.disk_count)
    body = RobotBody(robot, margins, Shaft(0.006, (0.0, 0.0, -0.15)))
    mesh = scene_meshes[kind]
    along = (-0.25, 0.05)
    fielded = CollisionScene([mesh], body, cells=CELLS)
    plain = CollisionScene([mesh], body, field=None)
    cases = [
        draw_poses(robot, rng, 120, bending=0.15, along=along),
        draw_poses(robot, rng, 120, bending=0.6, along=along),
        draw_poses(robot, rng, 120, bending=0.4, spread=0.12),
    ]
    poses = tuple(np.concatenate(part) for part in zip(*cases, strict=True))
    expected = plain.check(*poses)
    assert 5 < (expected == 0).sum() < 355
    np.testing.assert_array_equal(fielded.check(*poses), expected)
    # The same states one at a time, and the contact that explains the verdict.
    for k in range(0, len(expected), 40):
        one = poses[0][k : k + 1], poses[1][k : k + 1]
        assert fielded.check(*one)[0] == expected[k]
        contact = plain.first_contact(one[0][0], one[1][0])
        assert (contact is None) == (expected[k] == 0)
        assert contact is None or contact.verdict == expected[k]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), margin=st.floats(0.0, 0.004))
def test_any_states_get_the_answers_of_fcl_alone(paper, scene_meshes, draw_poses, seed, margin):
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    body = RobotBody(paper, np.full(paper.disk_count, margin))
    poses = draw_poses(paper, rng, 25, bending=rng.uniform(0.05, 1.0), along=(-0.2, 0.0))
    expected = CollisionScene([scene_meshes[kind]], body, field=None).check(*poses)
    np.testing.assert_array_equal(CollisionScene([scene_meshes[kind]], body, cells=CELLS).check(*poses), expected)


def test_several_meshes_are_all_asked(paper, scene_meshes, draw_poses):
    meshes = [scene_meshes["room"], scene_meshes["sphere"], scene_meshes["sheet"]]
    body = RobotBody(paper)
    poses = draw_poses(paper, np.random.default_rng(2), 150, spread=0.2)
    free = CollisionScene(meshes, body, field=None).check(*poses) == 0
    np.testing.assert_array_equal(CollisionScene(meshes, body, cells=CELLS).check(*poses) == 0, free)
    assert 10 < free.sum() < 140


@pytest.mark.parametrize("field", ["auto", None])
def test_a_hit_is_found_exactly_where_there_is_one(paper, scene_meshes, draw_poses, field):
    meshes = [scene_meshes["room"], scene_meshes["sphere"], scene_meshes["sheet"]]
    scene = CollisionScene(meshes, RobotBody(paper), cells=CELLS, field=field)
    positions, rotations = draw_poses(paper, np.random.default_rng(8), 120, spread=0.2)
    positions[7, 3] = np.nan
    codes = scene.check(positions, rotations)
    assert len(np.unique(codes)) >= 4
    for start in range(0, 120, 3):
        batch = slice(start, start + 3)
        place, code = scene.find_hit(positions[batch], rotations[batch])
        if code:
            assert codes[start + place] == code
        else:
            assert place == -1
            assert not codes[batch].any()
    free = codes == 0
    assert scene.find_hit(positions[free], rotations[free]) == (-1, 0)
    assert scene.find_hit(positions[:0], rotations[:0]) == (-1, 0)


@pytest.fixture
def cached_ball(shapes, tmp_path, monkeypatch):
    """A mesh, its field, and the file that the field is cached in."""
    monkeypatch.setenv("TDCR_CACHE_DIR", str(tmp_path))
    mesh = SceneMesh.from_arrays("ball", *shapes.sphere(0.05), "obstacle")
    built = build_field(mesh, make_side(mesh), CELLS)
    (file,) = tmp_path.glob("field-*.bin")
    return mesh, built, file


def test_a_cached_field_is_read(cached_ball, caplog):
    mesh, built, file = cached_ball
    written = file.stat().st_mtime_ns
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(build_field(mesh, make_side(mesh), CELLS).values, built.values)
    assert file.stat().st_mtime_ns == written
    assert not caplog.records


def of_another_shape(content):
    """Returns what a file would hold whose field has fewer nodes: its hash is right, its length is not."""
    payload = content[32:-400]
    return hashlib.sha256(payload).digest() + payload


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:1000],
        lambda content: content[:-1] + bytes([content[-1] ^ 1]),
        lambda content: np.random.default_rng(0).bytes(len(content)),
        of_another_shape,
        lambda content: content + content,
    ],
    ids=["empty", "truncated", "one bit", "garbage", "another shape", "twice"],
)
def test_a_damaged_cache_is_rebuilt(cached_ball, caplog, damage):
    mesh, built, file = cached_ball
    content = file.read_bytes()
    file.write_bytes(damage(content))
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(build_field(mesh, make_side(mesh), CELLS).values, built.values)
    assert "is damaged" in caplog.text
    assert file.read_bytes() == content


def test_a_cache_that_cannot_be_read_is_computed_again(cached_ball, caplog):
    mesh, built, file = cached_ball
    # A folder in its place: what a file without permission is to a user, also where the tests run as root.
    file.unlink()
    file.mkdir()
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(build_field(mesh, make_side(mesh), CELLS).values, built.values)
    assert "cannot be read, so the field is computed again" in caplog.text


def test_a_cache_that_others_can_write_to_is_not_used(cached_ball, caplog):
    mesh, built, file = cached_ball
    file.parent.chmod(0o777)
    wrong = bytes(len(file.read_bytes()) - 32)
    file.write_bytes(hashlib.sha256(wrong).digest() + wrong)
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            np.testing.assert_array_equal(build_field(mesh, make_side(mesh), CELLS).values, built.values)
    (record,) = caplog.records
    assert "other users can write there; TDCR_CACHE_DIR can name" in record.message


def test_a_stored_field_that_others_can_write_to_is_computed_again(cached_ball, caplog):
    mesh, built, file = cached_ball
    wrong = bytes(len(file.read_bytes()) - 32)
    file.write_bytes(hashlib.sha256(wrong).digest() + wrong)
    file.chmod(0o666)
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(build_field(mesh, make_side(mesh), CELLS).values, built.values)
    assert "can be written by other users" in caplog.text


def test_another_role_or_entry_has_another_field(shapes, tmp_path, monkeypatch):
    monkeypatch.setenv("TDCR_CACHE_DIR", str(tmp_path))
    ball = shapes.sphere(0.05)
    for mesh in (
        SceneMesh.from_arrays("ball", *ball, "obstacle"),
        SceneMesh.from_arrays("ball", *ball, "cavity"),
        SceneMesh.from_arrays("ball", *ball, "cavity", [0, 0, 0], [0, 0, 1]),
    ):
        build_field(mesh, make_side(mesh), CELLS)
    assert len(list(tmp_path.glob("field-*.bin"))) == 3


def test_a_cache_that_cannot_be_written_is_one_warning(shapes, tmp_path, monkeypatch, caplog):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    monkeypatch.setenv("TDCR_CACHE_DIR", str(blocked))
    meshes = [SceneMesh.from_arrays("ball", *shapes.sphere(size), "obstacle") for size in (0.05, 0.06)]
    with caplog.at_level(logging.WARNING):
        for mesh in meshes:
            assert len(build_field(mesh, make_side(mesh), CELLS).values) > 0
    (record,) = caplog.records
    assert "distance fields are not kept for later runs" in record.message
    assert str(blocked) in record.message


def test_a_user_without_a_home_keeps_no_fields(shapes, monkeypatch):
    for variable in ("TDCR_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)

    def no_home():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr("pathlib.Path.home", no_home)
    mesh = SceneMesh.from_arrays("ball", *shapes.sphere(0.05), "obstacle")
    assert len(build_field(mesh, make_side(mesh), CELLS).values) > 0


def test_small_meshes_get_few_nodes_and_many_share_a_bounded_number(shapes):
    small = SceneMesh.from_arrays("small", *shapes.box((0.001, 0.002, 0.001)), "obstacle")
    large = SceneMesh.from_arrays("large", *shapes.box((1.0, 1.0, 1.0)), "obstacle")
    assert share_nodes([small, large], 3e-4) == [LEAST_CELLS, 500_000]
    assert share_nodes([], 3e-4) == []
    many = share_nodes([large] * 100 + [small], 3e-4)
    assert sum(many) <= MOST_FIELDS * 500_000 + LEAST_CELLS
    assert min(many) == LEAST_CELLS
    assert share_nodes([large], 0.1) == [LEAST_CELLS]
    assert share_nodes([large], 0.02) == [125_000]


def test_many_meshes_answer_as_one_without_fields(shapes, paper, draw_poses):
    meshes = [
        SceneMesh.from_arrays(f"box {k}", *shapes.box((0.01, 0.02, 0.01), (0.05 * (k % 3), 0.03, 0.04 * k)), "obstacle")
        for k in range(9)
    ]
    body = RobotBody(paper)
    poses = draw_poses(paper, np.random.default_rng(8), 150)
    fielded, exact = CollisionScene(meshes, body, cells=2000), CollisionScene(meshes, body, field=None)
    verdicts = exact.check(*poses)
    assert 0 < np.count_nonzero(verdicts) < len(verdicts)
    np.testing.assert_array_equal(fielded.check(*poses), verdicts)
