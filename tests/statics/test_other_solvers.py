"""The solver against solvers of another kind: energy minimisation over a chain, and scipy's collocation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.solver import SolverSettings, SolveStatus, solve_statics


@pytest.mark.parametrize("name", ["inspection_robot", "two_segment_robot", "general_robot"])
def test_energy_minimisation_finds_the_same_shapes(
    request: pytest.FixtureRequest, name: str, extrapolated: Callable, loads_of: Callable, random: np.random.Generator
) -> None:
    robot = request.getfixturevalue(name)
    tensions, loads = loads_of(robot, random, 1, share=0.7)
    solution = solve_statics(robot, tensions, **loads)
    case = {key: value[0] for key, value in loads.items()}
    positions, spread = extrapolated(robot, case, tensions=tensions[0])
    # The chains differ by up to a tenth of a millimetre; extrapolation leaves about a hundredth of that.
    error = np.abs(positions - solution.positions[0]).max()
    assert error < 2e-6
    assert error < 0.05 * spread
    assert solution.status[0] == SolveStatus.CONVERGED


def test_planar_cantilever_under_its_own_weight(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of(radius=1e-4, density=8000.0)
    stiffness = robot.backbone.stiffness_bending_torsion[0]
    weight = robot.backbone.weight_per_length_kg_m * 9.81

    # E I theta'' = -w (l - s) cos(theta), theta the angle from the horizontal rod, downwards positive.
    def equation(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([y[1], -weight * (0.2 - s) * np.cos(y[0]) / stiffness, np.cos(y[0]), np.sin(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], b[1], a[2], a[3]])

    grid = np.linspace(0.0, 0.2, 41)
    result = solve_bvp(equation, ends, grid, np.zeros((4, 41)), tol=1e-9, max_nodes=20000)
    assert result.success
    expected = result.sol(robot.arc_lengths)
    solution = solve_statics(
        robot, np.zeros((1, 3)), gravity=[9.81, 0.0, 0.0], settings=SolverSettings(steps_per_gap=2)
    )
    assert expected[3, -1] > 0.08
    np.testing.assert_allclose(solution.positions[0, :, 2], expected[2], atol=2e-7)
    np.testing.assert_allclose(solution.positions[0, :, 0], expected[3], atol=2e-7)


def test_collocation_of_the_coupled_rod_and_tendon_equations(
    robot_of: Callable[..., RobotSpec], random: np.random.Generator
) -> None:
    """Rucker and Webster 2011, eq. 17 to 19: ordinary equations for v and u, internal force and moment at the tip."""
    robot = robot_of(circles=(0.008,))
    tension, force, moment = np.array([2.5, 0.4, 1.5]), np.array([0.03, -0.04, 0.05]), np.array([1e-3, 0.0, -1e-3])
    kse = np.diag(robot.backbone.stiffness_shear_extension)
    kbt = np.diag(robot.backbone.stiffness_bending_torsion)
    offsets = robot.tendon_offsets
    rest = np.array([0.0, 0.0, 1.0])

    def hat(a: np.ndarray) -> np.ndarray:
        return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])

    def rotation(q: np.ndarray) -> np.ndarray:
        w, x, y, z = q / np.linalg.norm(q)
        return np.eye(3) + 2 * w * hat(np.array([x, y, z])) + 2 * hat(np.array([x, y, z])) @ hat(np.array([x, y, z]))

    def derivative(y: np.ndarray) -> np.ndarray:
        q, v, u = y[3:7], y[7:10], y[10:13]
        left = np.zeros((6, 6))
        left[:3, :3], left[3:, 3:] = kse, kbt
        right = np.concatenate([-np.cross(u, kse @ (v - rest)), -np.cross(u, kbt @ u) - np.cross(v, kse @ (v - rest))])
        for tau, r in zip(tension, offsets, strict=True):
            along = np.cross(u, r) + v
            A = -hat(along) @ hat(along) / np.linalg.norm(along) ** 3 * tau
            B = hat(r) @ A
            a = A @ np.cross(u, along)
            left += np.block([[A, -A @ hat(r)], [B, -B @ hat(r)]])
            right -= np.concatenate([a, np.cross(r, a)])
        strain = np.linalg.solve(left, right)
        w, x = q[0], q[1:]
        spin = 0.5 * np.concatenate([[-x @ u], w * u + np.cross(x, u)])
        return np.concatenate([rotation(q) @ v, spin, strain])

    def equation(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([derivative(column) for column in y.T], axis=1)

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        R, v, u = rotation(b[3:7]), b[7:10], b[10:13]
        along = np.cross(u, offsets) + v
        pulls = tension[:, None] * along / np.linalg.norm(along, axis=1)[:, None]
        n = kse @ (v - rest) - R.T @ force + pulls.sum(axis=0)
        m = kbt @ u - R.T @ moment + np.cross(offsets, pulls).sum(axis=0)
        # Scaled to strains, so that one tolerance fits all rows.
        return np.concatenate([a[:3], a[3:7] - [1, 0, 0, 0], n / kse[2, 2], m / kbt[0, 0]])

    grid = np.linspace(0.0, 0.2, 21)
    start = np.zeros((13, 21))
    start[2], start[3], start[9] = grid, 1.0, 1.0
    result: Any = solve_bvp(equation, ends, grid, start, tol=1e-6, max_nodes=2000)
    assert result.success
    solution = solve_statics(robot, tension[None], tip_force=force, tip_moment=moment)
    # The collocation's relative tolerance of 1e-6 over 0.2 m, and what a few such rows of error may add up to.
    np.testing.assert_allclose(solution.positions[0], result.sol(robot.arc_lengths)[:3].T, atol=5e-7)
