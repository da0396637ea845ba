from __future__ import annotations

import itertools

import numpy as np
import pytest

from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.planning.validity import ValidityChecker, planning_margins

FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@pytest.fixture
def checker_beside_wall(make_setup):
    """Returns a function that makes a checker for the straight robot beside a wall at a distance from its disks, m."""

    def make(distance, clearance=0.0, bound=0.0):
        setup = make_setup(planner={"clearance_m": clearance})
        setup.model.error_bound = np.full(21, bound)
        corners = np.array(list(itertools.product((0.0, 0.02), (-0.5, 0.5), (-0.5, 0.5))))
        corners[:, 0] += setup.scenario.robot.disk_radii[-1] + distance
        faces = np.array([triangle for a, b, c, d in FACES for triangle in ((a, b, c), (a, c, d))])
        mesh = SceneMesh.from_arrays("wall.stl", corners, faces, "obstacle")
        body = RobotBody(setup.scenario.robot, planning_margins(setup.scenario, setup.model))
        return ValidityChecker(setup.space, setup.model, CollisionScene([mesh], body, cells=5000))

    return make


STRAIGHT = np.zeros((1, 2))


def test_a_missing_margin_is_not_called_a_contact(checker_beside_wall):
    told = checker_beside_wall(0.00031, clearance=0.0002, bound=0.0003).explain(STRAIGHT[0])
    assert "is 0.31 mm from wall.stl" in told
    assert "required 0.50 mm = 0.20 clearance + 0.30 model error bound" in told
    assert "touch" not in told
    told = checker_beside_wall(0.00031, clearance=0.0005).explain(STRAIGHT[0])
    assert told.endswith("0.31 mm from wall.stl; required 0.50 mm clearance")


def test_a_contact_of_the_body_is_called_one(checker_beside_wall):
    told = checker_beside_wall(-0.001, clearance=0.0002, bound=0.0003).explain(STRAIGHT[0])
    assert "touches wall.stl" in told
    assert "required" not in told


@pytest.mark.parametrize(("distance", "valid"), [(0.00051, True), (0.00049, False)])
def test_a_state_needs_clearance_and_bound_and_no_more(checker_beside_wall, distance, valid):
    checker = checker_beside_wall(distance, clearance=0.0002, bound=0.0003)
    assert (checker.explain(STRAIGHT[0]) == "") == valid
    slack = checker.slack(STRAIGHT, 0.01)[0]
    assert slack == pytest.approx(distance - 0.0005, abs=2e-6) if valid else slack <= 0.0


def test_slack_of_configurations(checker_beside_wall):
    checker = checker_beside_wall(0.002)
    rows = np.array([[0.0, 0.0], [0.0, 9.0], [np.nan, 0.0]])
    slack = checker.slack(rows, 0.001)
    assert slack[0] == 0.001
    assert (slack[1:] == -np.inf).all()
    # No farther from the wall than the slack says, wherever the robot bends to.
    bent = np.random.default_rng(2).uniform(-0.3, 0.3, (60, 2))
    shapes = checker.shapes(bent)
    clearance = checker.scene.clearance(shapes.positions, shapes.rotations)
    assert (checker.slack(bent, 0.01) <= np.maximum(clearance, 0.0) + 1e-12).all()
