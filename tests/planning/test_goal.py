from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.planning.goal import ConfigurationGoal, TipGoal
from tdcr_planner.shape.base import DiskPoses
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

FREE_BASE = {"insertion_m": [0.0, 0.1], "roll_deg": [-180.0, 180.0]}


def tip_goal(make_setup, goal, robot="paper", boxes=(), base=FREE_BASE, seed=1, planner=None):
    setup = make_setup(robot, base=base, goal=goal, boxes=boxes, planner=planner)
    return setup, TipGoal(setup.checker, setup.scenario.goals[0], seed)


def tip_of(setup, rows):
    positions, rotations, _ = setup.checker.world_poses(np.array(rows))
    return positions[:, -1], rotations[:, -1, :, 2]


@pytest.mark.parametrize("robot", ["paper", "two_segment"])
def test_goal_states_put_the_tip_there_and_are_diverse(make_setup, robot):
    target = np.array([0.05, 0.02, 0.22])
    setup, goal = tip_goal(make_setup, {"tip_position_m": target.tolist(), "tip_tolerance_m": 0.001}, robot)
    goal.search()
    rows = goal.take()
    assert len(rows) > 20
    assert np.linalg.norm(tip_of(setup, rows)[0] - target, axis=1).max() <= 0.001
    scaled = np.array(rows) * setup.checker.motion_scale
    apart = np.linalg.norm(scaled[:, None] - scaled, axis=2) + np.eye(len(rows))
    assert apart.min() > 0.005
    assert np.ptp(np.array(rows)[:, -1]) > np.pi  # rolls of more than half a turn
    assert all(goal.satisfied(row) for row in rows)
    assert not goal.satisfied(np.zeros(setup.space.dimension))
    assert goal.unreachable() == ""
    assert goal.take() == []


def test_goal_states_look_where_they_should(make_setup):
    view = np.array([0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0)
    target = [0.03, 0.0, 0.25]
    asked = {"tip_position_m": target, "view_direction": view.tolist(), "view_tolerance_deg": 4.0}
    setup, goal = tip_goal(make_setup, asked, "two_segment")
    goal.search()
    assert len(goal.rows) > 5
    tips, axes = tip_of(setup, goal.rows)
    assert np.linalg.norm(tips - target, axis=1).max() <= 0.002
    assert np.rad2deg(np.arccos(axes @ view)).max() <= 4.0


def test_the_whole_tolerance_is_used_before_a_goal_counts_as_out_of_reach(make_setup):
    # The straight robot of 200 mm, 100 mm inserted, reaches no higher than 300 mm.
    for beyond, reachable in ((0.0019, True), (0.0022, False)):
        setup, goal = tip_goal(make_setup, {"tip_position_m": [0.0, 0.0, 0.3 + beyond], "tip_tolerance_m": 0.002})
        setup.model.error_bound = np.full(21, 0.0005)
        goal = TipGoal(setup.checker, setup.scenario.goals[0], 1)
        for _ in range(4):
            goal.search()
        assert bool(goal.rows) == reachable
        assert (goal.unreachable() == "") == reachable


def test_goal_states_keep_to_limits_and_out_of_obstacles(make_setup):
    box = [[[-0.2, -0.2, 0.05], [0.2, -0.012, 0.4]]]
    asked = {"tip_position_m": [0.06, 0.0, 0.22], "tip_tolerance_m": 0.002}
    setup, goal = tip_goal(
        make_setup, asked, "two_segment", boxes=box, planner={"step_m": 0.002, "clearance_m": 0.0005}
    )
    goal.search()
    assert goal.reached > len(goal.rows) > 0
    assert setup.checker.valid(np.array(goal.rows)).all()
    assert (np.array(goal.rows) >= setup.space.lower).all()
    assert (np.array(goal.rows) <= setup.space.upper).all()


def test_a_goal_out_of_reach_names_the_nearest_place(make_setup):
    _, goal = tip_goal(make_setup, {"tip_position_m": [0.0, 0.0, 0.5]})
    assert goal.unreachable() == ""
    goal.search()
    # Straight up the tip ends at length plus insertion, 0.3 m (0.2 m of rod and 0.1 m of travel).
    assert "nearest that can be reached" in goal.unreachable()
    np.testing.assert_allclose(goal.nearest[1], [0.0, 0.0, 0.3], atol=1e-3)
    assert goal.unreachable().endswith("with the base at the end of its insertion of 0.1 m")
    assert goal.rows == []


def test_a_direction_out_of_reach_is_told(make_setup):
    _, goal = tip_goal(make_setup, {"tip_position_m": [0.0, 0.0, 0.25], "view_direction": [0.0, 0.0, -1.0]})
    goal.search()
    assert "degrees off" in goal.unreachable()


def test_the_same_seed_gives_the_same_states_and_another_seed_others(make_setup):
    found = []
    for seed in (1, 1, 2):
        _, goal = tip_goal(make_setup, {"tip_position_m": [0.05, 0.02, 0.22]}, seed=seed)
        goal.search()
        goal.search()
        found.append(np.array(goal.rows))
    np.testing.assert_array_equal(found[0], found[1])
    assert found[0].shape != found[2].shape or not np.allclose(found[0], found[2])


def test_rounds_come_ever_more_rarely(make_setup):
    _, goal = tip_goal(make_setup, {"tip_position_m": [0.05, 0.02, 0.22]})
    assert [n for n in range(1, 400) if goal.due(n)] == [32, 64, 128, 256]


def test_a_configuration_is_its_own_only_state(make_setup):
    setup = make_setup(boxes=[[[0.08, -0.1, 0.0], [0.2, 0.1, 0.3]]])
    row = np.array([0.5, 0.0])
    goal = ConfigurationGoal(setup.checker, row)
    assert goal.unreachable() == ""
    np.testing.assert_array_equal(goal.take(), [row])
    assert goal.take() == []
    goal.search()
    assert not goal.due(100)
    assert goal.satisfied(row)
    assert not goal.satisfied(row + 0.1)
    blocked = ConfigurationGoal(setup.checker, np.array([2.5, 0.0]))
    assert "box.stl" in blocked.unreachable()
    assert blocked.take() == []


@pytest.mark.parametrize("view", [False, True])
def test_goals_at_the_limits_of_tension_and_travel_are_reached(make_setup, random, view):
    for _ in range(3):
        setup = make_setup("two_segment", base=FREE_BASE)
        space, robot = setup.space, setup.space.robot
        row = random.uniform(space.lower, space.upper)
        row[-2] = random.choice([space.lower[-2], space.upper[-2]])
        tensions = setup.checker.actuate(row[None]).tensions[0]
        for index in range(robot.segment_count):
            share = tensions / robot.max_tensions
            row[2 * index : 2 * index + 2] /= share[robot.tendon_segments == index].max()
        tips, axes = tip_of(setup, [row])
        asked = {"tip_position_m": tips[0].tolist()}
        if view:
            asked["view_direction"] = axes[0].tolist()
        setup, goal = tip_goal(make_setup, asked, "two_segment")
        while not goal.reached and goal.rounds < 4:
            goal.search()
        assert goal.reached > 0
        assert goal.unreachable() == ""


def test_the_nearest_place_is_nearer_than_any_of_many_samples(make_setup, random):
    target = np.array([0.25, 0.1, 0.1])
    setup, goal = tip_goal(make_setup, {"tip_position_m": target.tolist()}, "two_segment")
    goal.search()
    assert "nearest that can be reached" in goal.unreachable()
    rows = random.uniform(setup.space.lower, setup.space.upper, (50_000, setup.space.dimension))
    rows = rows[(setup.checker.actuate(rows).tensions <= setup.space.robot.max_tensions).all(axis=1)]
    sampled = np.linalg.norm(tip_of(setup, rows)[0] - target, axis=1).min()
    assert 0.002 < np.linalg.norm(goal.nearest[1] - target) <= sampled


class Shapeless(ConstantCurvatureShape):
    """Has no shape for any tensions, as a robot whose stiffness is a million times too small."""

    def disk_poses(self, tensions, *, gravity=None, tip_force=None):
        poses = super().disk_poses(tensions, gravity=gravity, tip_force=tip_force)
        return DiskPoses(poses.positions, poses.rotations, np.zeros(len(tensions), dtype=np.bool_))


def test_a_robot_without_any_shape_is_told_as_that(make_setup):
    asked = {"tip_position_m": [0.05, 0.0, 0.2]}
    setup = make_setup(base=FREE_BASE, goal=asked, model=Shapeless)
    goal = TipGoal(setup.checker, setup.scenario.goals[0], 1)
    goal.search()
    assert goal.unreachable().startswith("no shape was found for any configuration (statics)")
    assert "nan" not in goal.unreachable()
