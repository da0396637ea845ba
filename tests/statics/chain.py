"""A solver of another kind: a robot as a chain of elements of constant strain, by Newton's method on its energy.

Nothing of the shooting method is in it: no cut, no moment, no differential equation. Its error is of second order in
the element's length with an even expansion, so two chains extrapolate to fourth order.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import torch

from tdcr_planner.robot import RobotSpec

DOUBLE = torch.float64


class Chain:
    """The chain of one robot; a rigid element keeps its rest strain by a stiffness a million times its own."""

    def __init__(self, robot: RobotSpec, elements: int) -> None:
        stops = np.unique(np.round(np.concatenate([robot.arc_lengths, robot.joins]), 12))
        nodes = np.concatenate([np.linspace(a, b, elements, endpoint=False) for a, b in pairwise(stops)])
        nodes = np.append(nodes, stops[-1])
        middles = 0.5 * (nodes[1:] + nodes[:-1])
        tensor = lambda value: torch.as_tensor(np.asarray(value, dtype=np.float64))  # noqa: E731
        self.robot = robot
        self.lengths = tensor(np.diff(nodes))
        self.stiffness = tensor(robot.stiffness_at(middles) * np.where(robot.rigid_at(middles), 1e6, 1.0)[:, None])
        self.rest = tensor(robot.rest_strain_at(middles))
        self.line_mass = tensor(robot.mass_per_length_at(middles))
        self.disks = np.searchsorted(nodes, robot.arc_lengths - 1e-9)
        masses = robot.disk_masses.copy()
        self.masses = tensor(masses)
        self.payload = tensor([*robot.tip.offset_m, 1.0])
        self.tendons = []
        for tendon in robot.tendons:
            own = (middles > tendon.start_arc_length) & (middles < tendon.end_arc_length)
            first, last = tendon.start_disk, tendon.end_disk
            if tendon.between_disks == "straight":
                holes = np.zeros((last - first + 1, 4))
                holes[:, :2] = tendon.offsets(robot.arc_lengths[first : last + 1])
                holes[:, 3] = 1.0
                self.tendons.append(("straight", torch.as_tensor(self.disks[first : last + 1]), tensor(holes)))
            else:
                path = np.zeros((own.sum(), 2, 3))
                path[:, 0, :2], path[:, 1, :2] = tendon.offsets(middles[own]), tendon.slopes(middles[own])
                self.tendons.append(("channel", torch.as_tensor(np.flatnonzero(own)), tensor(path)))

    def poses(self, strain: torch.Tensor) -> torch.Tensor:
        """Returns the poses of all nodes, shape (elements + 1, 4, 4), of strains (v, u), shape (elements, 6)."""
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
        # The exponential's series: elements turn by less than 0.5 rad.
        power = pose = torch.eye(4, dtype=DOUBLE).expand(len(step), 4, 4)
        for order in range(1, 12):
            power = power @ twist / order
            pose = pose + power
        reach = 1
        while reach < len(pose):
            pose = torch.cat([pose[:reach], pose[:-reach] @ pose[reach:]])
            reach *= 2
        return torch.cat([torch.eye(4, dtype=DOUBLE)[None], pose])

    def tendon_lengths(self, strain: torch.Tensor, poses: torch.Tensor) -> torch.Tensor:
        """Returns the length of each tendon, shape (t,)."""
        lengths = []
        for kind, where, path in self.tendons:
            if kind == "straight":
                points = (poses[where] @ path[:, :, None])[:, :3, 0]
                lengths.append((points[1:] - points[:-1]).norm(dim=1).sum())
            else:
                along = strain[where, :3] + torch.linalg.cross(strain[where, 3:], path[:, 0]) + path[:, 1]
                lengths.append((along.norm(dim=1) * self.lengths[where]).sum())
        return torch.stack(lengths)

    def potential(self, strain: torch.Tensor, case: dict[str, Any]) -> torch.Tensor:
        """Returns the potential energy: elastic, of the tendons or their springs, and of the dead forces."""
        elastic = (0.5 * (self.stiffness * (strain - self.rest) ** 2).sum(dim=1) * self.lengths).sum()
        poses = self.poses(strain)
        lengths = self.tendon_lengths(strain, poses)
        if "tensions" in case:
            pull = (case["tensions"] * lengths).sum()
        else:
            reach = case["displacements"] + lengths - case["rest_lengths"] + case["pretension"] / case["springs"]
            pull = 0.5 * (case["springs"] * torch.clamp(reach, min=0.0) ** 2).sum()
        nodes = poses[:, :3, 3]
        middles = 0.5 * (nodes[1:] + nodes[:-1])
        line = ((self.line_mass * self.lengths)[:, None] * case["gravity"] * middles).sum()
        work = (self.masses[:, None] * case["gravity"] * nodes[self.disks]).sum() + case["tip_force"] @ nodes[-1]
        work = work + self.robot.tip.mass_kg * case["gravity"] @ (poses[-1] @ self.payload)[:3]
        return elastic + pull - line - work

    def solve(self, case: dict[str, Any], start: torch.Tensor | None = None) -> torch.Tensor:
        """Returns the strains of the minimum reached from `start`, or from the unloaded shape with loads in steps."""
        strain = self.rest.clone() if start is None else start
        for fraction in (0.0, 0.4, 1.0) if start is None else (1.0,):
            part = {**case, **{name: fraction * case[name] for name in ("gravity", "tip_force")}}

            def energy(flat: torch.Tensor, part: dict[str, Any] = part) -> torch.Tensor:
                return self.potential(flat.reshape(-1, 6), part)

            for _ in range(60):
                flat = strain.reshape(-1)
                hessian = torch.func.hessian(energy)(flat)
                step = -torch.linalg.solve(hessian, torch.func.grad(energy)(flat)).reshape(-1, 6)
                reach, before = 1.0, energy(flat)
                # Slackening springs make Newton's full step too long at times.
                while energy((strain + reach * step).reshape(-1)) > before + 1e-12 * abs(before) and reach > 1e-3:
                    reach *= 0.5
                strain = strain + reach * step
                if step[:, 3:].abs().max() < (1e-6 if fraction == 1.0 else 1.0):
                    break
            else:
                raise AssertionError("the minimisation did not converge")
        assert torch.linalg.eigvalsh(hessian).min() > 0.0
        return strain


def extrapolated(
    robot: RobotSpec, loads: dict[str, np.ndarray], elements: int = 1, **actuation: np.ndarray
) -> tuple[np.ndarray, float]:
    """Returns disk positions (d, 3) extrapolated from two chains, and the largest distance between the two."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    case = {
        name: torch.as_tensor(np.asarray(value, dtype=np.float64)) for name, value in {**loads, **actuation}.items()
    }
    if "displacements" in case:
        case["pretension"] = torch.as_tensor(robot.drive.pretension)
    coarse_chain, fine_chain = Chain(robot, elements), Chain(robot, 2 * elements)
    shapes = []
    strain = None
    for chain in (coarse_chain, fine_chain):
        if "displacements" in case:
            case["rest_lengths"] = chain.tendon_lengths(chain.rest, chain.poses(chain.rest)).detach()
        strain = chain.solve(case, None if strain is None else strain.repeat_interleave(2, dim=0))
        shapes.append(np.asarray(chain.poses(strain)[chain.disks, :3, 3]))
    torch.set_num_threads(threads)
    coarse, fine = shapes
    return (4.0 * fine - coarse) / 3.0, float(np.abs(fine - coarse).max())
