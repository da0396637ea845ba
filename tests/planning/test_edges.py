from __future__ import annotations

import itertools

import numpy as np
import pytest

from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.planning.causes import Cause
from tdcr_planner.planning.edges import EdgeChecker, _ends_first
from tdcr_planner.planning.validity import ValidityChecker, planning_margins, rejections, sample_within_tensions

MOVING_BASE = {"insertion_m": [0.0, 0.1], "roll_deg": [-180.0, 180.0]}
WALL_M = 1e-4


def random_edges(setup, random, count):
    """Returns ends of random edges, from a few millimetres to the whole range."""
    first = sample_within_tensions(setup.checker, count, random)
    second = sample_within_tensions(setup.checker, count, random)
    return first, first + random.uniform(0.02, 1.0, (count, 1)) * (second - first)


def walls_across_edges(setup, random, count):
    """Yields edges and for each a wall of 0.1 mm by 0.2 mm that a body point passes somewhere on the way."""
    for row_a, row_b in zip(*random_edges(setup, random, count), strict=True):
        at = row_a + random.uniform() * (row_b - row_a)
        positions, rotations, _ = setup.checker.world_poses(at[None])
        points = setup.scene.body_points(positions, rotations)[0].reshape(-1, 3)
        size = np.full(3, 1e-4)
        size[random.integers(3)] = WALL_M / 2.0
        centre = points[random.integers(len(points))]
        yield row_a, row_b, np.array([[centre - size, centre + size]])


@pytest.mark.parametrize("robot", ["paper", "two_segment"])
@pytest.mark.parametrize("step", [0.001, 0.004])
def test_no_thin_wall_across_an_edge_is_missed(make_setup, random, robot, step):
    planner = {"clearance_m": 0.0, "step_m": step}
    setup = make_setup(robot, base=MOVING_BASE, planner=planner)
    setup.scene.rims = True
    for row_a, row_b, wall in walls_across_edges(setup, random, 60):
        setup.scene.boxes = wall
        assert not setup.edges.check_edge(row_a, row_b)


def test_no_thin_wall_of_triangles_across_an_edge_is_missed(make_setup, random):
    setup = make_setup("two_segment", base=MOVING_BASE, planner={"clearance_m": 0.0, "step_m": 0.004})
    body = RobotBody(setup.scenario.robot, planning_margins(setup.scenario, setup.model))
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    # The corners of a box in this order have these faces, two triangles each.
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    for row_a, row_b in zip(*random_edges(setup, random, 25), strict=True):
        at = row_a + random.uniform(0.02, 0.98) * (row_b - row_a)
        points = setup.scene.body_points(*setup.checker.world_poses(at[None])[:2]).reshape(-1, 3)
        size = np.full(3, 3e-4)
        size[random.integers(3)] = WALL_M
        wall = SceneMesh.from_arrays("wall", points[random.integers(len(points))] + size * corners, faces, "obstacle")
        checker = ValidityChecker(setup.space, setup.model, CollisionScene([wall], body, cells=1000))
        assert not EdgeChecker(checker, 0.004).check_edge(row_a, row_b)
        # Without the wall nothing but the robot itself can be in the way, so it is the wall that is found.
        assert rejections(checker.rejected) == {"obstacle": checker.rejected[Cause.OBSTACLE]}


def test_the_walls_are_thin_enough_to_be_missed_by_the_states_alone(make_setup, random, monkeypatch):
    setup = make_setup(base=MOVING_BASE, planner={"clearance_m": 0.0, "step_m": 0.004})
    setup.scene.rims = True
    monkeypatch.setattr(type(setup.scene), "open_intervals", lambda *asked: tuple(np.zeros((2, len(asked[3]) - 1))))
    missed = 0
    for row_a, row_b, wall in walls_across_edges(setup, random, 60):
        setup.scene.boxes = wall
        missed += setup.edges.check_edge(row_a, row_b)
    assert missed > 20


@pytest.mark.parametrize("robot", ["paper", "two_segment"])
def test_between_two_states_every_point_is_within_half_a_step_of_one_of_them(make_setup, random, robot):
    setup = make_setup(robot, base=MOVING_BASE, planner={"step_m": 0.003})
    share = np.linspace(0.0, 1.0, 21)[:, None]
    for row_a, row_b in zip(*random_edges(setup, random, 5), strict=True):
        rows = setup.edges.subdivide(row_a, row_b)
        np.testing.assert_array_equal(rows[[0, -1]], [row_a, row_b])
        for first, second in itertools.pairwise(rows):
            positions, rotations, _ = setup.checker.world_poses(first + share * (second - first))
            points = setup.scene.body_points(positions, rotations)
            from_first = np.linalg.norm(points - points[0], axis=-1).max(axis=(1, 2))
            from_second = np.linalg.norm(points - points[-1], axis=-1).max(axis=(1, 2))
            # 1e-9 m: rounding of positions of some 0.1 m, with room to spare.
            assert np.minimum(from_first, from_second).max() <= 0.0015 + 1e-9
            assert from_first[-1] <= 0.003 + 1e-9


def test_the_number_of_states_follows_the_motion(make_setup):
    setup = make_setup(base={"insertion_m": [0.0, 0.1]}, planner={"step_m": 0.002})
    rows = setup.edges.subdivide(np.zeros(3), np.array([0.0, 0.0, 0.1]))
    # A straight insertion of 100 mm in steps of 2 mm needs 50 intervals; the refinement may add some of its own.
    assert 51 <= len(rows) <= 60
    assert len(setup.edges.subdivide(np.zeros(3), np.array([0.0, 0.0, 0.1]), 0.0002)) >= 501


def test_an_edge_is_judged_the_same_in_both_directions(make_setup, random):
    box = [[[0.05, -0.02, 0.12], [0.07, 0.02, 0.16]]]
    setup = make_setup(base=MOVING_BASE, boxes=box)
    verdicts = []
    for row_a, row_b in zip(*random_edges(setup, random, 40), strict=True):
        there = EdgeChecker(setup.checker, 0.002).check_edge(row_a, row_b)
        back = EdgeChecker(setup.checker, 0.002).check_edge(row_b, row_a)
        verdicts.append(there)
        assert there == back
    assert 4 < sum(verdicts) < 36


def test_the_end_is_asked_first_and_only_once(make_setup):
    box = [[[0.08, -0.1, 0.0], [0.2, 0.1, 0.3]]]
    setup = make_setup(boxes=box)
    assert not setup.edges.check_edge(np.zeros(2), np.array([2.5, 0.0]))
    assert setup.scene.asked == 1
    setup.scene.boxes = np.zeros((0, 2, 3))
    assert setup.edges.check_edge(np.zeros(2), np.array([0.5, 0.0]))
    first = setup.scene.asked - 1
    # Back by another way, so that the ends are all that is known.
    assert setup.edges.check_edge(np.array([0.5, 0.0]), np.array([0.0, 1e-6]))
    assert setup.scene.asked - 1 - first < first
    assert setup.edges.edges_checked == 3
    assert setup.edges.edges_rejected == 1


def test_a_part_of_a_valid_edge_is_not_asked_about_again_but_a_part_of_another_is(make_setup):
    setup = make_setup(boxes=[[[0.08, -0.1, 0.0], [0.2, 0.1, 0.3]]])
    start, end, bent = np.zeros(2), np.array([0.5, 0.0]), np.array([2.5, 0.0])
    assert setup.edges.check_edge(start, end)
    asked, states = setup.scene.asked, setup.checker.states_checked
    assert setup.edges.check_edge(start, 0.25 * end)
    assert setup.edges.check_edge(0.75 * end, end)
    assert setup.edges.check_edge(end, start)
    assert (setup.scene.asked, setup.checker.states_checked) == (asked, states)
    assert not setup.edges.check_edge(start, bent)
    assert not setup.edges.check_edge(end, bent)
    assert setup.scene.asked > asked


def test_an_edge_that_stays_put_is_a_state(make_setup):
    setup = make_setup(boxes=[[[0.08, -0.1, 0.0], [0.2, 0.1, 0.3]]])
    bent = np.array([2.5, 0.0])
    assert setup.edges.check_edge(np.zeros(2), np.zeros(2))
    assert not setup.edges.check_edge(bent, bent)
    assert setup.edges.path_valid(np.zeros((1, 2)))
    assert not setup.edges.path_valid(np.array([[0.0, 0.0], bent]))


def test_an_edge_out_of_the_tension_limits_never_reaches_the_scene(make_setup):
    setup = make_setup()
    assert not setup.edges.check_edge(np.zeros(2), np.array([9.0, 0.0]))
    assert setup.scene.asked == 0


@pytest.mark.parametrize("intervals", [2, 3, 8, 21])
@pytest.mark.parametrize("start_first", [True, False])
def test_the_first_states_of_an_edge_are_its_ends_and_then_middles(intervals, start_first):
    along, order = _ends_first(intervals, start_first)
    assert along[:2].tolist() == ([0.0, 1.0] if start_first else [1.0, 0.0])
    np.testing.assert_array_equal(along[order], np.linspace(0.0, 1.0, intervals + 1))
    # Halving the widest gaps, as near as whole numbers go, makes all of them at most a power of two of intervals wide.
    places = np.rint(along * intervals)
    for count in range(3, len(along) + 1):
        widest = np.diff(np.sort(places[:count])).max()
        assert widest <= 2.0 ** np.ceil(np.log2(intervals) - np.floor(np.log2(count - 1)))


def test_an_edge_to_a_configuration_that_is_not_finite_is_rejected_as_such(make_setup):
    setup = make_setup(base=MOVING_BASE)
    for column in range(4):
        broken = np.zeros(4)
        broken[column] = np.nan
        assert not setup.edges.check_edge(np.zeros(4), broken)
        assert not setup.edges.check_edge(broken, np.zeros(4))
        assert not setup.edges.state_valid(broken)
    assert set(rejections(setup.checker.rejected)) == {"nan"}
    assert setup.scene.asked == 0


def test_a_dense_path_keeps_its_waypoints(make_setup):
    setup = make_setup()
    waypoints = np.array([[0.0, 0.0], [1.0, 0.5], [0.2, -0.6]])
    dense = setup.edges.densify(waypoints)
    assert all((dense == row).all(axis=1).any() for row in waypoints)
    assert len(np.unique(dense, axis=0)) == len(dense)
