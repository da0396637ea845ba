"""Pieces and holes of meshes: cleaning, rims, orientation, and time that grows with size alone."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.topology import MERGE_LIMIT, _near_pairs, analyse, clean_mesh

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64)
OUTWARD = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def _scattered(count, corners=TETRAHEDRON, faces=OUTWARD, size=4e-4):
    at = np.random.default_rng(1).uniform([0.0, 0.1, -0.1], [0.3, 0.3, 0.1], (count, 3))
    vertices = (at[:, None] + size * corners).reshape(-1, 3)
    return vertices, (faces + len(corners) * np.arange(count)[:, None, None]).reshape(-1, 3)


def test_a_far_crumb_or_a_stray_vertex_does_not_make_a_fine_mesh_collapse():
    far = np.concatenate([1e-4 * TETRAHEDRON, TETRAHEDRON + 1e5])
    vertices, faces = clean_mesh(far, np.concatenate([OUTWARD, OUTWARD + 4]))
    assert (len(vertices), len(faces)) == (8, 8)
    vertices, faces = clean_mesh(np.concatenate([1e-4 * TETRAHEDRON, [[1e9, 0, 0]]]), OUTWARD)
    assert (len(vertices), len(faces)) == (4, 4)
    assert clean_mesh(np.concatenate([TETRAHEDRON, TETRAHEDRON + 0.1 * MERGE_LIMIT]), OUTWARD + 4)[1].shape == (4, 3)


def test_each_rim_is_described_as_if_it_were_alone(shapes):
    rng = np.random.default_rng(3)
    tubes = [
        shapes.pipe(radius=0.01 * (k + 1), straight=0.1, angle=0.3 + 0.1 * k, around=8 + k, along=5) for k in range(4)
    ]
    alone = [analyse(*tube).loops for tube in tubes]
    moved = [(points + 10.0 * k, faces) for k, (points, faces) in enumerate(tubes)]
    starts = np.cumsum([0, *(len(points) for points, _ in moved)])
    faces = np.concatenate([triangles + start for (_, triangles), start in zip(moved, starts, strict=False)])
    shuffled = faces[rng.permutation(len(faces))]
    together = analyse(np.concatenate([points for points, _ in moved]), shuffled).loops
    assert len(together) == 8
    for loop in together:
        tube = int(np.searchsorted(starts, loop.edges.min(), side="right")) - 1
        same = min(alone[tube], key=lambda other: np.linalg.norm(other.centre + 10.0 * tube - loop.centre))
        # Coordinates of 40 m round at 7e-15 m.
        np.testing.assert_allclose(loop.centre - 10.0 * tube, same.centre, atol=1e-13)
        assert abs(abs(loop.normal @ same.normal) - 1.0) < 1e-9
        for name in ("diameter", "flatness", "steepness"):
            assert getattr(loop, name) == pytest.approx(getattr(same, name), rel=1e-9, abs=1e-12)
        rim = {tuple(edge) for edge in (loop.edges - starts[tube]).tolist()}
        assert rim == {tuple(edge) for edge in same.edges.tolist()}


def test_shells_in_shells_keep_their_turn_and_the_outermost_points_outward():
    sizes = [8.0, 4.0, 2.0, 1.0]
    inward = [False, True, False, True]
    for flip_all in (False, True):
        parts = [s * (TETRAHEDRON - 0.2) for s in sizes]
        faces = [(OUTWARD[:, ::-1] if turned != flip_all else OUTWARD) + 4 * k for k, turned in enumerate(inward)]
        mesh = SceneMesh.from_arrays("shells", np.concatenate(parts), np.concatenate(faces), "obstacle")
        # Between the shells the body is inside of an even or an odd number of them.
        points = np.array([[0.1 * size] * 3 for size in sizes])
        assert mesh.contains(points).tolist() == [True, False, True, False]


@pytest.mark.parametrize("faces", [OUTWARD[:, ::-1], OUTWARD[:1]], ids=["closed", "loose"])
def test_the_time_for_many_pieces_grows_in_proportion(faces):
    def seconds(count):
        vertices, triangles = _scattered(count, faces=faces)
        start = time.process_time()
        SceneMesh.from_arrays("crumbs", vertices, triangles, "obstacle")
        return time.process_time() - start

    seconds(100)  # compiles
    # Twelve times the pieces; quadratic work would take 144 times as long.
    assert seconds(12_000) < 40.0 * max(seconds(1_000), 0.02)


def test_near_vertices_are_those_of_a_tree_of_points():
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.1, 0.1, (2000, 3))
    distance = 1e-6
    # twins within the distance and just beyond it, and in one case three points in a row
    shift = rng.normal(size=(60, 3))
    shift *= np.linspace(0.5, 1.5, 60)[:, None] * distance / np.linalg.norm(shift, axis=1, keepdims=True)
    for extra in (points[:60] + shift, np.concatenate([points[:60] + shift, points[:1] - shift[:1]])):
        cloud = np.concatenate([points, extra])
        expected = cKDTree(cloud).query_pairs(distance)
        assert len(expected) >= 30
        assert {tuple(sorted(pair)) for pair in _near_pairs(cloud, distance).tolist()} == expected
