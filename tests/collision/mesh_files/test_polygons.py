"""Triangulation: areas, shared corners, and polygons that cross themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.collision.mesh_files.polygons import fan_faces, strip_faces, triangulate
from tdcr_planner.errors import FormatError

FILE = Path("polygons.obj")


def _area(points, faces):
    corners = points[faces]
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def _turned(flat, seed):
    """Returns points of a plane, shape (n, 2), somewhere in space."""
    rng = np.random.default_rng(seed)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return np.column_stack([flat, np.zeros(len(flat))]) @ frame.T + rng.normal(size=3)


@settings(max_examples=80, deadline=None)
@given(size=st.integers(3, 24), seed=st.integers(0, 10_000), straight=st.booleans())
def test_a_polygon_about_a_point_is_filled_without_overlap_and_keeps_its_rim(size, seed, straight):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, size)) if size > 8 else 2.0 * np.pi * np.arange(size) / size
    radius = rng.uniform(0.2, 1.0, size)
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    if np.diff(angle, append=angle[0] + 2 * np.pi).max() >= np.pi:
        return  # the centre is outside: the polygon may cross itself
    if straight:  # a corner in the middle of each side
        flat = np.stack([flat, 0.5 * (flat + np.roll(flat, -1, axis=0))], axis=1).reshape(-1, 2)
    points, count = _turned(flat, seed), len(flat)
    faces = triangulate(FILE, points, np.array([count]), np.arange(count))
    assert faces.shape == (count - 2, 3)
    exact = 0.5 * abs(np.sum(flat[:, 0] * np.roll(flat[:, 1], -1) - flat[:, 1] * np.roll(flat[:, 0], -1)))
    assert _area(points, faces).sum() == pytest.approx(exact, rel=1e-9)
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()
    edges = {tuple(edge) for edge in directed}
    assert len(edges) == len(directed)
    # What has no partner in the other direction is the rim, side by side in its own direction.
    assert {edge for edge in edges if edge[::-1] not in edges} == {(k, (k + 1) % count) for k in range(count)}


@pytest.mark.parametrize("size", [5, 40, 400])
def test_a_comb_is_filled_between_its_teeth(size):
    x = np.arange(2 * size) / size
    flat = np.concatenate([np.column_stack([x, np.where(np.arange(2 * size) % 2, 1.0, 0.1)]), [[2.0, 0.0], [0.0, 0.0]]])
    exact = 0.5 * abs(np.sum(flat[:, 0] * np.roll(flat[:, 1], -1) - flat[:, 1] * np.roll(flat[:, 0], -1)))
    points = _turned(flat, size)
    faces = triangulate(FILE, points, np.array([len(flat)]), np.arange(len(flat)))
    assert _area(points, faces).sum() == pytest.approx(exact, rel=1e-9)


def test_polygons_of_many_sizes_keep_their_order():
    angle = 2 * np.pi * np.arange(7) / 7
    points = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    faces = triangulate(FILE, points, np.array([5, 3, 4]), np.array([0, 1, 2, 3, 4, 4, 5, 6, 0, 2, 4, 6]))
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [4, 5, 6], [0, 2, 4], [0, 4, 6]]


@pytest.mark.parametrize("order", [[0, 2, 1, 3], [0, 2, 4, 1, 3]])
def test_a_polygon_that_crosses_itself_is_refused(order):
    angle = 2 * np.pi * np.arange(5) / 5
    points = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    with pytest.raises(FormatError, match="face 1: a polygon of .* corners crosses itself"):
        triangulate(FILE, points, np.array([len(order)]), np.array(order))


def test_a_bow_tie_of_equal_halves_is_refused():
    points = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float64)
    with pytest.raises(FormatError, match="crosses itself"):
        triangulate(FILE, points, np.array([4]), np.arange(4))


def test_a_folded_polygon_is_warned_of(caplog):
    points = np.array([[0, 0, 0], [1, 0, 0.3], [1, 1, 0], [0, 1, 0.3]], dtype=np.float64)
    assert len(triangulate(FILE, points, np.array([4]), np.arange(4))) == 2
    assert "leave their plane by up to" in caplog.text


def test_strips_and_fans_turn_all_their_triangles_alike():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], dtype=np.float64)
    faces = strip_faces(np.arange(6))
    assert (
        np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])[:, 2] > 0
    ).all()
    assert fan_faces(np.array([4, 1, 3, 2])).tolist() == [[4, 1, 3], [4, 3, 2]]
