"""The energy balance: what loads and tendons do along a path is what the rod stores."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.energy import stored_energy, total_potential
from tdcr_planner.statics.solver import SolverSettings, solve_statics
from tdcr_planner.statics.tendons import tendon_displacements, tendon_lengths


def test_work_of_tendons_and_forces_is_stored(
    robot_of: Callable[..., RobotSpec], tight: SolverSettings, random: np.random.Generator
) -> None:
    robot = robot_of(circles=(0.008, 0.006), disk_mass=0.0005)
    tensions = random.uniform(0.0, 3.0, (1, 6))
    forces = random.normal(size=(1, robot.disk_count, 3)) * 0.004
    # Gauss-Legendre points: no derivative of the shapes is used, only the shapes themselves.
    points, weights = np.polynomial.legendre.leggauss(12)
    path = 0.5 * (1.0 + points)[:, None]
    along = solve_statics(robot, path * tensions, disk_forces=path[:, :, None] * forces, settings=tight)
    end = solve_statics(robot, tensions, disk_forces=forces, settings=tight)
    start = solve_statics(robot, 0.0 * tensions, settings=tight)

    def work_conjugate(solution: object) -> np.ndarray:
        pulled = (tensions * tendon_displacements(robot, solution)).sum(axis=1)
        moved = (forces * (solution.positions - start.positions)).sum(axis=(1, 2))
        return pulled + moved

    # Work = integral of load d(displacement) = load x displacement at the end - integral of displacement d(load).
    work = work_conjugate(end)[0] - 0.5 * weights @ work_conjugate(along)
    stored = stored_energy(robot, end)[0]
    assert stored > 1e-3
    # The integrator's error at four steps a gap, squared nowhere: 1e-9 relative.
    np.testing.assert_allclose(work, stored, rtol=1e-8)


def test_the_potential_changes_with_a_tension_by_the_tendon_length(
    general_robot: RobotSpec, tight: SolverSettings, loads_of: Callable, random: np.random.Generator
) -> None:
    tensions, loads = loads_of(general_robot, random, 2, share=0.4, everything=True)
    del loads["tip_moment"]
    lengths = tendon_lengths(general_robot, solve_statics(general_robot, tensions, **loads, settings=tight))
    for tendon in range(general_robot.tendon_count):
        step = np.zeros(general_robot.tendon_count)
        step[tendon] = 1e-3
        high, low = (
            total_potential(
                general_robot, solve_statics(general_robot, tensions + sign * step, **loads, settings=tight)
            )
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose((high - low) / 2e-3, lengths[:, tendon], rtol=1e-7)


def test_a_pulled_bar_stores_half_the_work(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of()
    force = 20.0
    solution = solve_statics(robot, np.zeros((1, 3)), tip_force=[0.0, 0.0, force])
    stiffness = robot.backbone.youngs_modulus_pa * robot.backbone.area / robot.length
    np.testing.assert_allclose(stored_energy(robot, solution), 0.5 * force**2 / stiffness, rtol=1e-9)


def test_tip_moments_have_no_potential(paper_robot: RobotSpec) -> None:
    solution = solve_statics(paper_robot, np.zeros((1, 3)), tip_moment=[0.0, 0.001, 0.0])
    with pytest.raises(InputError, match="without a tip moment"):
        total_potential(paper_robot, solution)
