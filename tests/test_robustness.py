from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, norm

from tdcr_planner.errors import InputError
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.result import PlanResult
from tdcr_planner.query.session import plan
from tdcr_planner.rates import binomial_rate
from tdcr_planner.robustness import Tolerances, assess_robustness
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

NONE = Tolerances(youngs_modulus=0.0, tension=0.0, mass=0.0, base_position_m=0.0, base_angle_deg=0.0)
# Statistics are tested at this probability of a false alarm, and the seeds are fixed.
UNLIKELY = 1e-4


@pytest.fixture
def planned(make_scenario: Callable[..., Scenario]) -> PlanResult:
    """The massless robot without loads, from straight to bent, far from anything."""
    return plan(make_scenario())


def in_chi2_bounds(squares: float, freedom: int) -> bool:
    return bool(chi2.ppf(UNLIKELY / 2, freedom) < squares < chi2.isf(UNLIKELY / 2, freedom))


def test_a_robot_as_the_file_says_changes_nothing(planned: PlanResult) -> None:
    found = assess_robustness(planned, NONE, samples=2)
    assert found.verified.all()
    assert found.causes == {}
    assert found.effects == {}
    np.testing.assert_allclose(found.spread.tip_shift, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.spread.clearance, np.tile(found.nominal, (2, 1)), atol=1e-12)
    assert planned.verification is not None
    assert found.nominal.min() == pytest.approx(planned.verification.worst["clearance_m"], abs=1e-12)


def test_one_modulus_holds_for_the_whole_path_and_bends_the_arc_accordingly(planned: PlanResult) -> None:
    found = assess_robustness(planned, replace(NONE, youngs_modulus=0.05), samples=40)
    assert planned.path is not None
    robot = planned.scenario.robot
    tensions = planned.path.tensions
    nominal = ConstantCurvatureShape(robot).disk_poses(tensions).positions[:, -1]

    def shift(factor: float) -> np.ndarray:
        # An unloaded arc's curvature is M / (E I): a stiffer rod bends as under smaller tensions.
        softened = ConstantCurvatureShape(robot).disk_poses(tensions / factor).positions[:, -1]
        return np.linalg.norm(softened - nominal, axis=1)

    def misfit(log: float, shifts: np.ndarray) -> float:
        return float(np.square(shift(np.exp(log)) - shifts).sum())

    logs = []
    for shifts in found.effects["youngs_modulus"].tip_shift:
        fits = [
            minimize_scalar(misfit, args=(shifts,), bounds=side, method="bounded", options={"xatol": 1e-9})
            for side in ((-0.4, 0.0), (0.0, 0.4))
        ]
        best = min(fits, key=lambda fit: fit.fun)
        # The arc leaves out axial strain, tau / EA = 4e-5, whose change with E is smaller still: 2e-6 m in 200 mm.
        np.testing.assert_allclose(shift(np.exp(best.x)), shifts, atol=3e-6)
        logs.append(best.x)
    assert in_chi2_bounds(np.square(logs).sum() / 0.05**2, 40)


def test_a_moved_base_moves_every_tip_alike(planned: PlanResult) -> None:
    found = assess_robustness(planned, replace(NONE, base_position_m=0.001), samples=40)
    shift = found.spread.tip_shift
    np.testing.assert_allclose(shift, shift[:, :1].repeat(shift.shape[1], axis=1), atol=1e-12)
    assert in_chi2_bounds(np.square(shift[:, 0]).sum() / 0.001**2, 3 * 40)


def test_a_tilted_base_moves_the_straight_tip_by_the_lever(planned: PlanResult) -> None:
    found = assess_robustness(planned, replace(NONE, base_angle_deg=0.1), samples=40)
    lever = np.deg2rad(0.1) * planned.scenario.robot.length
    # Twist about its own axis does not move a straight robot's tip: two of the three angles count.
    assert in_chi2_bounds(np.square(found.spread.tip_shift[:, 0]).sum() / lever**2, 2 * 40)


def test_masses_do_not_matter_without_gravity_and_do_with_it(make_scenario: Callable[..., Scenario]) -> None:
    varied = replace(NONE, mass=0.1)
    weightless = assess_robustness(plan(make_scenario("inspection")), varied, samples=3)
    np.testing.assert_allclose(weightless.spread.tip_shift, 0.0, atol=1e-9)
    heavy = make_scenario("inspection", gravity_m_s2=[9.81, 0.0, 0.0], goal={"bending_n": [[0.5, 0.0]]})
    assert assess_robustness(plan(heavy), varied, samples=3).spread.tip_shift.min() > 1e-5


def test_gains_act_on_tendons_that_pull_and_leave_the_commands_within_their_limits(
    make_scenario: Callable[..., Scenario], planned: PlanResult
) -> None:
    found = assess_robustness(planned, replace(NONE, tension=0.05), samples=5)
    np.testing.assert_allclose(found.spread.tip_shift[:, 0], 0.0, atol=1e-12)
    assert found.spread.tip_shift[:, -1].min() > 1e-5
    limit = planned.scenario.robot.segments[0].max_tension_n
    # A bending vector along the first tendon is that tendon's tension.
    pulled = plan(make_scenario(goal={"bending_n": [[0.0, limit]]}))
    assert assess_robustness(pulled, replace(NONE, tension=0.05), samples=5).verified.all()


def test_the_share_of_verified_robots_is_the_probability_of_staying_clear(
    make_scenario: Callable[..., Scenario],
) -> None:
    planner = {"validity": "reference", "clearance_m": 0.0005, "step_m": 0.0005}

    def at(x: float) -> PlanResult:
        return plan(make_scenario(base={"position_m": [x, 0.0, -0.17]}, planner=planner))

    far = at(0.15).verification
    assert far is not None
    # Beside the flat face of the box a base moved by d has d less clearance: asked 0.5 mm, left 0.6 mm more.
    near = at(0.15 + far.worst["clearance_m"] - 0.0011)
    assert near.verification is not None
    assert near.verification.worst["clearance_m"] == pytest.approx(0.0011, abs=1e-6)
    found = assess_robustness(near, replace(NONE, base_position_m=0.001), samples=60)
    expected = norm.cdf(0.6)
    rate = binomial_rate(int(found.verified.sum()), 60, confidence=1.0 - UNLIKELY)
    assert rate.low < expected < rate.high
    assert found.causes == {"clearance": 60 - int(found.verified.sum())}
    touching = binomial_rate(int((found.spread.least_clearance <= 0.0).sum()), 60, confidence=1.0 - UNLIKELY)
    assert touching.low < norm.sf(1.1) < touching.high
    assert found.collision_free_rate.count == 60 - touching.count


def test_a_tip_that_misses_its_goal_is_not_verified(make_scenario: Callable[..., Scenario]) -> None:
    goal = {"tip_position_m": reachable_tip(make_scenario()), "tip_tolerance_m": 0.002}
    planned = plan(make_scenario(goal=goal))
    found = assess_robustness(planned, replace(NONE, base_position_m=0.02), samples=4)
    assert found.causes == {"goal": 4}


def reachable_tip(scenario: Scenario) -> list[float]:
    tensions = scenario.robot.tensions_from_bending(np.array([[[0.6, 0.3]]]))
    tip = ConstantCurvatureShape(scenario.robot).disk_poses(tensions).positions[0, -1]
    return [float(value) for value in tip]


def test_draws_follow_the_seed(planned: PlanResult) -> None:
    one, again, other = (assess_robustness(planned, samples=2, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.spread.clearance, again.spread.clearance)
    assert not np.array_equal(one.spread.clearance, other.spread.clearance)
    assert set(one.effects) == set(Tolerances().varied())


def test_more_samples_go_on_with_the_same_robots(planned: PlanResult) -> None:
    few, more = (assess_robustness(planned, samples=count) for count in (2, 4))
    np.testing.assert_array_equal(few.spread.tip_shift, more.spread.tip_shift[:2])


def test_progress_counts_every_robot(planned: PlanResult) -> None:
    seen: list[tuple[int, int]] = []
    assess_robustness(
        planned, replace(NONE, mass=0.1), samples=3, progress=lambda done, total, _: seen.append((done, total))
    )
    assert seen == [(done, 6) for done in range(1, 7)]


@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf"), 5.0])
def test_a_tolerance_that_is_no_relative_deviation_is_refused(value: float) -> None:
    with pytest.raises(InputError, match="youngs_modulus"):
        Tolerances(youngs_modulus=value)


def test_a_result_without_a_path_is_refused(planned: PlanResult) -> None:
    with pytest.raises(InputError, match="with a path"):
        assess_robustness(replace(planned, path=None))
    with pytest.raises(InputError, match="1 or more"):
        assess_robustness(planned, samples=0)
