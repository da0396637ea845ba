"""Margins by level: each state keeps the least that covers its own bound, an edge the most of its states'."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.margin_levels import FRACTIONS, MarginLevels
from tdcr_planner.planning.validity import ValidityChecker
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

CLEARANCE = 0.0005
LARGEST = 0.02


class GrowingBound(ConstantCurvatureShape):
    """Its bound grows with the tension, from a tenth of a millimetre to 20 mm."""

    bound_follows_state = True

    def __init__(self, robot):
        super().__init__(robot)
        self.error_bound = np.full(robot.disk_count, LARGEST)

    def error_bound_at(self, tensions, gravity, tip_force):
        size = np.clip(tensions.max(axis=1) / self.robot.max_tensions[0], 0.005, 1.0)
        return np.repeat(LARGEST * size[:, None], self.robot.disk_count, axis=1)


class Grown:
    """A scene that remembers by which margins it was grown."""

    def __init__(self, margins=None):
        self.margins = margins

    def with_margins(self, margins):
        return Grown(margins)


@pytest.fixture
def setup(make_setup):
    """A wall beside the robot, and a checker whose margins follow the state."""
    made = make_setup(model=GrowingBound, boxes=[[[0.025, -0.2, 0.0], [0.2, 0.2, 0.3]]])
    box = made.checker.scene
    box.__class__ = type("Box", (type(box),), {"with_margins": lambda self, m: dataclasses.replace(self, margins=m)})
    base = np.full(made.checker.robot.disk_count, CLEARANCE)
    checker = ValidityChecker(made.space, made.model, box, base_margins=base)
    uniform = ValidityChecker(made.space, made.model, box.with_margins(base + LARGEST))
    return checker, uniform


def test_the_least_level_that_covers_is_kept():
    base, bound = np.array([0.0, 0.001]), np.array([0.004, 0.008])
    levels = MarginLevels(Grown(), base, bound)
    each = np.array([[0.0, 0.0], [0.002, 0.004], [0.0021, 0.004], [0.004, 0.008], [0.004, 0.0]])
    found = levels.of(each)
    assert FRACTIONS[found].tolist() == [0.0, 0.5, 0.7, 1.0, 1.0]
    for level, own in zip(found, each, strict=True):
        np.testing.assert_allclose(levels.scene(level).margins, base + levels.bound(level))
        assert (levels.bound(level) >= own).all()
    np.testing.assert_allclose(levels.bound(len(FRACTIONS) - 1), bound)


def test_states_keep_their_own_margin(setup):
    checker, uniform = setup
    # Disks of 10 mm: 15 mm are left beside the straight robot.
    assert checker.check(np.zeros((1, 2)))[0] == 0
    assert uniform.check(np.zeros((1, 2)))[0] != 0
    away = np.array([[-0.4, 0.0], [-3.0, 0.0]])
    assert (checker.check(away) == 0).all() == (
        checker.scene_for(checker.shapes(away)).check(*_poses(checker, away)) == 0
    ).all()
    shapes = checker.shapes(np.array([[0.0, 0.0], [-3.0, 0.0]]))
    assert shapes.levels[0] < shapes.levels[1]


def _poses(checker, rows):
    positions, rotations, _ = checker.world_poses(rows)
    return positions, rotations


def test_verdicts_are_those_of_each_state_alone(setup, random):
    checker, _ = setup
    rows = random.uniform(checker.space.lower, checker.space.upper, (200, 2))
    together = checker.check(rows)
    assert 0 < (together == 0).sum() < len(rows)
    np.testing.assert_array_equal(together, [checker.check(row[None])[0] for row in rows])
    slack = checker.slack(rows, 0.01)
    np.testing.assert_array_equal(slack > 0.0, together == 0)


def test_an_edge_keeps_the_largest_margin_of_its_states(setup):
    checker, uniform = setup
    edges = EdgeChecker(checker, 0.002)
    assert edges.check_edge(np.array([0.0, 0.0]), np.array([-0.3, 0.0]))
    assert not EdgeChecker(uniform, 0.002).check_edge(np.array([0.0, 0.0]), np.array([-0.3, 0.0]))
    # Both ends are free, but with the margin of its far end the near one is not.
    near, far = np.array([0.0, 0.0]), np.array([-3.0, 0.0])
    far_free = checker.check(far[None])[0] == 0
    wide = checker.scene_for(checker.shapes(np.stack([near, far])))
    near_free = wide.check(*_poses(checker, near[None]))[0] == 0
    assert edges.check_edge(near, far) == (far_free and near_free)
    assert not near_free


def test_the_reason_names_the_bound_of_that_state(setup):
    checker, _ = setup
    text = checker.explain(np.array([1.2, 0.0]))
    assert text
