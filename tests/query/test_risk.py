from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta, norm

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.drawn_robot import draw_robot
from tdcr_planner.query.paths import path_rows
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.risk import robots_needed
from tdcr_planner.query.session import PlanningSession, plan
from tdcr_planner.query.tolerances import Tolerances, tolerances_of
from tdcr_planner.report.results import read_result, write_result

REFERENCE = {"validity": "reference", "clearance_m": 0.0005, "step_m": 0.002, "time_limit_s": 60.0}
BESIDE = {"insertion_m": [0.0, 0.02]}


def only(**values: float) -> Tolerances:
    return Tolerances(**{**dict.fromkeys(dict(Tolerances().items()), 0.0), **values})


@pytest.mark.parametrize(("asked", "failures", "confidence"), [(0.95, 2, 0.95), (0.9, 0, 0.99), (0.99, 8, 0.98)])
def test_the_number_of_robots_is_the_least_whose_interval_reaches(
    asked: float, failures: int, confidence: float
) -> None:
    robots = robots_needed(asked, failures, confidence)
    tail = 0.5 * (1.0 - confidence)
    low = [beta.ppf(tail, count - failures, failures + 1) for count in (robots - 1, robots)]
    assert low[0] < asked <= low[1]


def test_a_path_far_from_everything_holds_and_is_written(make_scenario: Callable[..., Scenario], tmp_path: Any) -> None:
    planner = {"validity": "constant_curvature", "success_probability": 0.6, "time_limit_s": 60.0}
    found = plan(make_scenario(planner=planner, tolerances={"youngs_modulus": 0.02}))
    assert found.status is PlanStatus.VERIFIED
    assert found.holds
    assert found.risk is not None
    assert found.risk["reached"]
    assert found.risk["verified"]["low"] >= 0.6
    assert found.risk["verified"]["count"] == found.risk["verified"]["total"]
    assert found.risk["tolerances"]["mass"] == 0.0
    write_result(found, tmp_path / "out")
    again = read_result(tmp_path / "out")
    assert again.risk == found.risk
    assert again.holds


def test_what_cannot_be_had_is_said_with_the_tolerance_in_the_way(make_scenario: Callable[..., Scenario]) -> None:
    planner = {**REFERENCE, "success_probability": 0.95, "clearance_m": 0.2}
    goal = {"bending_n": [[0.5, 0.0]]}
    tolerances = {"mesh_position_m": 0.1, "youngs_modulus": 0.001}
    found = plan(make_scenario(planner=planner, goal=goal, tolerances=tolerances))
    assert found.status is PlanStatus.VERIFIED
    assert not found.holds
    assert found.risk is not None
    assert found.risk["verified"]["low"] < 0.95
    assert found.risk["limiting_tolerance"] == "mesh_position_m"
    assert "stands in the way" in found.message


def test_a_verdict_without_measuring_is_the_same(make_scenario: Callable[..., Scenario]) -> None:
    scenario = make_scenario(base={"position_m": [0.2265, 0.0, -0.17]}, planner=REFERENCE)
    session = PlanningSession(scenario)
    rows = np.linspace([0.0, 0.0], [0.0, 0.5], 12)
    outcomes = set()
    for number in range(12):
        drawn = draw_robot(session, only(base_position_m=0.02), (number,))
        measured, quick = (drawn.verifier(session, scenario, measure=m).verify(rows)[0] for m in (True, False))
        assert measured.cause == quick.cause
        outcomes.add(measured.cause)
    assert outcomes == {"", "clearance"}


def test_moved_surfaces_are_a_base_moved_the_other_way(make_scenario: Callable[..., Scenario]) -> None:
    session = PlanningSession(make_scenario(planner=REFERENCE))
    rows = np.array([[0.0, 0.0], [0.3, 0.2]])
    base = session.verifier().judge_each(rows)[1]
    for number in range(4):
        drawn = draw_robot(session, only(mesh_position_m=0.01, mesh_angle_deg=2.0, mesh_scale=0.01), (number,))
        states = drawn.verifier(session, session.scenario).judge_each(rows)[1]
        # Shapes as the surfaces see them are similar to those in the world.
        size = [np.linalg.norm(np.diff(found.positions, axis=1), axis=2) for found in (base, states)]
        np.testing.assert_allclose((size[0] / size[1]), (size[0] / size[1])[0, 0], rtol=1e-9)
        assert not np.allclose(states.positions, base.positions, atol=1e-4)
    shift = draw_robot(session, only(mesh_position_m=0.01), (1,))
    moved = shift.verifier(session, session.scenario).judge_each(rows)[1]
    difference = moved.positions - base.positions
    np.testing.assert_allclose(difference, np.broadcast_to(difference[0, 0], difference.shape), atol=1e-12)


def test_sizes_are_drawn_with_their_deviation(make_scenario: Callable[..., Scenario]) -> None:
    session = PlanningSession(make_scenario("two_segment"))
    tolerances = only(length=0.02, tendon_circle=0.03, tendon_angle_deg=1.0, tension_offset_n=0.1)
    drawn = [draw_robot(session, tolerances, (number,)) for number in range(60)]
    nominal = session.scenario.robot
    logs = np.array(
        [
            [np.log(a.length_m / b.length_m) for a, b in zip(d.robot.segments, nominal.segments, strict=True)]
            for d in drawn
        ]
    )
    turns = np.array([np.rad2deg(d.robot.tendon_angles - nominal.tendon_angles) for d in drawn])
    # A standard deviation from 120 numbers or more is off by less than a quarter in all but one case of 10^4.
    assert logs.std() == pytest.approx(0.02, rel=0.27)
    assert turns.std() == pytest.approx(1.0, rel=0.27)
    # No tendon pulls less than nothing: half of the offsets show where nothing is commanded.
    slack = np.array([d.actuate(np.zeros((1, 4))).tensions[0] for d in drawn]) - nominal.pretensions
    assert slack.min() >= -nominal.pretensions.max()
    assert (slack > 0.0).mean() == pytest.approx(0.5, abs=norm.isf(5e-5) * 0.5 / np.sqrt(slack.size))


@pytest.mark.parametrize(
    ("table", "match"),
    [({"displacement": 0.02}, "displacement"), ({"friction": 0.1}, "friction")],
)
def test_what_the_robot_lacks_is_refused_by_name(
    make_scenario: Callable[..., Scenario], table: Any, match: str
) -> None:
    with pytest.raises(InputError, match=f"tolerances.{match}.*'.*' has"):
        tolerances_of(make_scenario(tolerances=table))


def test_tolerances_that_leave_no_robot_are_refused(
    make_scenario: Callable[..., Scenario], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = PlanningSession(make_scenario())
    # Factors of e^(0.9 x) put the tendons beyond the disks' rim in four of ten draws: 20 tries find
    # a robot.
    wild = only(tendon_circle=0.9)
    for number in range(10):
        draw_robot(session, wild, (number,))
    monkeypatch.setattr("tdcr_planner.query.drawn_robot._TRIES", 1)
    with pytest.raises(InputError, match="leave a robot possible"):
        for number in range(30):
            draw_robot(session, wild, (number,))


@pytest.mark.parametrize("value", [0.0, 1.0, 1.5, -0.1])
def test_a_probability_that_is_none_is_refused(make_scenario: Callable[..., Scenario], value: float) -> None:
    with pytest.raises(FormatError, match="success_probability"):
        make_scenario(planner={"success_probability": value})
    with pytest.raises(InputError, match="success_probability"):
        make_scenario().with_planner(success_probability=value)


@pytest.mark.parametrize("table", [{"mass": -0.1}, {"length": 1.0}, {"mesh_angle_deg": 400.0}, {"colour": 0.1}])
def test_tolerances_that_are_none_are_refused(make_scenario: Callable[..., Scenario], table: dict[str, float]) -> None:
    with pytest.raises(FormatError, match=f"tolerances.{next(iter(table))}"):
        make_scenario(tolerances=table)


def test_margin_turns_a_path_that_grazes_into_one_that_holds(make_scenario: Callable[..., Scenario]) -> None:
    ends = ([[0.6, -1.2]], [[0.6, 1.2]])

    def at(x: float, **planner: Any) -> Scenario:
        return make_scenario(
            base={"position_m": [x, 0.0, -0.17]},
            start={"bending_n": ends[0]},
            goal={"bending_n": ends[1]},
            planner={**REFERENCE, **planner},
            tolerances={"base_position_m": 0.001},
        )

    def clearance(x: float) -> np.ndarray:
        rows = np.array([ends[0][0], [0.6, 0.0], ends[1][0]])
        return PlanningSession(at(x)).verifier().judge_each(rows)[1].clearance

    # Halfway the straight motion comes nearest to the face of the box: there it has 0.4 mm more than it must.
    near = 0.1 + clearance(0.1)[1] - 0.0009
    left = clearance(near)
    assert left[1] == pytest.approx(0.0009, abs=1e-5)
    assert left[[0, 2]].min() > 0.004
    found = plan(at(near, success_probability=0.8))
    assert found.risk is not None
    assert found.risk["reached"]
    assert found.risk["rounds"] > 1
    assert max(found.risk["margins_m"]) > 0.0003
    # Robots of another seed than any of those that took part.
    session = PlanningSession(found.scenario)
    rows = path_rows(session.space, found.path)
    drawn = [draw_robot(session, only(base_position_m=0.001), (99, number)) for number in range(60)]
    verified = [robot.verifier(session, found.scenario, measure=False).verify(rows)[0].verified for robot in drawn]
    assert np.mean(verified) > 0.8 - norm.isf(1e-4) * np.sqrt(0.8 * 0.2 / 60)
