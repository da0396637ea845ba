"""One step of correction, held against the Cosserat reference."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.learning.dataset import SolvedCases, draw_cases, solve_cases
from tdcr_planner.learning.judge import body_errors
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import Domain
from tdcr_planner.shape.correction import Corrector


def solved(robot: RobotSpec, gravity: float, tip_force: float) -> SolvedCases:
    domain = Domain(max_tension_n=tuple(robot.max_tensions), gravity_m_s2=gravity, tip_force_n=tip_force)
    return solve_cases(robot, draw_cases(robot, domain, "planner", 60, np.random.default_rng(2)))


def disturbed(robot: RobotSpec, cases: SolvedCases, size: float) -> np.ndarray:
    """Returns the shapes bent by a random way that grows with the square of arc length, m at the tip."""
    ways = np.random.default_rng(3).normal(size=(len(cases.cases), 1, 3))
    return cases.positions + size * ways * (robot.arc_lengths[:, None] / robot.length) ** 2


def test_the_base_moment_is_that_of_the_loads(inspection_robot: RobotSpec) -> None:
    cases = solved(inspection_robot, 9.81, 0.02)
    found = Corrector(inspection_robot).base_moments(cases.positions, cases.cases.gravity, cases.cases.tip_force)
    size = np.linalg.norm(cases.base_moment, axis=1).max()
    # The line mass between disks by the trapezoidal rule: (u h)^2 / 12 of its part, some 1e-3.
    np.testing.assert_allclose(found, cases.base_moment, atol=2e-3 * size)


def test_without_loads_one_step_is_exact_whatever_the_shape(paper_robot: RobotSpec) -> None:
    cases = solved(paper_robot, 0.0, 0.0)
    inputs = cases.cases.tensions, cases.cases.gravity, cases.cases.tip_force
    step = Corrector(paper_robot).correct(disturbed(paper_robot, cases, 0.05), *inputs)
    assert body_errors(paper_robot, step.positions, step.rotations, cases).max() < 1e-9
    assert step.remainder.max() == 0.0


@pytest.mark.parametrize("name", ["inspection", "two_segment"])
def test_with_loads_one_step_leaves_a_hundredth_and_says_how_much(name: str, request: pytest.FixtureRequest) -> None:
    robot = request.getfixturevalue(f"{name}_robot")
    cases = solved(robot, 9.81, 0.01)
    inputs = cases.cases.tensions, cases.cases.gravity, cases.cases.tip_force
    corrector = Corrector(robot)
    start = disturbed(robot, cases, 0.002)
    before = body_errors(robot, start, cases.rotations, cases)[:, -1]
    step = corrector.correct(start, *inputs)
    after = body_errors(robot, step.positions, step.rotations, cases)[:, -1]
    assert np.median(after / before) < 0.01
    scale = corrector.scale(start, cases.rotations, step)[:, -1]
    np.testing.assert_allclose(before, scale, rtol=0.05)
    # To first order, and down to the rounding of the compiled integration, 3e-7 m for each 0.2 m.
    assert (after < 2.0 * step.remainder[:, -1] + 2e-6).all()


def test_an_absurd_shape_gets_a_huge_scale_not_an_error(inspection_robot: RobotSpec) -> None:
    cases = solved(inspection_robot, 9.81, 0.02)
    inputs = cases.cases.tensions, cases.cases.gravity, cases.cases.tip_force
    corrector = Corrector(inspection_robot)
    start = disturbed(inspection_robot, cases, 50.0)
    step = corrector.correct(start, *inputs)
    scale = corrector.scale(start, cases.rotations, step)[:, -1]
    assert not (scale < 0.1).any()
