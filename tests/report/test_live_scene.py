from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.report.live_scene import Controls, LiveScene, describe

SCENES = Path(__file__).parents[2] / "scenes"


@pytest.fixture
def scene(make_scenario):
    return LiveScene(PlanningSession(make_scenario("paper")))


def straight(insertion):
    return Controls(np.zeros(3), insertion, 0.0)


def test_a_straight_robot_in_the_pipe_is_free(scene):
    assert scene.models == ("reference", "constant_curvature")
    look = scene.look(straight(-0.05), "constant_curvature")
    assert look.allowed
    # pipe of 14 mm, disks of 10 mm on its axis; the pipe has 48 flat sides
    assert look.clearance == pytest.approx(0.004, abs=14e-3 * (1 - np.cos(np.pi / 48)) + 1e-6)
    head, lines = describe(look)
    assert head == "free"
    assert lines == [f"clearance {1e3 * look.clearance:.2f} mm; the planner keeps 0.50 mm"]


def test_every_touching_part_is_named_and_each_is_near_its_point(scene):
    look = scene.look(Controls(np.array([0.0, 0.0, 2.5]), -0.05, 0.0), "constant_curvature")
    assert not look.allowed
    assert look.clearance < 0.0
    parts = [contact.part for contact in look.contacts]
    assert len(set(parts)) > 2
    assert {contact.mesh for contact in look.contacts} <= {"pipe.stl", "ball.stl"}
    for contact in look.contacts:
        if contact.part.startswith("disk") and contact.triangle >= 0:
            centre = look.positions[int(contact.part.split()[1])]
            assert np.linalg.norm(contact.point - centre) < np.hypot(0.010, 0.001) + 1e-4
    head, lines = describe(look)
    assert head == "touching"
    assert f"{parts[0]}" in lines[0]


def test_too_near_is_told_from_touching(scene):
    # found by halving between straight (free) and bent (touching): near the wall and not on it
    low, high = 0.0, 2.5
    for _ in range(40):
        middle = 0.5 * (low + high)
        look = scene.look(Controls(np.array([0.0, 0.0, middle]), -0.05, 0.0), "constant_curvature")
        if look.contacts:
            high = middle
        elif look.near is not None:
            break
        else:
            low = middle
    assert look.near is not None
    assert 0.0 < look.clearance < look.asked_clearance
    assert not look.allowed
    assert describe(look)[0] == "too near"


def test_what_a_model_cannot_say_is_a_sentence(make_scenario):
    scenario = load_scenario(SCENES / "duct" / "scenario_narrowing.toml")
    scene = LiveScene(PlanningSession(scenario))
    limit = scene.robot.max_tensions
    look = scene.look(Controls(2.0 * limit, 0.0, 0.0), "learned")
    assert not look.has_shape
    head, lines = describe(look)
    assert head == "no shape"
    assert "domain" in lines[0]
    assert f"{limit[0]:g} N" in lines[0]
    # the reference has no domain
    assert scene.look(Controls(2.0 * limit, 0.0, 0.0), "reference").has_shape


def test_roll_turns_the_shape_about_the_base_axis(scene):
    flat = scene.look(Controls(np.array([0.3, 0.0, 0.0]), -0.05, 0.0), "reference")
    turned = scene.look(Controls(np.array([0.3, 0.0, 0.0]), -0.05, np.pi / 2), "reference")
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(turned.positions, flat.positions @ quarter.T, atol=1e-9)


def test_bending_goes_to_tensions_within_the_limits_and_back(scene):
    controls = scene.with_bending(straight(-0.1), np.array([[0.4, -0.3]]))
    np.testing.assert_allclose(scene.bending(controls), [[0.4, -0.3]], atol=1e-12)
    assert controls.insertion == -0.1
    far = scene.with_bending(straight(0.0), np.array([[0.0, 100.0]]))
    assert (far.tensions <= scene.robot.max_tensions).all()
