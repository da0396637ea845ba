import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.report.raster import Camera, corner_normals, lay_over, outline, render_layer, shade, shrink


@pytest.fixture
def camera():
    """A viewer on the z axis looking down, 100 pixels a metre."""
    return Camera(np.eye(3), np.zeros(3), 100.0, 300, 200)


def test_sphere_is_seen_as_its_disk(camera):
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.7)
    layer = render_layer(camera, np.asarray(sphere.vertices), np.asarray(sphere.faces))
    # area of the silhouette: a pixel row about the rim and the chords of the triangles are the error
    assert layer.seen.sum() == pytest.approx(np.pi * 70.0**2, rel=0.01)
    middle = (100 - layer.rows.start, 150 - layer.columns.start)
    assert layer.nearness[middle] == pytest.approx(0.7, rel=1e-3)
    far = render_layer(camera, np.asarray(sphere.vertices), np.asarray(sphere.faces), farthest=True)
    assert far.nearness[middle] == pytest.approx(-0.7, rel=1e-3)
    assert (far.normals[..., 2][far.seen] > 0.0).all()
    rows, columns = np.nonzero(layer.seen)
    x = (columns + layer.columns.start + 0.5 - 150.0) / 100.0
    # the normal of a sphere points along its radius
    np.testing.assert_allclose(layer.normals[rows, columns, 0], x / 0.7, atol=0.03)


def test_nearest_of_two_triangles_wins_in_either_order(camera):
    low = np.array([[-1.0, -0.9, 0.0], [1.0, -0.9, 0.0], [0.0, 0.9, 0.0]])
    high = low + np.array([0.0, 0.0, 0.3])
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    for vertices, expected in ((np.concatenate([low, high]), 1), (np.concatenate([high, low]), 0)):
        layer = render_layer(camera, vertices, faces)
        assert set(np.unique(layer.face)) == {-1, expected}


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1.4, 1.4), min_size=9, max_size=9))
def test_covered_area_is_the_projected_area(values):
    camera = Camera(np.eye(3), np.zeros(3), 100.0, 300, 300)
    corners = np.array(values).reshape(3, 3)
    layer = render_layer(camera, corners, np.array([[0, 1, 2]]))
    sides = corners[1:, :2] - corners[0, :2]
    area = 0.5 * abs(np.linalg.det(sides)) * 100.0**2
    rim = sum(np.linalg.norm(corners[i, :2] - corners[i - 1, :2]) for i in range(3)) * 100.0
    # each pixel centre is in or out: at most about one pixel along the rim is judged differently
    assert abs(int(layer.seen.sum()) - area) <= rim + 4.0


def test_what_is_behind_a_layer_is_peeled_off(camera):
    levels = (0.3, 0.1, -0.2)
    corners = np.array([[-1.0, -0.9], [1.0, -0.9], [0.0, 0.9]])
    vertices = np.concatenate([np.column_stack([corners, np.full(3, level)]) for level in levels])
    faces = np.arange(9).reshape(3, 3)[::-1]
    layer = render_layer(camera, vertices, faces)
    for level in levels[1:]:
        layer = render_layer(camera, vertices, faces, behind=layer)
        assert layer.nearness[layer.seen] == pytest.approx(level)
    assert not render_layer(camera, vertices, faces, behind=layer).seen.any()


def test_what_is_outside_the_image_is_cut_off(camera):
    box = trimesh.creation.box((10.0, 10.0, 0.1))
    layer = render_layer(camera, np.asarray(box.vertices), np.asarray(box.faces))
    assert layer.seen.shape == (200, 300)
    assert layer.seen.all()
    aside = render_layer(camera, box.vertices + np.array([50.0, 0.0, 0.0]), np.asarray(box.faces))
    assert aside.seen.size == 0


def test_corner_normals_are_smooth_on_a_sphere_and_sharp_on_a_box():
    sphere = trimesh.creation.icosphere(subdivisions=4)
    normals = corner_normals(np.asarray(sphere.vertices), np.asarray(sphere.faces))
    np.testing.assert_allclose(normals, sphere.vertices[sphere.faces], atol=0.02)
    box = trimesh.creation.box()
    normals = corner_normals(np.asarray(box.vertices), np.asarray(box.faces))
    np.testing.assert_allclose(normals, np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-12)


def test_lay_over_and_shrink(camera):
    image = np.ones((200, 300, 3), dtype=np.float32)
    square = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
    layer = render_layer(camera, square, np.array([[0, 1, 2], [0, 2, 3]]))
    lay_over(image, layer, np.zeros((*layer.face.shape, 3), dtype=np.float32), np.where(layer.seen, 0.25, 0.0))
    small = shrink(image, 2)
    assert small.shape == (100, 150, 3)
    assert small[50, 75] == pytest.approx(0.75)
    assert small[2, 2] == pytest.approx(1.0)


def test_light_comes_from_above_and_outlines_lie_on_the_rim(camera):
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.7)
    layer = render_layer(camera, np.asarray(sphere.vertices), np.asarray(sphere.faces))
    lit = shade(layer, np.full(3, 0.5)).mean(axis=-1)
    half = len(lit) // 2
    assert lit[:half][layer.seen[:half]].mean() > lit[half:][layer.seen[half:]].mean() + 0.05
    edge = outline(layer, 1.0)
    assert 0 < edge.sum() < 4 * 2 * np.pi * 70
    assert not edge[half - 20 : half + 20, half - 20 : half + 20].any()
