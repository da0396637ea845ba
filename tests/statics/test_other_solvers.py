"""The solver against solvers of another kind: energy minimisation over a chain, and scipy's collocation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import torch
from scipy.integrate import solve_bvp

from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.solver import SolverSettings, SolveStatus, solve_statics


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


class Chain:
    """A robot as a chain of elements of constant strain, solved by Newton's method on its potential energy.

    Nothing of the shooting method is in it: no cut, no moment, no differential equation. Its error is of second order
    in the element's length with an even expansion, so two chains extrapolate to fourth order.
    """

    def __init__(self, robot: RobotSpec, elements_per_gap: int) -> None:
        tensor = torch.tensor
        spacing, segment_of = [], []
        for index, segment in enumerate(robot.segments):
            for _ in range(segment.disks * elements_per_gap):
                spacing.append(segment.length_m / segment.disks / elements_per_gap)
                segment_of.append(index)
        backbones = [robot.segment_backbones[index] for index in segment_of]
        self.lengths = tensor(spacing, dtype=torch.float64)
        self.stiffness = tensor(
            [[*b.stiffness_shear_extension, *b.stiffness_bending_torsion] for b in backbones], dtype=torch.float64
        )
        self.rest = tensor([[0.0, 0.0, 1.0, *b.rest_curvature_1_m] for b in backbones], dtype=torch.float64)
        self.line_mass = tensor([b.weight_per_length_kg_m for b in backbones], dtype=torch.float64)
        self.present = tensor(
            [[float(s <= end) for end in robot.tendon_segments] for s in segment_of], dtype=torch.float64
        )
        self.offsets = torch.as_tensor(robot.tendon_offsets)
        self.disks = torch.arange(0, len(spacing) + 1, elements_per_gap)
        self.robot = robot

    def positions(self, strain: torch.Tensor) -> torch.Tensor:
        """Returns the node positions, shape (elements + 1, 3), of strains (v, u), shape (elements, 6)."""
        step = strain * self.lengths[:, None]
        zero = torch.zeros_like(step[:, 0])
        twist = torch.stack(
            [
                torch.stack([zero, -step[:, 5], step[:, 4], step[:, 0]], dim=1),
                torch.stack([step[:, 5], zero, -step[:, 3], step[:, 1]], dim=1),
                torch.stack([-step[:, 4], step[:, 3], zero, step[:, 2]], dim=1),
                torch.stack([zero, zero, zero, zero], dim=1),
            ],
            dim=1,
        )
        # Eight terms of the exponential series: elements turn by less than 0.2 rad.
        power = pose = torch.eye(4, dtype=strain.dtype).expand(len(step), 4, 4)
        for order in range(1, 10):
            power = power @ twist / order
            pose = pose + power
        reach = 1
        while reach < len(pose):
            pose = torch.cat([pose[:reach], pose[:-reach] @ pose[reach:]])
            reach *= 2
        return torch.cat([torch.zeros(1, 3, dtype=strain.dtype), pose[:, :3, 3]])

    def potential(self, strain: torch.Tensor, tensions: torch.Tensor, loads: dict[str, torch.Tensor]) -> torch.Tensor:
        """Returns elastic energy plus tension times tendon length less the work of the forces."""
        elastic = 0.5 * (self.stiffness * (strain - self.rest) ** 2).sum(dim=1)
        shape = (len(strain), len(self.offsets), 3)
        turn = torch.linalg.cross(strain[:, None, 3:].expand(shape), self.offsets.expand(shape))
        pull = (self.present * tensions * (strain[:, None, :3] + turn).norm(dim=2)).sum(dim=1)
        nodes = self.positions(strain)
        middles = 0.5 * (nodes[1:] + nodes[:-1])
        line = (self.line_mass[:, None] * loads["gravity"] * middles).sum(dim=1)
        masses = torch.as_tensor(self.robot.disk_masses).clone()
        masses[-1] += self.robot.tip.mass_kg
        work = (masses[:, None] * loads["gravity"] * nodes[self.disks]).sum() + loads["tip_force"] @ nodes[-1]
        return ((elastic + pull - line) * self.lengths).sum() - work

    def solve(
        self, tensions: np.ndarray, loads: dict[str, np.ndarray], start: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Returns the strains of the minimum reached from `start`, or from the unloaded shape with loads in steps."""
        tension = torch.as_tensor(tensions)
        full = {name: torch.as_tensor(value) for name, value in loads.items()}
        strain = self.rest.clone() if start is None else start
        for fraction in (0.0, 0.4, 1.0) if start is None else (1.0,):
            part = {name: fraction * value for name, value in full.items()}

            def energy(flat: torch.Tensor, part: dict[str, torch.Tensor] = part) -> torch.Tensor:
                return self.potential(flat.reshape(-1, 6), tension, part)

            for _ in range(30):
                flat = strain.reshape(-1)
                hessian = torch.func.hessian(energy)(flat)
                step = -torch.linalg.solve(hessian, torch.func.grad(energy)(flat)).reshape(-1, 6)
                strain = strain + step
                if step[:, 3:].abs().max() < (1e-6 if fraction == 1.0 else 1.0):
                    break
            else:
                pytest.fail("the minimisation did not converge")
        assert torch.linalg.eigvalsh(hessian).min() > 0.0
        return strain


@pytest.mark.parametrize("name", ["inspection_robot", "two_segment_robot", "general_robot"])
def test_energy_minimisation_finds_the_same_shapes(
    request: pytest.FixtureRequest, name: str, loads_of: Callable, random: np.random.Generator
) -> None:
    robot = request.getfixturevalue(name)
    tensions, loads = loads_of(robot, random, 1, share=0.7)
    solution = solve_statics(robot, tensions, **loads)
    case = {key: value[0] for key, value in loads.items()}
    coarse_chain, fine_chain = Chain(robot, 1), Chain(robot, 2)
    strain = coarse_chain.solve(tensions[0], case)
    coarse = np.asarray(coarse_chain.positions(strain)[coarse_chain.disks])
    strain = fine_chain.solve(tensions[0], case, strain.repeat_interleave(2, dim=0))
    fine = np.asarray(fine_chain.positions(strain)[fine_chain.disks])
    extrapolated = (4.0 * fine - coarse) / 3.0
    # The chains differ by up to a tenth of a millimetre; extrapolation leaves about a hundredth of that.
    error = np.abs(extrapolated - solution.positions[0]).max()
    assert error < 2e-6
    assert error < 0.05 * np.abs(fine - coarse).max()
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
