"""A cut leaves what lies in front of the plane, with a straight rim."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.collision.volumes.cut import cut_surface
from tdcr_planner.errors import FormatError

BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.01)
HERE = Path("ball.nii")


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_cut_ball_has_the_area_of_its_front_and_one_flat_rim(seed: int) -> None:
    rng = np.random.default_rng(seed)
    normal, point = rng.standard_normal(3), rng.uniform(-0.004, 0.004, 3)
    vertices, faces = cut_surface(HERE, BALL.vertices, BALL.faces, point, normal)
    found = trimesh.Trimesh(vertices, faces, process=False)
    sliced = trimesh.intersections.slice_faces_plane(BALL.vertices, BALL.faces, normal, point)
    expected = trimesh.Trimesh(sliced[0], sliced[1], process=False)
    assert found.area == pytest.approx(expected.area, rel=1e-9)
    border = found.edges[trimesh.grouping.group_rows(found.edges_sorted, require_count=1)]
    depths = (found.vertices[np.unique(border)] - point) @ (normal / np.linalg.norm(normal))
    assert np.abs(depths).max() < 1e-12
    assert len(np.unique(border)) == len(border)  # each rim vertex has two rim edges: one closed loop, no crack


def test_a_plane_through_vertices_leaves_no_slivers() -> None:
    vertices, faces = cut_surface(HERE, BALL.vertices, BALL.faces, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    assert trimesh.Trimesh(vertices, faces, process=False).area_faces.min() > 1e-9


def test_a_plane_that_leaves_nothing_is_refused() -> None:
    with pytest.raises(FormatError, match="the whole surface lies behind the plane"):
        cut_surface(HERE, BALL.vertices, BALL.faces, np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.0, 1.0]))
