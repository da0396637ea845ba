"""Training of the published network: its loss and its schedule (Bensch et al. 2024)."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tdcr_planner.errors import InputError
from tdcr_planner.files import sha256_of_json
from tdcr_planner.learning.checkpoint import checkpoint_path, load_checkpoint, optimiser_like, save_checkpoint
from tdcr_planner.learning.dataset import Progress, no_progress
from tdcr_planner.learning.logs import TrainingLog
from tdcr_planner.learning.paper_physics import RodEquations, rotation_distance_loss
from tdcr_planner.learning.paper_points import PaperPoints, ReferencePoints
from tdcr_planner.learning.settings import TrainSettings
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.paper_network import PaperNetwork

# Epochs over which the authors average the loss that the plateau is judged by.
_AVERAGED_EPOCHS = 6


def train_paper_network(
    robot: RobotSpec,
    settings: TrainSettings,
    out: Path,
    *,
    progress: Progress = no_progress,
    log_folder: Path | None = None,
) -> PaperNetwork:
    """Returns the published network, trained by the published method.

    Args:
        robot: A robot of one segment with three tendons 120 degrees apart.
        settings: What train.toml says; the domain must be without loads, as the paper's is.
        out: The model file; the checkpoint stands beside it.
        progress: Called with stage, steps done, steps in all and a remark.
        log_folder: Where to write TensorBoard logs; None for none.

    Raises:
        InputError: The robot or the domain is not the paper's.
        FormatError: The checkpoint belongs to another robot or other settings.
    """
    paper, domain = settings.paper, settings.domain.for_robot(robot)
    if domain.tip_force_n > 0.0 or domain.gravity_m_s2 > 0.0:
        raise InputError(
            "domain",
            "gravity_m_s2 = 0 and tip_force_n = 0 for network `paper`, which knows no loads",
            f"gravity_m_s2 = {domain.gravity_m_s2:g}, tip_force_n = {domain.tip_force_n:g}",
        )
    torch.manual_seed(settings.seed)
    run = PaperTraining(robot, settings)
    path = checkpoint_path(out)
    content = {"seed": settings.seed, "domain": domain.model_dump(), "paper": paper.model_dump()}
    keys = robot.mechanics_hash, sha256_of_json(content)
    state = load_checkpoint(path, *keys, run.state_like())
    if state is not None:
        run.restore(state)
    with TrainingLog(log_folder) as log:
        while run.epoch < paper.epochs:
            loss = run.train_epoch()
            score = run.validate()
            save_checkpoint(path, *keys, run.state())
            progress("training", run.epoch, paper.epochs, f"loss {loss:.4g}, position {1e3 * score:.3f} mm")
            log.add(run.epoch, {"loss": loss, "validation/position_m": score})
    run.network.load_state_dict(run.best_weights)
    return run.network.cpu()


class PaperTraining:
    """The moving parts of a training: network, points, optimiser, schedule, best weights."""

    def __init__(self, robot: RobotSpec, settings: TrainSettings) -> None:
        """Draws the weights from torch's generator and solves the reference's shapes."""
        paper = settings.paper
        self.settings, self.robot = settings, robot
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        network = PaperNetwork(robot, paper.hidden)
        largest_force = network.largest * settings.domain.tension_share
        generator = np.random.default_rng([settings.seed, 1])
        self.points = PaperPoints(robot, network, paper, largest_force, generator)
        self.equations = RodEquations(robot, network).to(self.device)
        self.network = network
        self.training = {name: points.to(self.device) for name, points in self.points.training.items()}
        self.validation = self.points.validation.to(self.device)
        self.steps = -(-len(self.points.grid) // paper.batch_size)
        self.optimiser = torch.optim.AdamW(
            network.parameters(), lr=paper.learning_rate, weight_decay=paper.weight_decay
        )
        self.cycle = torch.optim.lr_scheduler.OneCycleLR(
            self.optimiser,
            paper.learning_rate,
            total_steps=paper.cycle_epochs * self.steps + 1,
            pct_start=paper.warm_up,
            div_factor=paper.first_divisor,
            final_div_factor=paper.last_divisor,
        )
        self.plateau = torch.optim.lr_scheduler.ReduceLROnPlateau(
            self.optimiser,
            factor=paper.plateau_factor,
            patience=paper.plateau_patience,
            cooldown=paper.plateau_cooldown,
        )
        self.epoch = 0
        self.losses: list[float] = []
        self.resampled = False
        self.best = float("inf")
        self.best_weights = copy.deepcopy(network.state_dict())

    def train_epoch(self) -> float:
        """Goes once through the collocation points; returns the mean loss."""
        paper = self.settings.paper
        generator = np.random.default_rng([self.settings.seed, 2, self.epoch])
        points = self._collocation(generator).to(self.device)
        order = torch.from_numpy(generator.permutation(len(points))).to(self.device)
        total = torch.zeros((), device=self.device)
        for step in range(self.steps):
            rows = points[order[step * paper.batch_size : (step + 1) * paper.batch_size]]
            loss = self.loss(rows, generator)
            self.optimiser.zero_grad()
            loss.backward()
            self.optimiser.step()
            if self.epoch < paper.plateau_from_epoch:
                self.cycle.step()
            total += loss.detach()
        mean = float(total) / self.steps
        self.losses = [*self.losses[1 - _AVERAGED_EPOCHS :], mean]
        if self.epoch >= paper.plateau_from_epoch:
            self.plateau.step(float(np.mean(self.losses)))
        self.epoch += 1
        return mean

    def _collocation(self, generator: np.random.Generator) -> Tensor:
        """Returns the grid, or, now and then but never twice in succession, points around the worst actuations."""
        drawn = generator.random() < self.settings.paper.resampling_probability
        self.resampled = bool(drawn and self.epoch > 0 and not self.resampled)
        if not self.resampled:
            return self.points.grid
        return self.points.resample(self._position_errors().cpu(), generator)

    def loss(self, rows: Tensor, generator: np.random.Generator) -> Tensor:
        """Returns the weighted sum of all parts of the loss.

        Args:
            rows: Collocation points, s (m), tau_1, tau_2 (N), shape (n, 3).
            generator: Decides which reference points take part.
        """
        weights = self.settings.paper.weights
        residuals = self.equations.residuals(rows)
        loss = weights.position_slope * residuals.position.square().mean()
        loss = loss + weights.rotation_slope * residuals.rotation.square().mean()
        loss = loss + weights.curvature_slope * residuals.curvature.square().mean()
        loss = loss + weights.strain_slope * residuals.strain.square().mean()
        chosen = {name: self._draw(name, points, generator) for name, points in self.training.items()}
        tensions = rows[:, 1:]
        base, tip = torch.zeros_like(rows[:, :1]), torch.full_like(rows[:, :1], self.network.length)
        # One pass through the network for all that needs no slope.
        parts = [torch.cat([base, tensions], dim=1), torch.cat([tip, tensions], dim=1)]
        parts += [self._along(tensions[: self.settings.paper.arc_actuations])]
        parts += [points.rows for points in chosen.values()]
        outputs = torch.split(self.network.cross_sections(torch.cat(parts)), [len(part) for part in parts])
        loss = loss + self._boundary_loss(outputs[0], outputs[1], tensions)
        loss = loss + weights.arc_length * self._arc_length_loss(outputs[2])
        for (name, points), out in zip(chosen.items(), outputs[3:], strict=True):
            loss = loss + self._reference_loss(name, points, out)
        return loss

    def _boundary_loss(self, base: Tensor, tip: Tensor, tensions: Tensor) -> Tensor:
        """Weighs the conditions at base and tip under the tensions of the collocation points."""
        weights, equations = self.settings.paper.weights, self.equations
        rotation = self.network.rotation(tip[:, 3:6])
        moment = equations.moment_of_tendons(rotation, tensions)
        loss = weights.base_position * base[:, 0:3].square().mean()
        loss = loss + weights.base_rotation * base[:, 3:6].square().mean()
        excess = equations.bending_moment(rotation, tip[:, 6:9]) - moment
        loss = loss + weights.tip_moment * excess.square().mean()
        at_base = moment / equations.bending.to(moment.dtype)
        return loss + weights.base_curvature * (at_base - base[:, 6:9]).square().mean()

    def _draw(self, name: str, points: ReferencePoints, generator: np.random.Generator) -> ReferencePoints:
        count = min(len(points), getattr(self.settings.paper.reference_batch, name))
        return points.take(torch.from_numpy(generator.choice(len(points), count, replace=False)).to(self.device))

    def _reference_loss(self, name: str, points: ReferencePoints, out: Tensor) -> Tensor:
        weights = getattr(self.settings.paper.weights, name)
        loss = weights.position * (out[:, 0:3] - points.positions).square().mean()
        if name == "at_base":
            loss = loss + weights.rotation * out[:, 3:6].square().mean()
        else:
            rotation = self.network.rotation(out[:, 3:6])
            loss = loss + weights.rotation * rotation_distance_loss(rotation, points.rotations)
        return loss + weights.curvature * (out[:, 6:9] - points.curvatures).square().mean()

    def _along(self, tensions: Tensor) -> Tensor:
        """Returns rows at even arc lengths of shapes, (n * arc_points, 3), of tensions (n, 2)."""
        points = self.settings.paper.arc_points
        s = torch.linspace(0.0, self.network.length, points, device=self.device)
        return torch.cat([s.repeat(len(tensions)).reshape(-1, 1), tensions.repeat_interleave(points, dim=0)], dim=1)

    def _arc_length_loss(self, out: Tensor) -> Tensor:
        """Mean squared difference between the length of the predicted backbones and the robot's, m^2."""
        positions = out[:, 0:3].reshape(-1, self.settings.paper.arc_points, 3)
        lengths = torch.linalg.vector_norm(positions.diff(dim=1), dim=2).sum(dim=1)
        return (lengths - self.network.length).square().mean()

    def _position_errors(self) -> Tensor:
        with torch.no_grad():
            out = self.network.cross_sections(self.validation.rows)
        return torch.linalg.vector_norm(out[:, 0:3] - self.validation.positions, dim=1)

    def validate(self) -> float:
        """Returns the mean position error on the validation points, m; keeps the best weights."""
        score = float(self._position_errors().mean())
        if score < self.best:
            self.best = score
            self.best_weights = copy.deepcopy(self.network.state_dict())
        return score

    def state(self) -> dict[str, Any]:
        """Returns all that a resumed training needs."""
        return {
            "epoch": self.epoch,
            "losses": self.losses,
            "resampled": self.resampled,
            "best": self.best,
            "best_weights": self.best_weights,
            "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "cycle": self.cycle.state_dict(),
            "plateau": self.plateau.state_dict(),
        }

    def state_like(self) -> dict[str, Any]:
        """Returns what `state` looks like after an epoch, for `check_like`."""
        return {**self.state(), "optimiser": optimiser_like(self.optimiser), "losses": [0.0]}

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on where `state` was taken."""
        self.epoch, self.losses, self.resampled = state["epoch"], state["losses"], state["resampled"]
        self.best, self.best_weights = state["best"], state["best_weights"]
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.cycle.load_state_dict(state["cycle"])
        self.plateau.load_state_dict(state["plateau"])
