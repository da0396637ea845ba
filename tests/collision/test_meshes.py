"""Reading meshes, refusing what cannot serve, and telling inside from outside."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.meshes import SceneMesh, format_point, load_scene_mesh
from tdcr_planner.errors import FormatError, InputError


def _export(path, vertices, faces):
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "off", "glb"])
@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)])
def test_a_mesh_is_read_in_metres(shapes, tmp_path, suffix, unit, scale):
    path = _export(tmp_path / f"box.{suffix}", *shapes.box((2.0, 4.0, 6.0)))
    mesh = load_scene_mesh(path, unit, "obstacle")
    # Single precision in the file: 6e-8 of the size.
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0).ravel(), np.array([2.0, 4.0, 6.0]) * scale, rtol=1e-6)
    assert len(mesh.vertices) == 8
    assert len(mesh.faces) == 12
    assert mesh.bounded
    assert mesh.name == f"box.{suffix}"


def test_faults_of_a_file_name_the_file(tmp_path, shapes):
    def fault(path, *arguments):
        with pytest.raises(FormatError) as caught:
            load_scene_mesh(path, *(arguments or ("mm", "obstacle")))
        assert str(path) in str(caught.value)
        return str(caught.value)

    assert "no such file" in fault(tmp_path / "gone.stl")
    assert "is a folder" in fault(tmp_path)
    for name, content in (("junk.stl", b"junk"), ("empty.stl", b""), ("cut.ply", b"ply\nformat ascii 1.0\n")):
        (tmp_path / name).write_bytes(content)
        fault(tmp_path / name)
    (tmp_path / "mesh.docx").write_bytes(b"PK")
    assert "cannot be read as a mesh" in fault(tmp_path / "mesh.docx")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    fault(tmp_path / "points.obj")
    (tmp_path / "nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert "not finite" in fault(tmp_path / "nan.obj")
    (tmp_path / "point.obj").write_text("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
    assert "no triangles" in fault(tmp_path / "point.obj")


def test_faults_of_arguments_are_named(tmp_path, shapes):
    path = _export(tmp_path / "box.stl", *shapes.box((1, 1, 1)))
    with pytest.raises(InputError, match="^unit: got 'feet' for the mesh file's unit of length; valid: cm, in, m, mm$"):
        load_scene_mesh(path, "feet", "obstacle")
    with pytest.raises(InputError, match=r"^role: got 'cavty'; did you mean 'cavity'\? valid: cavity, obstacle$"):
        load_scene_mesh(path, "mm", "cavty")
    with pytest.raises(InputError, match="entry_normal: .*only one of them"):
        load_scene_mesh(path, "mm", "cavity", (0, 0, 0))
    with pytest.raises(InputError, match="entry_normal: expected a direction"):
        load_scene_mesh(path, "mm", "cavity", (0, 0, 0), (0, 0, 0))
    with pytest.raises(InputError, match="no entry for an obstacle"):
        load_scene_mesh(path, "mm", "obstacle", (0, 0, 0), (0, 0, 1))


def test_repeated_and_collapsed_faces_are_dropped_and_corners_merged(shapes):
    vertices, faces = shapes.box((1, 1, 1))
    soup = vertices[faces].reshape(-1, 3) + np.random.default_rng(0).normal(scale=1e-9, size=(36, 3))
    triangles = np.arange(36).reshape(-1, 3)
    triangles = np.concatenate([triangles, triangles[:2], [[0, 0, 1]], triangles[3:4, ::-1]])
    mesh = SceneMesh.from_arrays("box", soup, triangles, "obstacle")
    assert (len(mesh.vertices), len(mesh.faces), mesh.bounded) == (8, 12, True)


@pytest.mark.parametrize("turned", ["none", "all", "some", "one piece of two"])
@pytest.mark.parametrize("role", ["obstacle", "cavity"])
def test_orientation_does_not_change_the_inside(shapes, role, turned):
    rng = np.random.default_rng(4)
    one, other = shapes.sphere(0.05), shapes.sphere(0.03, (0.2, 0.0, 0.0))
    vertices, faces = np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1] + len(one[0])])
    turn = {
        "none": np.zeros(len(faces), bool),
        "all": np.ones(len(faces), bool),
        "some": rng.random(len(faces)) < 0.5,
        "one piece of two": np.arange(len(faces)) >= len(one[1]),
    }[turned]
    faces = np.where(turn[:, None], faces[:, ::-1], faces)
    mesh = SceneMesh.from_arrays("balls", vertices, faces, role)
    points = rng.uniform((-0.1, -0.1, -0.1), (0.3, 0.1, 0.1), (2000, 3))
    to_one, to_other = np.linalg.norm(points, axis=1) - 0.05, np.linalg.norm(points - [0.2, 0, 0], axis=1) - 0.03
    # The facets of 1280 triangles lie up to 0.4 % of the radius inside the sphere.
    clear = (np.abs(to_one) > 3e-4) & (np.abs(to_other) > 3e-4)
    np.testing.assert_array_equal(mesh.contains(points)[clear], ((to_one < 0) | (to_other < 0))[clear])


def test_a_pipe_is_capped_where_it_does_not_lie_behind_the_entry(shapes):
    vertices, faces = shapes.pipe(straight=0.1, angle=0.01, around=24, along=10)
    entered = SceneMesh.from_arrays("pipe", vertices, faces, "cavity", [0, 0, 0], [0, 0, 1])
    assert len(entered.caps) == 24
    assert entered.contains(np.array([[0, 0, 0.05], [0.02, 0, 0.05], [0, 0, 0.11]])).tolist() == [True, False, False]
    both = SceneMesh.from_arrays("pipe", vertices, faces, "cavity")
    assert len(both.caps) == 48
    # A file's rounding may leave the rim a hair in front of the plane: it is the entry all the same.
    slipped = SceneMesh.from_arrays("pipe", vertices + np.array([0, 0, 2e-5]), faces, "cavity", [0, 0, 0], [0, 0, 1])
    assert len(slipped.caps) == 24
    assert slipped.entry.point[2] == pytest.approx(2e-5)


def test_a_cavity_far_in_front_of_its_entry_is_warned_of(shapes, caplog):
    with caplog.at_level(logging.WARNING):
        SceneMesh.from_arrays("pipe", *shapes.pipe(), "cavity", [0, 0, -0.01], [0, 0, 1])
    assert "no opening lies on or behind the entry plane" in caplog.text


def test_a_normal_out_of_the_cavity_is_warned_of_and_points_are_rounded(shapes, caplog):
    with caplog.at_level(logging.WARNING):
        SceneMesh.from_arrays("pipe", *shapes.pipe(), "cavity", [1e-19, -1e-7, 0], [0, 0, 1])
        assert not caplog.records
        SceneMesh.from_arrays("pipe", *shapes.pipe(), "cavity", [1e-19, -1e-7, 0], [0, 0, -1])
    assert "pipe: the whole cavity lies behind its entry plane at (0, 0, 0) m; the entry's normal must" in caplog.text
    assert format_point(np.array([0.123456, -2.0, 1e-5])) == "(0.12346, -2, 0.00001) m"


def _without(vertices, faces, centre, radius):
    middle = vertices[faces].mean(axis=1)
    return faces[np.linalg.norm(middle - centre, axis=1) > radius]


@pytest.mark.parametrize("radius", [0.0025, 0.008])
def test_a_hole_in_a_cavity_wall_is_refused_with_its_place_and_open_to_an_obstacle(shapes, caplog, radius):
    vertices, faces = shapes.pipe()
    holed = _without(vertices, faces, np.array([-0.016, 0.0, 0.05]), radius)
    assert len(holed) < len(faces)
    with pytest.raises(FormatError, match=r"pipe: hole at \(-0.01\d*, .*, 0.0[45]\d*\) m, .* across: as a cavity"):
        SceneMesh.from_arrays("pipe", vertices, holed, "cavity", [0, 0, 0], [0, 0, 1])
    with caplog.at_level(logging.WARNING):
        mesh = SceneMesh.from_arrays("pipe", vertices, holed, "obstacle")
    assert not mesh.bounded
    assert "only the surface counts" in caplog.text
    assert not mesh.contains(np.array([[0.0, 0.0, 0.05]])).any()


def test_a_ragged_end_is_an_entry_behind_the_plane_and_refused_in_front_of_it(shapes):
    vertices, faces = shapes.pipe()
    ragged = _without(vertices, faces, np.array([0.016, 0.0, 0.0]), 0.012)
    SceneMesh.from_arrays("pipe", vertices, ragged, "cavity", [0, 0, 0.03], [0, 0, 1])
    with pytest.raises(FormatError, match="partly in front of the entry plane"):
        SceneMesh.from_arrays("pipe", vertices, ragged, "cavity", [0, 0, 0.002], [0, 0, 1])
    with pytest.raises(FormatError, match="its rim leaves its plane"):
        SceneMesh.from_arrays("pipe", vertices, ragged, "cavity", [0, 0, -0.1], [0, 0, 1])


def test_a_box_without_a_lid_is_a_cavity_with_a_flat_cap(shapes):
    vertices, faces = shapes.box((0.1, 0.1, 0.1), fine=2)
    open_top = faces[vertices[faces][:, :, 2].min(axis=1) < 0.0499]
    mesh = SceneMesh.from_arrays("tray", vertices, open_top, "cavity")
    assert len(mesh.caps) > 0
    assert mesh.contains(np.array([[0.01, 0.02, 0.049], [0.01, 0.02, 0.051]])).tolist() == [True, False]


def test_only_the_closed_pieces_of_an_obstacle_have_an_inside(shapes, caplog):
    ball, sheet = shapes.sphere(0.05), shapes.sheet(0.3, height=0.1)
    vertices = np.concatenate([ball[0], sheet[0]])
    faces = np.concatenate([ball[1], sheet[1] + len(ball[0])])
    with caplog.at_level(logging.WARNING):
        mesh = SceneMesh.from_arrays("both", vertices, faces, "obstacle")
    assert "that part" in caplog.text
    points = np.array([[0, 0, 0], [0, 0, 0.08], [0, 0, 0.12]], dtype=float)
    assert mesh.contains(points).tolist() == [True, False, False]


def test_an_edge_of_three_faces_leaves_a_cavity_undefined(shapes):
    vertices, faces = shapes.box((1, 1, 1))
    vertices = np.concatenate([vertices, [[2.0, 2.0, 0.0]]])
    finned = np.concatenate([faces, [[faces[0, 0], faces[0, 1], 8]]])
    with pytest.raises(FormatError, match=r"near \(.*\) m: as a cavity: has edges that three or more faces share"):
        SceneMesh.from_arrays("finned", vertices, finned, "cavity")


def test_the_hash_tells_geometry_role_and_entry_apart(shapes):
    ball = shapes.sphere(0.05)
    hashes = {
        mesh.sha256
        for mesh in (
            SceneMesh.from_arrays("ball", *ball, "obstacle"),
            SceneMesh.from_arrays("ball", ball[0] * 1.01, ball[1], "obstacle"),
            SceneMesh.from_arrays("ball", *ball, "cavity"),
            SceneMesh.from_arrays("ball", *ball, "cavity", [0, 0, 0], [0, 0, 1]),
            SceneMesh.from_arrays("ball", *ball, "cavity", [0, 0, 0], [0, 1, 1]),
        )
    }
    assert len(hashes) == 5
    assert SceneMesh.from_arrays("other name", *ball, "obstacle").sha256 in hashes


@pytest.mark.parametrize("far", [0.0, 2.0, 1e4, 5e5, -5e6])
def test_a_plane_through_a_rim_is_its_entry_however_far_from_the_origin(shapes, far):
    vertices, faces = shapes.pipe()
    turn = np.array([[0.92106099, -0.38941834, 0.0], [0.38941834, 0.92106099, 0.0], [0.0, 0.0, 1.0]])
    place = far * np.array([1.0, 0.9, -0.3])
    mesh = SceneMesh.from_arrays("pipe", vertices @ turn.T + place, faces, "cavity", place, [0.0, 0.0, 1.0])
    assert (len(mesh.entrances), len(mesh.caps)) == (1, 32)
    assert mesh.entry.depth(mesh.vertices[mesh.entrances[0].edges]).max() <= 0.0
    # The plane moves by no more than coordinates of that size round to.
    assert np.abs(mesh.entry.point - place).max() <= 1e-12 + 1e-14 * abs(far)


def test_single_precision_far_from_the_origin_is_warned_of(shapes, tmp_path, caplog):
    vertices, faces = shapes.box((0.2, 0.2, 0.2), fine=1)
    with caplog.at_level(logging.WARNING):
        load_scene_mesh(_export(tmp_path / "near.stl", vertices + 100.0, faces), "m", "obstacle")
        load_scene_mesh(_export(tmp_path / "doubles.obj", vertices + 5e5, faces), "m", "obstacle")
        assert not caplog.records
        load_scene_mesh(_export(tmp_path / "far.stl", vertices + 5e5, faces), "m", "obstacle")
    assert "in single precision are multiples of 0.031, its size is" in caplog.text
