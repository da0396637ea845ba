from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.slack import SlackRecord
from tdcr_planner.planning.scenario import Goal, Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.query.solved_states import BATCH
from tdcr_planner.query.verification import Verifier
from tdcr_planner.query.verification_report import VerificationReport
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.base import DiskPoses
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape


@dataclass
class WallScene:
    """A wall at x = place, free towards smaller x; the body is a ball of the disk's radius at each disk."""

    place: float
    radius: float = 0.01
    knot: float = -np.inf

    def clearance(self, positions: FloatArray, rotations: FloatArray) -> FloatArray:
        return np.asarray(self.place - self.radius - positions[:, 1:, 0].max(axis=1))

    def make_prover(self, margins: FloatArray) -> WallProver:
        return WallProver(self, float(margins[0]))

    def touches_itself(self, positions: FloatArray, rotations: FloatArray) -> BoolArray:
        """Calls a body knotted whose tip comes beside its base plane's height `knot`."""
        return np.asarray(positions[:, -1, 2] - self.radius < self.knot)


@dataclass
class WallProver:
    """Bounds what each disk keeps from the wall beyond a clearance."""

    scene: WallScene
    clearance: float

    def record(self, states: int) -> SlackRecord:
        return SlackRecord.empty(1, states, 1)

    def open_intervals(
        self,
        positions: FloatArray,
        rotations: FloatArray,
        order: IntArray,
        motion: FloatArray,
        stray: FloatArray,
        record: SlackRecord,
        exact_below: float,
    ) -> tuple[FloatArray, FloatArray]:
        slack = self.scene.place - self.scene.radius - positions[order, 1:, 0] - self.clearance
        left_open = (slack[:-1] + slack[1:] < motion[:, 1:]).any(axis=1)
        return np.zeros(len(motion)), motion.max(axis=1) * left_open


@pytest.fixture
def verifier_at(make_scenario: Callable[..., Scenario]) -> Callable[..., Verifier]:
    def make(place: float, clearance: float = 0.001, step: float = 0.002, **scenario: object) -> Verifier:
        space = ConfigurationSpace(make_scenario(**scenario))
        model = ConstantCurvatureShape(space.robot)
        return Verifier(space, WallScene(place), step=step, clearance=clearance, model=model)  # type: ignore[arg-type]

    return make


PATH = np.array([[0.0, 0.0], [2.0, 0.0]])


def test_a_free_path_is_verified_at_states_no_farther_apart_than_the_step(verifier_at: Callable[..., Verifier]) -> None:
    verifier = verifier_at(0.3)
    report, states = verifier.verify(PATH)
    assert report.verified
    assert report.message == ""
    assert verifier.body_motion(report.positions, report.rotations).max() <= 0.002
    np.testing.assert_array_equal(states.rows[[0, -1]], PATH)
    # The massless robot without loads is an arc up to its axial compression of tau / EA = 4e-5, 0.008 mm in 200 mm.
    assert report.worst["deviation_m"] < 2e-5
    assert report.states == len(states.rows) == len(report.clearance)


def test_a_report_is_printed_in_a_line(verifier_at: Callable[..., Verifier]) -> None:
    report, states = verifier_at(0.3).verify(PATH)
    text = repr(report)
    assert text.startswith(f"VerificationReport(verified=True, states={len(states.rows)}, worst={{residual_nm: ")
    assert f"clearance_m: {states.clearance.min():.3g}" in text
    assert len(text) < 200


def test_the_state_with_too_little_clearance_is_named(verifier_at: Callable[..., Verifier]) -> None:
    verifier = verifier_at(0.08)
    report, _ = verifier.verify(PATH)
    assert not report.verified
    assert report.cause == "clearance"
    assert "state 2 of 2: clearance" in report.message
    assert report.worst["clearance_m"] < 0.001


def test_a_collision_between_the_given_states_is_found(verifier_at: Callable[..., Verifier]) -> None:
    there_and_back = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.0]])
    tip = verifier_at(1.0).verify(there_and_back)[0].positions[:, :, 0].max()
    ends_only = np.array([[2.0, -1.0], [2.0, 1.0]])
    farthest = verifier_at(1.0).verify(ends_only)[0].positions[:, :, 0]
    assert farthest.max() > max(farthest[0].max(), farthest[-1].max())
    place = 0.5 * (farthest.max() + farthest[0].max()) + 0.01 + 0.001
    report, _ = verifier_at(place).verify(ends_only)
    assert not report.verified
    assert report.cause == "clearance"
    assert tip > 0.0


def test_states_are_dense_where_the_clearance_is_tight(verifier_at: Callable[..., Verifier]) -> None:
    reach = verifier_at(1.0).verify(PATH)[0].positions[:, :, 0].max()
    free, _ = verifier_at(0.3).verify(PATH)
    tight, _ = verifier_at(reach + 0.01 + 0.001 + 1e-4).verify(PATH)
    assert tight.verified
    assert tight.states > free.states


def test_touching_the_asked_clearance_exactly_is_never_verified_by_rounding(
    verifier_at: Callable[..., Verifier],
) -> None:
    reach = verifier_at(1.0).verify(PATH)[0].positions[:, :, 0].max()
    report, _ = verifier_at(reach + 0.01 + 0.001 - 1e-6).verify(PATH)
    assert not report.verified


def test_a_wrong_shape_model_does_not_change_the_verdict(verifier_at: Callable[..., Verifier]) -> None:
    class Straight:
        """Calls every shape straight."""

        name = "straight"

        def __init__(self, robot: RobotSpec) -> None:
            self.robot = robot
            self.error_bound = np.zeros(robot.disk_count)

        def in_domain(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> BoolArray:
            return np.ones(len(tensions), dtype=np.bool_)

        def disk_poses(self, tensions: FloatArray, **loads: FloatArray) -> DiskPoses:
            positions = np.zeros((len(tensions), self.robot.disk_count, 3))
            positions[:, :, 2] = self.robot.arc_lengths
            rotations = np.broadcast_to(np.eye(3), (*positions.shape, 3)).copy()
            return DiskPoses(positions, rotations, np.ones(len(tensions), dtype=np.bool_))

    verifier = verifier_at(0.08)
    verifier.model = Straight(verifier.space.robot)  # type: ignore[assignment]
    report, _ = verifier.verify(PATH)
    assert not report.verified
    assert report.worst["deviation_m"] > 0.05


def test_a_tension_over_its_limit_is_not_verified(verifier_at: Callable[..., Verifier]) -> None:
    report, _ = verifier_at(1.0).verify(np.array([[0.0, 0.0], [3.6, 0.0]]))
    assert not report.verified
    assert report.cause == "limits"
    assert not report.in_limits[-1]
    assert report.in_limits[0]


def test_loads_beyond_buckling_are_not_verified(verifier_at: Callable[..., Verifier]) -> None:
    # The tip load of the clamped column's first mode is pi^2 EI / (4 L^2) = 0.18 N; 0.5 N pushes the straight robot
    # far beyond it, where the straight shape is not stable.
    report, _ = verifier_at(1.0, tip_force_n=[0.0, 0.0, -0.5]).verify(np.zeros((2, 2)))
    assert not report.verified
    assert report.cause == "statics"


def test_a_robot_that_touches_itself_is_not_verified(verifier_at: Callable[..., Verifier]) -> None:
    lowest = verifier_at(1.0).verify(PATH)[0].positions[-1, -1, 2]
    for knot, verified in ((lowest - 0.0101, True), (lowest - 0.0099, False)):
        verifier = verifier_at(1.0)
        scene = WallScene(1.0, knot=knot)
        report, _ = Verifier(verifier.space, scene, step=0.002, clearance=0.0).verify(PATH)  # type: ignore[arg-type]
        assert report.verified == verified
        assert report.cause == ("" if verified else "self_collision")


def test_tip_goals_are_judged_by_the_reference(verifier_at: Callable[..., Verifier]) -> None:
    verifier = verifier_at(1.0)
    tip = verifier.verify(PATH)[0].positions[-1, -1]
    axis = verifier.verify(PATH)[0].rotations[-1, -1, :, 2]
    hit = Goal(
        tip_position_m=tuple(tip + np.array([0.0, 0.0009, 0.0])), tip_tolerance_m=0.001, view_direction=tuple(axis)
    )
    miss = Goal(tip_position_m=tuple(tip + np.array([0.0, 0.0011, 0.0])), tip_tolerance_m=0.001)
    aside = Goal(tip_position_m=tuple(tip), view_direction=(0.0, 1.0, 0.0), view_tolerance_deg=80.0)
    report, states = verifier.verify(PATH, [(1, hit)])
    assert report.verified
    assert states.goals[-1] == 0
    assert (states.goals[:-1] == -1).all()
    assert "the tip is 1.100 mm off, allowed 1.000 mm" in verifier.verify(PATH, [(1, miss)])[0].message
    assert "the tip looks 90.00 degrees aside, allowed 80.00" in verifier.verify(PATH, [(1, aside)])[0].message


def test_a_path_that_is_not_solved_in_time_is_not_verified(
    verifier_at: Callable[..., Verifier], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(np.arange(1000.0))
    monkeypatch.setattr("tdcr_planner.query.solved_states.time.monotonic", lambda: float(next(clock)))
    rows = np.linspace(PATH[0], PATH[1], 2 * BATCH + 44)
    report, states = verifier_at(1.0).verify(rows, deadline=1.5)
    assert not report.verified
    assert report.cause == "time"
    assert f"after {2 * BATCH} of {len(rows)} states" in report.message
    assert states.solved.tolist() == [True] * 2 * BATCH + [False] * 44
    np.testing.assert_array_equal(states.rows, rows)
    assert np.isfinite(report.worst["clearance_m"])
    # What is known speaks before the time does.
    clock = iter(np.arange(1000.0))
    assert verifier_at(0.03).verify(rows, deadline=1.5)[0].cause == "clearance"


def test_gaps_that_are_not_shown_in_time_are_not_verified(verifier_at: Callable[..., Verifier]) -> None:
    report, _ = verifier_at(0.3).verify(PATH, deadline=0.0)
    assert not report.verified
    assert report.cause == "time"
    assert "motions between states not yet shown to be free" in report.message
    assert verifier_at(0.3).verify(PATH, deadline=np.inf)[0].verified


@pytest.mark.parametrize("step", [0.0005, 0.002, 0.01])
def test_the_step_is_no_margin(verifier_at: Callable[..., Verifier], step: float) -> None:
    reach = verifier_at(1.0).verify(PATH)[0].positions[:, :, 0].max()
    # 2 um beyond what is asked for suffice, whatever the step; 2 um less do not.
    for spare, verified in ((2e-6, True), (-2e-6, False)):
        report, _ = verifier_at(reach + 0.01 + 0.001 + spare, step=step).verify(PATH)
        assert report.verified == verified


def test_a_wall_that_only_friction_reaches_refuses_the_path(make_scenario: Callable[..., Scenario]) -> None:
    bent = [[0.002, 0.0], [0.0, 0.001], [0.0, 0.0]]
    more = [[0.0025, 0.0], [0.0, 0.001], [0.0, 0.0]]
    planner = {"validity": "reference", "step_m": 0.01}
    bench = make_scenario("bench", start={"bending_m": bent}, goal={"bending_m": more}, planner=planner)
    space = ConfigurationSpace(bench)
    rows = np.stack([space.row_of(bench.file.start), space.row_of(bench.goals[0])])

    def judge(place: float) -> VerificationReport:
        verifier = Verifier(space, WallScene(place), step=0.01, clearance=0.001)  # type: ignore[arg-type]
        return verifier.verify(rows)[0]

    far = judge(1.0)
    assert far.verified
    assert far.friction is not None
    # A tendon that turns by 0.6 rad loses 6 % of what holds the tip 60 mm aside, and the drive makes up for most of it.
    assert 1e-4 < far.friction.spread_m < 0.005
    free_of_friction = 1.0 - 0.01 - far.positions[:, 1:, 0].max()
    with_friction = far.clearance.min()
    assert with_friction < free_of_friction - 1e-4
    near = judge(1.0 - 0.5 * (with_friction + free_of_friction) + 0.001)
    assert not near.verified
    assert "sliding" in near.message
    assert near.cause == "clearance"
