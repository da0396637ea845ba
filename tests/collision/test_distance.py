"""Exact distances against closed forms and against FCL and dense points on the solid."""

from __future__ import annotations

import itertools

import fcl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from tdcr_planner.collision.body import PARALLEL
from tdcr_planner.collision.distance import point_cylinder_distance, solid_distance, triangle_distance
from tdcr_planner.collision.tree import build_tree, nearest_distances, winding_numbers
from tdcr_planner.se3 import rotation_from_vector

AXIS = np.array([0.0, 0.0, 1.0])
ORIGIN = np.zeros(3)


def _fcl_distance(round_ends, triangle, centre, rotation, half, radius):
    shape = fcl.Capsule(radius, 2 * half) if round_ends else fcl.Cylinder(radius, 2 * half)
    model = fcl.BVHModel()
    model.beginModel(1, 3)
    model.addSubModel(triangle, np.array([[0, 1, 2]]))
    model.endModel()
    solid = fcl.CollisionObject(shape, fcl.Transform(rotation, centre))
    face = fcl.CollisionObject(model)
    return fcl.distance(solid, face), fcl.collide(solid, face) > 0


def _least_distance(round_ends, triangle, centre, axis, half, radius):
    """Minimises the distance of a point of the triangle from the solid, a convex function of its two coordinates."""

    def distance(weights):
        point = triangle[0] + weights[0] * (triangle[1] - triangle[0]) + weights[1] * (triangle[2] - triangle[0])
        along = (point - centre) @ axis
        beyond, aside = max(abs(along) - half, 0.0), np.linalg.norm(point - centre - along * axis)
        if round_ends:
            return max(np.hypot(beyond, aside) - radius, 0.0)
        return np.hypot(beyond, max(aside - radius, 0.0))

    inside = {"type": "ineq", "fun": lambda weights: 1.0 - weights[0] - weights[1]}
    starts = ([0.33, 0.33], [0.9, 0.05], [0.05, 0.9], [0.02, 0.02])
    options = {"ftol": 1e-14, "maxiter": 300}
    return min(
        minimize(distance, start, method="SLSQP", bounds=[(0, 1)] * 2, constraints=[inside], options=options).fun
        for start in starts
    )


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), round_ends=st.booleans(), size=st.sampled_from([0.02, 0.3, 2.0]),
    half=st.floats(0.01, 1.0), radius=st.floats(0.01, 1.0),
)  # fmt: skip
def test_a_triangle_is_as_far_as_minimisation_and_fcl_say(seed, round_ends, size, half, radius):
    rng = np.random.default_rng(seed)
    triangle = rng.normal(size=(3, 3)) * size + rng.normal(size=3)
    centre, rotation = rng.normal(size=3), rotation_from_vector(rng.normal(size=(1, 3)) * 2)[0]
    axis = np.ascontiguousarray(rotation[:, 2])
    ours = triangle_distance(triangle, round_ends, centre, axis, half, radius)
    theirs, touching = _fcl_distance(round_ends, triangle, centre, rotation, half, radius)
    if touching:
        # FCL calls touching what its solver cannot separate; libccd works to 1e-6 of the size.
        assert ours <= 1e-5
    else:
        # FCL comes to the distance from above and may stop early, by up to 1e-3 where a triangle is small; the
        # minimisation ends within its own tolerance above the minimum.
        assert ours <= theirs + 1e-9
        least = _least_distance(round_ends, triangle, centre, axis, half, radius)
        assert least - 1e-5 <= ours <= least + 1e-9


@pytest.mark.parametrize("turn", range(4))
def test_a_cylinder_over_a_large_face(turn):
    # Closed form: over a plane the lowest point of a cylinder that leans by a is half cos a + radius sin a below it.
    lean = [0.0, 0.3, 1.2, np.pi / 2][turn]
    axis = np.array([np.sin(lean), 0.0, np.cos(lean)])
    floor = np.array([[-50.0, -40.0, 0.0], [60.0, -40.0, 0.0], [0.0, 70.0, 0.0]])
    lowest = 0.2 * np.cos(lean) + 0.7 * np.sin(lean)
    distance = triangle_distance(floor, False, np.array([0.3, 0.1, 3.0]), axis, 0.2, 0.7)
    assert distance == pytest.approx(3.0 - lowest, abs=1e-12)
    assert triangle_distance(floor, False, np.array([0.3, 0.1, lowest - 1e-9]), axis, 0.2, 0.7) == 0.0
    assert triangle_distance(floor, False, np.array([0.3, 0.1, lowest + 1e-9]), axis, 0.2, 0.7) > 0.0


@pytest.mark.parametrize("lean", [0.0, 1e-12, 1e-9, 3e-9, 1e-8, 1.5e-8, 2e-8, 2.5e-8, 3e-8, 1e-7])
def test_a_cylinder_all_but_square_to_a_face_is_as_far_as_its_face(lean):
    # The face's incircle is 1.2 times as wide as the cylinder: no point of the cylinder lies above an edge.
    corners = 2.0 * 1.2 * 0.7 * np.array([[np.cos(a), np.sin(a), 0.0] for a in 2.0 * np.pi * np.arange(3) / 3.0])
    for turn, ulps in itertools.product(np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), (-1, 0, 1)):
        # An axis from a product of rotations is a unit vector up to rounding.
        length = 1.0 + ulps * np.finfo(float).eps
        axis = length * np.array([lean * np.cos(turn), lean * np.sin(turn), np.sqrt(1.0 - lean**2)])
        distance = triangle_distance(corners, False, np.array([0.0, 0.0, 3.0]), axis, 0.2, 0.7)
        # The lowest point of the rim is 0.7 lean below the face; rounding of 1 - along axis, 4 units in the last
        # place, counts over the lean.
        assert distance == pytest.approx(2.8, abs=0.7 * lean + 0.7 * 9e-16 / max(lean, PARALLEL) + 1e-12)


def test_a_triangle_inside_the_solid_and_a_solid_through_the_triangle_meet():
    small = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0]])
    large = np.array([[-50.0, -40.0, 0.3], [60.0, -40.0, 0.3], [0.0, 70.0, 0.3]])
    for round_ends in (False, True):
        assert triangle_distance(small, round_ends, ORIGIN, AXIS, 0.5, 0.1) == 0.0
        assert triangle_distance(large, round_ends, ORIGIN, AXIS, 0.5, 0.1) == 0.0
        assert triangle_distance(large + np.array([100.0, 0.0, 0.0]), round_ends, ORIGIN, AXIS, 0.5, 0.1) > 1.0


def test_a_degenerate_triangle_is_its_edges():
    line = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    assert triangle_distance(line, False, ORIGIN, AXIS, 0.5, 0.1) == pytest.approx(0.9, abs=1e-12)
    assert triangle_distance(line, True, ORIGIN, AXIS, 0.5, 0.1) == pytest.approx(0.9, abs=1e-12)
    assert triangle_distance(np.ones((3, 3)), True, ORIGIN, AXIS, 0.5, 0.1) == pytest.approx(1.5 - 0.1, abs=1e-12)


def test_a_solid_in_a_sphere_and_in_a_tube_has_the_distance_of_the_closed_form(shapes):
    vertices, faces = shapes.sphere(1.0, subdivisions=5)
    tree = build_tree(vertices, faces)
    # The facets of 20480 triangles lie up to 3e-4 inside the sphere.
    for round_ends, expected in ((True, 1.0 - 0.3 - 0.1), (False, 1.0 - np.hypot(0.3, 0.1))):
        value = solid_distance(tree, round_ends, ORIGIN, AXIS, 0.3, 0.1, np.inf)
        assert expected - 4e-4 <= value <= expected
    wall, panels = shapes.pipe(radius=0.05, straight=0.4, angle=0.01, around=256, along=20)
    tube = build_tree(wall, panels)
    sagitta = 0.05 * (1.0 - np.cos(np.pi / 256))
    for round_ends in (True, False):
        value = solid_distance(tube, round_ends, np.array([0.01, 0.0, 0.2]), AXIS, 0.1, 0.02, np.inf)
        assert 0.02 - sagitta - 1e-12 <= value <= 0.02 + 1e-12


def test_the_bound_cuts_the_search_and_never_the_answer(shapes):
    tree = build_tree(*shapes.sphere(1.0))
    rng = np.random.default_rng(8)
    for _ in range(200):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        centre, half, radius = rng.normal(size=3) * 0.8, rng.uniform(0.01, 0.5), rng.uniform(0.01, 0.3)
        for round_ends in (True, False):
            exact = min(triangle_distance(t, round_ends, centre, axis, half, radius) for t in tree.corners)
            assert solid_distance(tree, round_ends, centre, axis, half, radius, np.inf) == exact
            assert solid_distance(tree, round_ends, centre, axis, half, radius, 0.1) == min(exact, 0.1)


def test_a_point_is_as_far_from_a_cylinder_as_its_rim_or_face(shapes):
    for point, expected in (((0, 0, 0.9), 0.4), ((0.5, 0, 0.1), 0.3), ((0.5, 0, 0.9), 0.5), ((0.1, 0, 0), 0.0)):
        assert point_cylinder_distance(*point, ORIGIN, AXIS, 0.5, 0.2) == pytest.approx(expected, abs=1e-12)


def test_points_have_the_distance_and_winding_number_of_a_sphere(shapes):
    vertices, faces = shapes.sphere(1.0, subdivisions=4)
    tree = build_tree(vertices, faces)
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (3000, 3))
    away = np.linalg.norm(points, axis=1) - 1.0
    distance, triangle = nearest_distances(tree, points)
    # The facets of 5120 triangles lie up to 1.2e-3 inside the sphere.
    np.testing.assert_allclose(distance, np.abs(away), atol=1.3e-3)
    assert triangle.min() >= 0
    assert triangle.max() < len(faces)
    clear = np.abs(away) > 1.3e-3
    np.testing.assert_array_equal(winding_numbers(tree, points)[clear], (away < 0).astype(float)[clear])
    inverted = build_tree(vertices, faces[:, ::-1])
    np.testing.assert_array_equal(winding_numbers(inverted, points)[clear], -(away < 0).astype(float)[clear])
