"""Cavities that the body cannot get into, told from those that it can."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.entrance import missed_by, obstruction
from tdcr_planner.collision.meshes import SceneMesh

ENTRY = ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
OUTSIDE = np.array([0.0, 0.0, -0.1])
X, Z = np.eye(3)[[0, 2]]


def _cylinder(radius, height):
    mesh = trimesh.creation.cylinder(radius, height, sections=24)
    mesh.apply_translation([0.0, 0.0, 0.5 * height])
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _wall(inner, outer, height):
    mesh = trimesh.creation.annulus(inner, outer, height, sections=24)
    mesh.apply_translation([0.0, 0.0, 0.5 * height])
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _cup(inner, outer, height):
    """A glass: closed, without a handle, with a wall of its own thickness."""
    angle = 2 * np.pi * np.arange(24) / 24
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    levels = [(outer, height), (outer, 0.0), (inner, outer - inner), (inner, height)]
    rings = [np.column_stack([r * ring, np.full(24, z)]) for r, z in (levels[1], levels[0], levels[3], levels[2])]
    vertices = np.concatenate([*rings, [[0, 0, 0.0], [0, 0, outer - inner]]])
    faces = []
    for k in range(24):
        n = (k + 1) % 24
        for level in range(3):
            a, b = 24 * level + k, 24 * level + n
            faces += [[a, b, b + 24], [a, b + 24, a + 24]]
        faces += [[k, n, 96], [72 + k, 72 + n, 97]]
    return vertices, np.array(faces)


@pytest.mark.parametrize("entry", [ENTRY, ([0.0, 0.0, 0.05], [0.0, 0.0, 1.0])])
def test_a_closed_cavity_cannot_be_entered_from_outside(entry):
    mesh = SceneMesh.from_arrays("vessel", *_cylinder(0.012, 0.2), "cavity", *entry)
    assert "is closed and the base, at (0, 0, -0.1) m, is outside" in obstruction(mesh, OUTSIDE, 0.0025)
    assert "cut it open where the body enters" in obstruction(mesh, OUTSIDE, 0.0025)
    assert obstruction(mesh, np.array([0.0, 0.0, 0.1]), 0.0025) is None


@pytest.mark.parametrize(
    ("made", "radius"),
    [(_wall(0.012, 0.014, 0.2), 0.0025), (_wall(0.02, 0.03, 0.2), 0.001), (_cup(0.012, 0.014, 0.2), 0.0025)],
)
def test_a_wall_with_its_thickness_is_told_from_a_vessel(made, radius):
    mesh = SceneMesh.from_arrays("wall", *made, "cavity", *ENTRY)
    message = obstruction(mesh, OUTSIDE, radius)
    assert "it seems to be a wall with its thickness (on average 0.0" in message
    assert "use it as an 'obstacle'" in message


def test_an_opening_in_front_of_the_entry_plane_is_named_as_the_cause(shapes):
    mesh = SceneMesh.from_arrays("pipe", *shapes.pipe(), "cavity", [0, 0, -0.01], [0, 0, 1])
    assert "no opening lies on or behind its entry plane" in obstruction(mesh, OUTSIDE, 0.0025)


def test_obstacles_and_cavities_with_an_entrance_are_not_spoken_against(shapes):
    pipe = shapes.pipe()
    assert obstruction(SceneMesh.from_arrays("pipe", *pipe, "cavity", *ENTRY), OUTSIDE, 0.0025) is None
    assert obstruction(SceneMesh.from_arrays("ball", *shapes.sphere(0.1), "obstacle"), OUTSIDE, 0.0025) is None
    assert obstruction(SceneMesh.from_arrays("ball", *shapes.sphere(0.1), "cavity"), OUTSIDE, 0.0025) is None


def test_a_base_beside_the_opening_is_told_with_the_distance_that_it_misses(shapes):
    mesh = SceneMesh.from_arrays("pipe", *shapes.pipe(radius=0.016), "cavity", *ENTRY)
    assert missed_by(mesh, OUTSIDE, Z) is None
    assert missed_by(mesh, OUTSIDE + 0.015 * X, Z) is None
    message = missed_by(mesh, OUTSIDE + 0.046 * X, Z)
    # A rim of 32 straight sides has a corner at (0.016, 0, 0).
    assert (
        "meets the entry plane at (0.046, 0, 0) m, 0.03 m beside the opening at (0, 0, 0) m, 0.032 m across" in message
    )
    tilted = np.array([np.sin(0.4), 0.0, np.cos(0.4)])
    assert f"{0.1 * np.tan(0.4) - 0.016:.3g} m beside" in missed_by(mesh, OUTSIDE, tilted)
    assert "does not point into the cavity (it makes 180 degrees" in missed_by(mesh, OUTSIDE, -Z)
    assert missed_by(mesh, np.array([0.0, 0.0, 0.05]), -Z) is None
