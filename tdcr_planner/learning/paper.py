"""Training of the published network: its losses, its sampling and its schedule (Bensch et al. 2024)."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from tdcr_planner.errors import InputError
from tdcr_planner.files import sha256_of_json
from tdcr_planner.learning.checkpoint import checkpoint_path, load_checkpoint, save_checkpoint
from tdcr_planner.learning.dataset import Progress, no_progress
from tdcr_planner.learning.paper_network import SECTOR, PaperNetwork
from tdcr_planner.learning.settings import TrainSettings
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.solver import solve_statics

# The authors keep the cosine of (20) this far from one, where acos has no slope.
_COSINE_LIMIT = 0.99999


def train_paper_network(
    robot: RobotSpec, settings: TrainSettings, out: Path, *, progress: Progress = no_progress
) -> PaperNetwork:
    """Returns the published network, trained by the published method.

    Args:
        robot: A robot of one segment with three tendons 120 degrees apart.
        settings: What train.toml says; the domain must be without loads, as the paper's is.
        out: The model file; the checkpoint stands beside it.
        progress: Called with stage, steps done, steps in all and a remark.

    Raises:
        InputError: The robot or the domain is not the paper's.
    """
    paper, domain = settings.paper, settings.domain
    if domain.tip_force_n > 0.0 or domain.gravity_m_s2 > 0.0:
        raise InputError(
            "domain",
            "gravity_m_s2 = 0 and tip_force_n = 0 for network `paper`, which knows no loads",
            f"gravity_m_s2 = {domain.gravity_m_s2:g}, tip_force_n = {domain.tip_force_n:g}",
        )
    torch.manual_seed(settings.seed)
    run = _Run(robot, settings, PaperNetwork(robot, paper.hidden))
    path = checkpoint_path(out)
    content = {"seed": settings.seed, "domain": domain.model_dump(), "paper": paper.model_dump()}
    keys = robot.mechanics_hash, sha256_of_json(content)
    state = load_checkpoint(path, *keys)
    if state is not None:
        run.restore(state)
    while run.epoch < paper.epochs:
        loss = run.train_epoch()
        score = run.validate()
        save_checkpoint(path, *keys, run.state())
        progress("training", run.epoch, paper.epochs, f"loss {loss:.2e}, position {1e3 * score:.3f} mm")
    run.network.load_state_dict(run.best_weights)
    return run.network


class PhysicsLoss:
    """Residuals of the rod's equations at collocation points, (15), and of the conditions at base and tip."""

    def __init__(self, robot: RobotSpec, network: PaperNetwork) -> None:
        """Prepares the constants of a robot."""
        order = np.argsort(np.mod(robot.tendon_angles, 2.0 * np.pi))
        self._network = network
        self._offsets = torch.as_tensor(robot.tendon_offsets[order[:2]]).float()
        self._bending = torch.tensor(robot.backbone.stiffness_bending_torsion)
        self._shear = torch.tensor(robot.backbone.stiffness_shear_extension)
        self._length = robot.length

    def residuals(self, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Returns p' - R e3 (n, 3), R' - R [u]x (n, 3, 3) and u' - its value by the equations (n, 3).

        Args:
            rows: s (m), tau_1, tau_2 (N), shape (n, 3).
        """
        along = torch.zeros_like(rows)
        along[:, 0] = 1.0

        def evaluate(inputs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
            out = self._network.cross_sections(inputs)
            return out[:, 0:3], self._network.rotation(out[:, 3:6]), out[:, 6:9]

        values, slopes = torch.func.jvp(evaluate, (rows,), (along,))[:2]
        (_, rotation, u), (p_slope, rotation_slope, u_slope) = values, slopes
        turn = torch.matmul(rotation, _skew(u))
        return p_slope - rotation[:, :, 2], rotation_slope - turn, u_slope - self._curvature_slope(u, rows[:, 1:])

    def _curvature_slope(self, u: Tensor, tensions: Tensor) -> Tensor:
        """Returns u' of the unloaded rod with v = e3: [Kse + A, G; B, Kbt + H] [v'; u'] = [d; c].

        Rucker and Webster 2011, eq. 17.
        """
        v = torch.zeros_like(u)
        v[:, 2] = 1.0
        u_hat = _skew(u)
        stiffness = torch.diag(torch.cat([self._shear, self._bending])).to(u.dtype)
        matrix = stiffness.expand(len(u), 6, 6).clone()
        forces, moments = torch.zeros_like(u), torch.zeros_like(u)
        for index in range(2):
            offset = self._offsets[index].expand_as(u)
            tangent = torch.cross(u, offset, dim=1) + v
            tangent_hat, offset_hat = _skew(tangent), _skew(offset)
            size = torch.linalg.vector_norm(tangent, dim=1).reshape(-1, 1, 1)
            A = -tensions[:, index].reshape(-1, 1, 1) * torch.matmul(tangent_hat, tangent_hat) / size**3
            B = torch.matmul(offset_hat, A)
            matrix = matrix + torch.cat(
                [
                    torch.cat([A, -torch.matmul(A, offset_hat)], dim=2),
                    torch.cat([B, -torch.matmul(B, offset_hat)], dim=2),
                ],
                dim=1,
            )
            a = torch.matmul(A, torch.matmul(u_hat, tangent.unsqueeze(2))).squeeze(2)
            forces = forces - a
            moments = moments - torch.cross(offset, a, dim=1)
        moments = moments - torch.cross(u, self._bending.to(u.dtype) * u, dim=1)
        solved: Tensor = torch.linalg.solve(matrix, torch.cat([forces, moments], dim=1))
        return solved[:, 3:]

    def base(self, tensions: Tensor) -> tuple[Tensor, Tensor]:
        """Returns p(0) and theta(0), (n, 3) each, of tensions (n, 2)."""
        out = self._network.cross_sections(torch.cat([torch.zeros_like(tensions[:, :1]), tensions], dim=1))
        return out[:, 0:3], out[:, 3:6]

    def tip_moment(self, tensions: Tensor) -> Tensor:
        """Returns R (Kbt u - sum r_i x (-tau_i e3)) at the tip, (n, 3), N m, of tensions (n, 2)."""
        at_tip = torch.full_like(tensions[:, :1], self._length)
        out = self._network.cross_sections(torch.cat([at_tip, tensions], dim=1))
        pull = torch.zeros_like(out[:, 0:3])
        for index in range(2):
            force = torch.zeros_like(pull)
            force[:, 2] = -tensions[:, index]
            pull = pull + torch.cross(self._offsets[index].expand_as(pull), force, dim=1)
        moment = self._bending.to(out.dtype) * out[:, 6:9] - pull
        return torch.matmul(self._network.rotation(out[:, 3:6]), moment.unsqueeze(2)).squeeze(2)


def rotation_distance_loss(a: Tensor, b: Tensor) -> Tensor:
    """Mean angle between rotations (n, 3, 3), (20), by the clamped arc cosine of the trace as the authors have it."""
    trace = torch.einsum("nij,nij->n", a, b)
    return torch.acos(((trace - 1.0) / 2.0).clamp(-_COSINE_LIMIT, _COSINE_LIMIT)).mean()


class _Run:
    """The moving parts of a training: samples, optimiser, schedule, best weights."""

    def __init__(self, robot: RobotSpec, settings: TrainSettings, network: PaperNetwork) -> None:
        paper = settings.paper
        self.robot, self.settings, self.network = robot, settings, network
        self.physics = PhysicsLoss(robot, network)
        self.largest = network.largest * settings.domain.tension_share
        self.collocation = self._grid(*paper.grid)
        actuations = self._actuations(*paper.reference_grid)
        edge = self._actuations(paper.edge_actuations, 1)
        self.data = self._solve(torch.cat([actuations, edge, torch.zeros(1, 2)]))
        generator = np.random.default_rng([settings.seed, 1])
        angle = torch.as_tensor(generator.uniform(0.0, SECTOR, 64)).float()
        size = torch.as_tensor(generator.uniform(0.0, self.largest, 64)).float()
        self.validation = self._solve(network.tensions_in_sector(angle, size))
        self.steps = -(-len(self.collocation) // paper.batch_size)
        self.optimiser = torch.optim.AdamW(
            network.parameters(), lr=paper.learning_rate, weight_decay=paper.weight_decay
        )
        self.cycle = torch.optim.lr_scheduler.OneCycleLR(
            self.optimiser, paper.learning_rate, total_steps=max(2, min(paper.cycle_epochs, paper.epochs) * self.steps)
        )
        self.plateau = torch.optim.lr_scheduler.ReduceLROnPlateau(
            self.optimiser, factor=paper.plateau_factor, patience=paper.plateau_patience
        )
        self.epoch = 0
        self.best = float("inf")
        self.best_weights = copy.deepcopy(network.state_dict())

    def _actuations(self, directions: int, sizes: int) -> Tensor:
        angle = torch.linspace(0.0, SECTOR, directions)
        size = torch.linspace(0.1 * self.largest, self.largest, sizes) if sizes > 1 else torch.tensor([self.largest])
        angles, lengths = torch.meshgrid(angle, size, indexing="ij")
        return self.network.tensions_in_sector(angles.reshape(-1), lengths.reshape(-1)).float()

    def _grid(self, stops: int, directions: int, sizes: int) -> Tensor:
        tensions = self._actuations(directions, sizes)
        s = torch.linspace(0.0, self.network.length, stops)
        return torch.cat([s.repeat(len(tensions)).reshape(-1, 1), tensions.repeat_interleave(stops, dim=0)], dim=1)

    def _solve(self, pairs: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Returns rows (s, tau_1, tau_2), positions, rotations and curvatures of the reference at all disks."""
        order = np.argsort(np.mod(self.robot.tendon_angles, 2.0 * np.pi))
        tensions = np.zeros((len(pairs), 3))
        tensions[:, order[:2]] = pairs.numpy()
        solution = solve_statics(self.robot, np.maximum(tensions, 0.0))
        relative = np.swapaxes(solution.rotations[:, :-1], -1, -2) @ solution.rotations[:, 1:]
        vectors = Rotation.from_matrix(relative.reshape(-1, 3, 3)).as_rotvec().reshape(len(pairs), -1, 3)
        curvature = vectors / np.diff(solution.arc_lengths)[:, None]
        # The unloaded rod's curvature does not change along it: that of the gap before is that of the disk.
        curvature = np.concatenate([curvature[:, :1], curvature], axis=1)
        stops = torch.as_tensor(solution.arc_lengths).float()
        rows = torch.cat(
            [stops.repeat(len(pairs)).reshape(-1, 1), pairs.float().repeat_interleave(len(stops), dim=0)], dim=1
        )
        parts = (solution.positions.reshape(-1, 3), solution.rotations.reshape(-1, 3, 3), curvature.reshape(-1, 3))
        return (rows, *(torch.as_tensor(part).float() for part in parts))  # type: ignore[return-value]

    def train_epoch(self) -> float:
        """Goes once through the collocation points, part of them drawn around the worst; returns the mean loss."""
        paper = self.settings.paper
        generator = np.random.default_rng([self.settings.seed, 2, self.epoch])
        points = self._resample(generator)
        order = torch.from_numpy(generator.permutation(len(points)))
        total = 0.0
        for step in range(self.steps):
            rows = points[order[step * paper.batch_size : (step + 1) * paper.batch_size]]
            loss = self._loss(rows, generator)
            self.optimiser.zero_grad()
            loss.backward()
            self.optimiser.step()
            if self.epoch < paper.cycle_epochs:
                self.cycle.step()
            total += float(loss.detach())
        if self.epoch >= paper.cycle_epochs:
            self.plateau.step(total / self.steps)
        self.epoch += 1
        return total / self.steps

    def _resample(self, generator: np.random.Generator) -> Tensor:
        """Replaces a share of the grid by points drawn around those of largest residual."""
        paper = self.settings.paper
        redrawn = int(paper.redrawn_share * len(self.collocation))
        if self.epoch == 0 or redrawn == 0:
            return self.collocation
        with torch.no_grad():
            losses = torch.cat([self._point_loss(part) for part in self.collocation.split(4096)])
        centres = self.collocation[torch.topk(losses, min(paper.worst, len(losses))).indices]
        chosen = centres[torch.from_numpy(generator.integers(0, len(centres), redrawn))]
        spread = torch.tensor([paper.spread_arc_length_m, *[paper.spread_tension * self.largest] * 2])
        drawn = chosen + spread * torch.from_numpy(generator.normal(size=(redrawn, 3))).float()
        upper = torch.tensor([self.network.length, self.largest, self.largest])
        drawn = torch.minimum(drawn.clamp(min=0.0), upper)
        # The sector has the first tension above the second.
        pair = torch.stack([drawn[:, 1:].amax(dim=1), drawn[:, 1:].amin(dim=1)], dim=1)
        points = self.collocation.clone()
        places = torch.from_numpy(generator.permutation(len(points))[:redrawn])
        points[places] = torch.cat([drawn[:, :1], pair], dim=1)
        return points

    def _point_loss(self, rows: Tensor) -> Tensor:
        weights = self.settings.paper.weights
        position, rotation, curvature = self.physics.residuals(rows)
        return (
            weights.position_slope * position.square().mean(dim=1)
            + weights.rotation_slope * rotation.square().mean(dim=(1, 2))
            + weights.curvature_slope * curvature.square().mean(dim=1)
        )

    def _loss(self, rows: Tensor, generator: np.random.Generator) -> Tensor:
        paper, weights = self.settings.paper, self.settings.paper.weights
        base_position, base_rotation = self.physics.base(rows[:, 1:])
        loss = self._point_loss(rows).mean()
        loss = loss + weights.base_position * base_position.square().mean()
        loss = loss + weights.base_rotation * base_rotation.square().mean()
        loss = loss + weights.tip_moment * self.physics.tip_moment(rows[:, 1:]).square().mean()
        inputs, positions, rotations, curvatures = self.data
        chosen = torch.from_numpy(generator.integers(0, len(inputs), paper.data_batch))
        out = self.network.cross_sections(inputs[chosen])
        loss = loss + weights.position * (out[:, 0:3] - positions[chosen]).square().mean()
        loss = loss + weights.rotation * rotation_distance_loss(self.network.rotation(out[:, 3:6]), rotations[chosen])
        loss = loss + weights.curvature * (out[:, 6:9] - curvatures[chosen]).square().mean()
        return loss + weights.arc_length * self._arc_length_loss(rows[: paper.arc_actuations, 1:])

    def _arc_length_loss(self, pairs: Tensor) -> Tensor:
        """Mean squared difference between the length of the predicted backbone and the robot's, (21)."""
        points = self.settings.paper.arc_points
        s = torch.linspace(0.0, self.network.length, points)
        rows = torch.cat([s.repeat(len(pairs)).reshape(-1, 1), pairs.repeat_interleave(points, dim=0)], dim=1)
        positions = self.network.cross_sections(rows)[:, 0:3].reshape(len(pairs), points, 3)
        lengths = torch.linalg.vector_norm(positions.diff(dim=1), dim=2).sum(dim=1)
        return (lengths - self.network.length).square().mean()

    def validate(self) -> float:
        """Returns the mean position error on unseen actuations, m; keeps the best weights."""
        rows, positions, *_ = self.validation
        with torch.no_grad():
            out = self.network.cross_sections(rows)
        score = float(torch.linalg.vector_norm(out[:, 0:3] - positions, dim=1).mean())
        if score < self.best:
            self.best = score
            self.best_weights = copy.deepcopy(self.network.state_dict())
        return score

    def state(self) -> dict[str, Any]:
        """Returns all that a resumed training needs."""
        parts: dict[str, Callable[[], Any]] = {
            "network": self.network.state_dict,
            "optimiser": self.optimiser.state_dict,
            "cycle": self.cycle.state_dict,
            "plateau": self.plateau.state_dict,
        }
        content = {name: read() for name, read in parts.items()}
        return content | {"epoch": self.epoch, "best": self.best, "best_weights": self.best_weights}

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on where `state` was taken."""
        self.epoch, self.best, self.best_weights = state["epoch"], state["best"], state["best_weights"]
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.cycle.load_state_dict(state["cycle"])
        self.plateau.load_state_dict(state["plateau"])


def _skew(vector: Tensor) -> Tensor:
    zero = torch.zeros_like(vector[:, 0])
    x, y, z = vector[:, 0], vector[:, 1], vector[:, 2]
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
