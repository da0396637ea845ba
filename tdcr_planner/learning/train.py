"""Training: from a robot and settings to a shape model on disk, resumable at every epoch."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tdcr_planner.arrays import FloatArray
from tdcr_planner.files import sha256_of_json
from tdcr_planner.learning.checkpoint import checkpoint_path, load_checkpoint, optimiser_like, save_checkpoint
from tdcr_planner.learning.dataset import (
    Cases,
    Progress,
    Sample,
    SolvedCases,
    draw_cases,
    draw_mixture,
    no_progress,
    solve_cases,
)
from tdcr_planner.learning.export import UNITS, library_versions, write_model
from tdcr_planner.learning.judge import Predict, calibrate_bound, measure_accuracy
from tdcr_planner.learning.loads import check_domain
from tdcr_planner.learning.logs import TrainingLog
from tdcr_planner.learning.losses import physics_loss, reference_loss
from tdcr_planner.learning.settings import TrainSettings
from tdcr_planner.robot import RobotSpec, refuse_unknown
from tdcr_planner.shape.card import CARD_FORMAT, Calibration, ModelCard
from tdcr_planner.shape.learned import load_shape_model
from tdcr_planner.shape.rod_kernel import RodConstants, rod_constants, tip_residual, tip_residual_jacobian
from tdcr_planner.shape.shooting import ShootingFunction
from tdcr_planner.shape.shooting_network import ShootingNetwork, learned_weights
from tdcr_planner.workers import Backend

# Seeds of the independent random streams of a training.
_TRAINING, _VALIDATION, _CALIBRATION, _TEST = range(4)


@dataclass(frozen=True)
class TrainingData:
    """What the `shooting` network learns from.

    Attributes:
        cases: Training inputs.
        label: The reference's base moments, shape (n, 3), N m; empty without a reference loss.
        jacobian: dM(l)/dM(0) at the reference's shapes, shape (n, 3, 3); empty without a reference loss.
        validation: Inputs on which the best epoch is chosen, by the residual of the cut form.
    """

    cases: Cases
    label: FloatArray
    jacobian: FloatArray
    validation: Cases


def train_model(
    robot: RobotSpec,
    settings: TrainSettings,
    out: Path,
    *,
    progress: Progress = no_progress,
    log_folder: Path | None = None,
    calibration: Calibration | None = None,
    backend: Backend | None = None,
) -> ModelCard:
    """Trains a model, judges it on unseen cases, and writes it with its card.

    A checkpoint beside `out` is written after every epoch; a training that finds one of the same robot and settings
    goes on there and ends with the same weights as one that was never interrupted. It is removed at the end.

    Args:
        robot: The robot.
        settings: What train.toml says.
        out: The model file.
        progress: Called with stage, steps done, steps in all and a remark.
        log_folder: Where to write TensorBoard logs; None for none.
        calibration: What measured shapes said about the robot, for the card.
        backend: Where the reference solves the cases; None for this process.

    Returns:
        The card of the model.

    Raises:
        InputError: The domain's loads are beyond what the robot carries, or it has what learned models do not know.
        FormatError: A file cannot be written, or the checkpoint belongs to another robot or other settings.
        WorkersError: The backend's workers are gone.
    """
    refuse_unknown(robot, (), "the learned model")
    settings = settings.for_robot(robot)
    check_domain(robot, settings.domain.for_robot(robot))
    if settings.network == "paper":
        from tdcr_planner.learning.paper import train_paper_network

        network: nn.Module = train_paper_network(robot, settings, out, progress=progress, log_folder=log_folder)
        weights = None
        predict = _torch_predictor(network)
    else:
        network = train_shooting_network(
            robot, settings, out, progress=progress, log_folder=log_folder, backend=backend
        )
        weights = learned_weights(network)
        predict = _compiled_predictor(ShootingFunction(rod_constants(robot), weights))
    card = judge_model(robot, settings, predict, progress=progress, calibration=calibration, backend=backend)
    write_model(out, network, card, weights)
    checkpoint_path(out).unlink(missing_ok=True)
    return card


def train_shooting_network(
    robot: RobotSpec,
    settings: TrainSettings,
    out: Path,
    *,
    progress: Progress = no_progress,
    log_folder: Path | None = None,
    backend: Backend | None = None,
) -> ShootingNetwork:
    """Returns the `shooting` network of the best epoch; see `train_model`."""
    settings = settings.for_robot(robot)
    domain, shooting, epochs = settings.domain.for_robot(robot), settings.shooting, settings.optimiser.epochs
    assert shooting.corrections is not None  # for_robot has filled it in
    torch.manual_seed(settings.seed)
    network = ShootingNetwork(robot, shooting.hidden, shooting.corrections, domain.gravity_m_s2, domain.tip_force_n)
    if settings.measured is not None and settings.measured.start_from is not None:
        _copy_weights(settings.resolve(settings.measured.start_from), network)
    run = _Run(robot, settings, network, prepare_data(robot, settings, progress, backend))
    path = checkpoint_path(out)
    keys = robot.mechanics_hash, settings_hash(settings)
    state = load_checkpoint(path, *keys, run.state_like())
    if state is not None:
        run.restore(state)
    with TrainingLog(log_folder) as log:
        while run.epoch < epochs:
            loss = run.train_epoch()
            score = run.validate()
            save_checkpoint(path, *keys, run.state())
            progress("training", run.epoch, epochs, f"loss {loss:.2e}, residual {score:.2e} N m")
            log.add(run.epoch, {"loss": loss, "validation/residual_nm": score})
    network.load_state_dict(run.best_weights)
    return network.cpu()


def prepare_data(
    robot: RobotSpec, settings: TrainSettings, progress: Progress = no_progress, backend: Backend | None = None
) -> TrainingData:
    """Returns the inputs of a training, and the reference's answers where the loss asks for them."""
    settings = settings.for_robot(robot)
    dataset, domain = settings.dataset, settings.domain.for_robot(robot)
    share = dataset.planner_share
    cases = draw_mixture(robot, domain, share, dataset.cases, _generator(settings, _TRAINING))
    validation = draw_mixture(robot, domain, share, dataset.validation_cases, _generator(settings, _VALIDATION))
    if settings.loss.reference == 0.0:
        return TrainingData(cases, np.empty((0, 3)), np.empty((0, 3, 3)), validation)
    solved = solve_cases(
        robot, cases, threads=dataset.threads, backend=backend, progress=progress, stage="reference shapes"
    )
    inputs = solved.cases
    _, jacobian = tip_residual_jacobian(
        rod_constants(robot), inputs.tensions, inputs.gravity, inputs.tip_force, solved.base_moment
    )
    return TrainingData(inputs, solved.base_moment, jacobian, validation)


def judge_model(
    robot: RobotSpec,
    settings: TrainSettings,
    predict: Predict,
    *,
    progress: Progress = no_progress,
    calibration: Calibration | None = None,
    backend: Backend | None = None,
) -> ModelCard:
    """Returns the card of a trained model: its errors and its bound, each on cases that nothing else has seen."""
    settings = settings.for_robot(robot)
    domain = settings.domain.for_robot(robot)
    samples: dict[tuple[int, Sample], SolvedCases] = {}
    kinds: tuple[Sample, ...] = ("uniform", "planner")
    for stream in (_CALIBRATION, _TEST):
        for sample in kinds:
            generator = _generator(settings, stream)
            cases = draw_cases(robot, domain, sample, settings.bound.cases, generator)
            samples[stream, sample] = solve_cases(
                robot,
                cases,
                threads=settings.dataset.threads,
                backend=backend,
                progress=progress,
                stage=f"{sample} cases",
            )
    bound = calibrate_bound(
        robot, predict, [samples[_CALIBRATION, "uniform"], samples[_CALIBRATION, "planner"]], settings.bound.alpha
    )
    return ModelCard(
        format=CARD_FORMAT,
        network=settings.network,
        robot=robot,
        robot_mechanics_hash=robot.mechanics_hash,
        units=UNITS,
        domain=domain,
        disk_arc_lengths_m=tuple(float(s) for s in robot.arc_lengths),
        training=settings.model_dump(mode="json"),
        accuracy=tuple(measure_accuracy(predict, sample, samples[_TEST, sample]) for sample in ("uniform", "planner")),
        error_bound=bound,
        calibration=calibration,
        libraries=library_versions(),
    )


def settings_hash(settings: TrainSettings) -> str:
    """Returns a hash of all settings that decide the outcome of a training of the `shooting` network."""
    content = settings.model_dump(mode="json", exclude={"bound", "paper"})
    del content["dataset"]["threads"]
    return sha256_of_json(content)


class _Run:
    """The moving parts of a training: network, optimiser, schedule, and the best weights so far."""

    def __init__(self, robot: RobotSpec, settings: TrainSettings, network: ShootingNetwork, data: TrainingData) -> None:
        optimiser = settings.optimiser
        self.constants: RodConstants = rod_constants(robot)
        self.settings = settings
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.network = network.to(self.device)
        self.data = data
        self.inputs = self._tensors(data.cases)
        self.validation_inputs = self._tensors(data.validation)
        self.label = torch.as_tensor(data.label, device=self.device)
        self.jacobian = torch.as_tensor(data.jacobian, device=self.device)
        largest = float(network.load_scale.max())
        self.scale = largest if largest > 0.0 else 1.0
        self.batch = min(optimiser.batch_size, len(data.cases))
        self.steps = len(data.cases) // self.batch
        self.optimiser = torch.optim.AdamW(
            network.parameters(), lr=optimiser.learning_rate, weight_decay=optimiser.weight_decay
        )
        self.schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimiser,
            optimiser.learning_rate,
            total_steps=max(2, optimiser.epochs * self.steps),
            pct_start=optimiser.warm_up,
            final_div_factor=1e3,
        )
        self.epoch = 0
        self.best = float("inf")
        self.best_weights = copy.deepcopy(network.state_dict())

    def _tensors(self, cases: Cases) -> tuple[Tensor, Tensor, Tensor]:
        return tuple(  # type: ignore[return-value]
            torch.as_tensor(array, dtype=torch.float32, device=self.device)
            for array in (cases.tensions, cases.gravity, cases.tip_force)
        )

    def train_epoch(self) -> float:
        """Goes once through the cases, in an order that seed and epoch decide; returns the mean loss."""
        order = torch.from_numpy(_generator(self.settings, _TRAINING, self.epoch + 1).permutation(len(self.data.cases)))
        total = 0.0
        for step in range(self.steps):
            rows = order[step * self.batch : (step + 1) * self.batch]
            loss = self._loss(rows)
            self.optimiser.zero_grad()
            loss.backward()
            self.optimiser.step()
            self.schedule.step()
            total += float(loss.detach())
        self.epoch += 1
        return total / self.steps

    def _loss(self, rows: Tensor) -> Tensor:
        weights = self.settings.loss
        chosen = rows.to(self.device)
        moment, inverse = self.network.base_moment(*(array[chosen] for array in self.inputs))
        loss = torch.zeros((), dtype=moment.dtype, device=self.device)
        if weights.reference > 0.0:
            loss = loss + weights.reference * reference_loss(
                moment, inverse, self.label[chosen], self.jacobian[chosen], self.scale, weights.inverse
            )
        if weights.physics > 0.0:
            cases = self.data.cases.take(rows.numpy())
            loss = loss + weights.physics * physics_loss(
                moment, inverse, self.constants, cases, self.scale, weights.inverse
            )
        return loss

    def validate(self) -> float:
        """Returns the root mean square residual of the cut form on the validation cases, N m; keeps the best."""
        cases = self.data.validation
        with torch.no_grad():
            predicted, inverse = (array.cpu().numpy() for array in self.network.base_moment(*self.validation_inputs))
        moment = predicted
        arguments = cases.tensions, cases.gravity, cases.tip_force
        for _ in range(self.network.corrections):
            residual = tip_residual(self.constants, *arguments, moment)
            moment = moment - np.einsum("nij,nj->ni", inverse, residual)
        residual = tip_residual(self.constants, *arguments, moment)
        score = float(np.sqrt((residual**2).sum(axis=1).mean()))
        if score < self.best:
            self.best = score
            self.best_weights = copy.deepcopy(self.network.state_dict())
        return score

    def state(self) -> dict[str, Any]:
        """Returns all that a resumed training needs."""
        return {
            "epoch": self.epoch,
            "best": self.best,
            "network": self.network.state_dict(),
            "best_weights": self.best_weights,
            "optimiser": self.optimiser.state_dict(),
            "schedule": self.schedule.state_dict(),
        }

    def state_like(self) -> dict[str, Any]:
        """Returns what `state` looks like after an epoch, for `check_like`."""
        return {**self.state(), "optimiser": optimiser_like(self.optimiser)}

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on where `state` was taken."""
        self.epoch, self.best = state["epoch"], state["best"]
        self.network.load_state_dict(state["network"])
        self.best_weights = state["best_weights"]
        self.optimiser.load_state_dict(state["optimiser"])
        self.schedule.load_state_dict(state["schedule"])


def _generator(settings: TrainSettings, *stream: int) -> np.random.Generator:
    return np.random.default_rng([settings.seed, *stream])


def _compiled_predictor(function: ShootingFunction) -> Predict:
    def predict(cases: Cases) -> tuple[FloatArray, FloatArray, FloatArray]:
        return function(cases.tensions, cases.gravity, cases.tip_force)

    return predict


def _torch_predictor(network: nn.Module) -> Predict:
    def predict(cases: Cases) -> tuple[FloatArray, FloatArray, FloatArray]:
        arrays = (cases.tensions, cases.gravity, cases.tip_force)
        inputs = (torch.as_tensor(np.require(array, requirements="W")) for array in arrays)
        with torch.no_grad():
            positions, rotations = network(*inputs)
        return positions.numpy(), rotations.numpy(), np.full(len(cases), np.nan)

    return predict


def _copy_weights(path: Path, network: ShootingNetwork) -> None:
    """Starts from the learned layers of another model; what the robot decides stays this robot's."""
    module = load_shape_model(path).torch_module
    learned = {name: value for name, value in module.state_dict().items() if name.startswith(("layers.", "head."))}
    mine = network.state_dict()
    mismatch = [name for name in learned if name not in mine or mine[name].shape != learned[name].shape]
    if mismatch or not learned:
        from tdcr_planner.errors import FormatError

        raise FormatError(path, "its network has other layers than [shooting] asks for", "measured.start_from")
    network.load_state_dict({**mine, **learned})
