"""The centreline runs down the middle of a tube to its end, and nowhere where the body does not fit."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.meshes import Entry, SceneMesh
from tdcr_planner.survey.centreline import find_centreline

LENGTH, RADIUS = 0.1, 0.01


@pytest.fixture(scope="module")
def tube() -> SceneMesh:
    """A straight tube along z, open at z = 0."""
    whole = trimesh.creation.cylinder(radius=RADIUS, height=LENGTH, sections=48)
    whole.apply_translation([0.0, 0.0, 0.5 * LENGTH])
    faces = whole.faces[~(whole.triangles_center[:, 2] < 1e-6)]
    return SceneMesh.from_arrays("tube", whole.vertices, faces, "cavity", [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])


def test_the_line_follows_the_axis_to_the_end(tube: SceneMesh) -> None:
    line = find_centreline(tube, Entry(np.zeros(3), np.array([0.0, 0.0, 1.0])), 0.003)
    assert line is not None
    # The grid's spacing is about 0.7 mm; the middle of a straight tube costs least.
    inner = (line.points[:, 2] > 0.01) & (line.points[:, 2] < 0.09)
    assert np.hypot(line.points[inner, 0], line.points[inner, 1]).max() < 2e-3
    assert line.points[-1, 2] == pytest.approx(LENGTH - 0.003, abs=1.5e-3)
    assert np.all(np.diff(line.depths) > 0.0)
    room, _ = line.narrowest()
    assert 0.003 <= room <= RADIUS


def test_a_body_wider_than_the_tube_gets_nowhere(tube: SceneMesh) -> None:
    assert find_centreline(tube, Entry(np.zeros(3), np.array([0.0, 0.0, 1.0])), 0.011) is None
