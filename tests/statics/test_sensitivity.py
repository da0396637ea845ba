"""Derivatives against central differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.sensitivity import statics_jacobian
from tdcr_planner.statics.solver import SolverSettings, solve_statics

# Step of the central difference for each kind: its error, step^2 times the third derivative, and that of the solver
# (1e-12 relative) divided by the step are both below 1e-7 of the derivative.
STEPS = {
    "tensions": 1e-3,
    "gravity": 1e-3,
    "tip_force": 1e-5,
    "tip_moment": 1e-6,
    "distributed_force": 1e-4,
    "disk_forces": 1e-5,
}


@pytest.mark.parametrize("kind", STEPS)
def test_derivatives_agree_with_central_differences(
    general_robot: RobotSpec, tight: SolverSettings, loads_of: Callable, random: np.random.Generator, kind: str
) -> None:
    tensions, loads = loads_of(general_robot, random, 3, share=0.4, everything=True)
    solution = solve_statics(general_robot, tensions, **loads, settings=tight)
    assert solution.converged.all()
    jacobian = statics_jacobian(general_robot, solution, with_disk_forces=True)
    derivative = getattr(jacobian, kind)
    arguments = {"tensions": tensions, **loads}
    width = arguments[kind][0].size
    matrices = derivative.rotation_matrices(solution)
    for column in range(0, width, max(1, width // 6)):
        shapes = []
        for sign in (1.0, -1.0):
            moved = {name: value.copy() for name, value in arguments.items()}
            moved[kind].reshape(3, -1)[:, column] += sign * STEPS[kind]
            shapes.append(solve_statics(general_robot, **moved, settings=tight))
        for name, exact in (
            ("positions", derivative.positions[..., column]),
            ("rotations", matrices[..., column]),
            ("base_moment", derivative.base_moment[..., column]),
        ):
            difference = (getattr(shapes[0], name) - getattr(shapes[1], name)) / (2.0 * STEPS[kind])
            largest = np.abs(getattr(derivative, name)).max()
            np.testing.assert_allclose(exact, difference, atol=3e-7 * largest)


def test_derivatives_gain_order_four_with_the_step(
    two_segment_robot: RobotSpec, loads_of: Callable, random: np.random.Generator
) -> None:
    tensions, loads = loads_of(two_segment_robot, random, 4)
    exact = []
    for steps in (1, 2, 4):
        settings = SolverSettings(tolerance=1e-12, steps_per_gap=steps)
        solution = solve_statics(two_segment_robot, tensions, **loads, settings=settings)
        exact.append(statics_jacobian(two_segment_robot, solution).tensions.positions)
    slope = np.log2(np.abs(exact[0] - exact[1]).max() / np.abs(exact[1] - exact[2]).max())
    assert 3.6 < slope < 4.5


def test_no_equilibrium_no_derivative(two_segment_robot: RobotSpec) -> None:
    force = np.array([[0.01, 0.0, 0.0], [1e4, 0.0, -1e4]])
    solution = solve_statics(two_segment_robot, np.ones((2, 6)), tip_force=force)
    jacobian = statics_jacobian(two_segment_robot, solution)
    assert np.isfinite(jacobian.tensions.positions[0]).all()
    assert np.isnan(jacobian.tensions.positions[1]).all()
    assert jacobian.disk_forces is None


def test_a_solution_of_another_robot_is_refused(two_segment_robot: RobotSpec, paper_robot: RobotSpec) -> None:
    solution = solve_statics(paper_robot, np.ones((1, 3)))
    with pytest.raises(InputError, match=r"robot two_segment \(6 tendons, 21 disks\), got one of 3 tendons"):
        statics_jacobian(two_segment_robot, solution)
