"""The settings of a training: what train.toml may say."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PrivateAttr, model_validator

from tdcr_planner.bounds import CASES, EPOCHS, GRID, LEARNING_RATE, POINTS, PROCESSES, SEED
from tdcr_planner.files import FileModel, NotNegative, Positive, parse_table, read_toml
from tdcr_planner.learning.loads import tip_compliance
from tdcr_planner.robot import RobotSpec, refuse_unknown
from tdcr_planner.shape.card import Domain
from tdcr_planner.shape.shooting import MOST_CORRECTIONS, MOST_LAYERS, MOST_WIDTH

Cases = Annotated[int, AfterValidator(CASES.validate)]
Epochs = Annotated[int, AfterValidator(EPOCHS.validate)]
GridPoints = Annotated[int, AfterValidator(GRID.validate)]
LearningRate = Annotated[Positive, AfterValidator(LEARNING_RATE.validate)]
Points = Annotated[int, AfterValidator(POINTS.validate)]
Width = Annotated[int, Field(ge=1, le=MOST_WIDTH)]
Hidden = Annotated[tuple[Width, ...], Field(min_length=1, max_length=MOST_LAYERS - 1)]
CONFIDENCE = 0.99
"""With which the error bound holds, over the draw of its calibration cases."""
Share = Annotated[float, Field(ge=0.0, le=1.0)]


TIP_DEFLECTION = 0.1
"""Part of the robot's length by which the largest tip force moves the unactuated tip, where nothing else is said."""


class DomainSettings(FileModel):
    """The inputs that the model shall answer for.

    Attributes:
        tension_share: Part of each tendon's limit up to which the model is trained, above 0 to 1.
        gravity_m_s2: Largest gravity, in any direction; the default is the Earth's, at most 9.832, rounded up.
        tip_force_n: Largest tip force, in any direction; None for what `tip_deflection` says.
        tip_deflection: Part of the robot's length by which the largest tip force moves the unactuated tip, by the
            linear theory; None for `TIP_DEFLECTION`. Only without tip_force_n.
    """

    tension_share: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    gravity_m_s2: NotNegative = 10.0
    tip_force_n: NotNegative | None = None
    tip_deflection: Annotated[float, Field(ge=0.0, le=1.0)] | None = None

    @model_validator(mode="after")
    def _check_tip_force(self) -> DomainSettings:
        if self.tip_force_n is not None and self.tip_deflection is not None:
            raise ValueError("expected tip_force_n or tip_deflection, got both")
        return self

    def tip_force(self, robot: RobotSpec) -> float:
        """Returns the largest tip force for a robot, N, to two digits where it follows from the robot."""
        if self.tip_force_n is not None:
            return self.tip_force_n
        deflection = TIP_DEFLECTION if self.tip_deflection is None else self.tip_deflection
        return float(f"{deflection * robot.length / tip_compliance(robot):.1e}")

    def for_robot(self, robot: RobotSpec) -> Domain:
        """Returns the domain for a robot's tension limits and stiffness.

        Raises:
            InputError: The robot has what learned models do not know.
        """
        refuse_unknown(robot, (), "the learned model")
        return Domain(
            max_tension_n=tuple(float(limit) for limit in self.tension_share * robot.max_tensions),
            gravity_m_s2=self.gravity_m_s2,
            tip_force_n=self.tip_force(robot),
        )


class DatasetSettings(FileModel):
    """How many cases and how they are drawn.

    Attributes:
        cases: Training cases.
        validation_cases: Cases on which the best epoch is chosen.
        planner_share: Part of the cases drawn as the planner meets them (tensions of least sum); the rest is uniform.
        threads: Threads of the reference solver; the cases do not depend on it.
    """

    cases: Cases = 120_000
    validation_cases: Cases = 4_000
    planner_share: Share = 0.5
    threads: Annotated[int, AfterValidator(PROCESSES.validate)] = 2


class ShootingSettings(FileModel):
    """The `shooting` network.

    Attributes:
        hidden: Width of each hidden layer.
        corrections: Number of learned Newton steps; None for one a segment, up to `DEFAULT_CORRECTIONS`.
    """

    hidden: Hidden = (64, 64, 64)
    corrections: Annotated[int, Field(ge=0, le=MOST_CORRECTIONS)] | None = None


class OptimiserSettings(FileModel):
    """AdamW with a one-cycle learning rate.

    Attributes:
        epochs: Passes through the training cases.
        batch_size: Cases a step.
        learning_rate: Peak of the cycle.
        warm_up: Part of all steps in which the rate rises.
        weight_decay: AdamW's weight decay.
    """

    epochs: Epochs = 60
    batch_size: Cases = 1024
    learning_rate: LearningRate = 4e-3
    warm_up: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.15
    weight_decay: NotNegative = 1e-6


DEFAULT_CORRECTIONS = 3
"""Learned Newton steps of a robot of three segments or more, where nothing else is said; one a segment below."""


class LossSettings(FileModel):
    """Weights of the parts of the loss; a part of weight 0 is left out.

    Attributes:
        physics: Residual of the cut form, the moment left over at the tip; needs no labels.
        reference: Distance of the base moment from that of the reference solver.
        measured: Distance of the shapes from measured points; it decides how far the robot's stiffness may move from
            the robot file's, see `learning.fitting`.
        inverse: Factor on the inverse Jacobian's share in the first two parts.
    """

    physics: NotNegative = 0.1
    reference: NotNegative = 1.0
    measured: NotNegative = 0.0
    inverse: NotNegative = 0.01

    @model_validator(mode="after")
    def _check_any(self) -> LossSettings:
        if self.physics == 0.0 and self.reference == 0.0:
            raise ValueError("expected physics or reference above 0: nothing would be learned")
        return self


class MeasuredSettings(FileModel):
    """Measured shapes for fine-tuning.

    Attributes:
        file: The CSV; see `learning.measured.read_measured_shapes`.
        noise_m: Standard deviation of a measured coordinate.
        start_from: A model of this robot from which the weights start; None starts from nothing.
    """

    file: Path
    noise_m: Positive = 5e-4
    start_from: Path | None = None


class BoundSettings(FileModel):
    """The error bound by split conformal prediction.

    Attributes:
        alpha: Probability with which a fresh case may exceed it.
        cases: Calibration cases of each sample.
    """

    alpha: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.001
    cases: Cases = 20_000

    @model_validator(mode="after")
    def _check_cases(self) -> BoundSettings:
        # The largest of n errors bounds a share alpha with confidence 1 - (1 - alpha)^n.
        needed = math.ceil(math.log(1.0 - CONFIDENCE) / math.log(1.0 - self.alpha)) + 1
        if self.cases < needed:
            raise ValueError(f"alpha = {self.alpha:g} needs at least {needed} cases, got {self.cases}")
        return self


class ReferenceWeights(FileModel):
    """Weights of one set of reference points: squared position and curvature distance, and rotation.

    Attributes:
        position: Mean squared distance of the components of p.
        rotation: Mean rotation distance (20); at the base the mean square of the components of theta.
        curvature: Mean squared distance of the components of u.
    """

    position: NotNegative
    rotation: NotNegative
    curvature: NotNegative


class PaperWeights(FileModel):
    """Weights of the parts of the published loss; each part is a mean over points and components.

    The last five are the sets of reference points, see `PaperBatches`.

    Attributes:
        position_slope: p' = R e3 at the collocation points.
        rotation_slope: R' = R [u]x there.
        curvature_slope: u' as the balance of forces and moments has it (Rucker and Webster 2011, eq. 17).
        strain_slope: v' = 0 against the same balance.
        base_position: p(0) = 0 under the tensions of the collocation points.
        base_rotation: theta(0) = 0 likewise.
        tip_moment: Constitutive law and tendons' moment agree at the tip.
        base_curvature: u(0) is what the moment at the tip, there being no loads, gives at the base.
        arc_length: Length of the backbone.
        at_base: Reference points at s = 0.
        between: Reference points at the disks between.
        at_tip: Reference points at s = l.
        largest_force: Reference points of the actuations of largest force, all disks.
        no_force: The straight robot.
    """

    position_slope: NotNegative = 1e4
    rotation_slope: NotNegative = 1e3
    curvature_slope: NotNegative = 1.0
    strain_slope: NotNegative = 1e7
    base_position: NotNegative = 1e7
    base_rotation: NotNegative = 1e3
    tip_moment: NotNegative = 1e8
    base_curvature: NotNegative = 1.0
    arc_length: NotNegative = 1e2
    at_base: ReferenceWeights = ReferenceWeights(position=1e7, rotation=1e3, curvature=1.0)
    between: ReferenceWeights = ReferenceWeights(position=1e7, rotation=1e2, curvature=1.0)
    at_tip: ReferenceWeights = ReferenceWeights(position=1e6, rotation=1e1, curvature=1.0)
    largest_force: ReferenceWeights = ReferenceWeights(position=1e6, rotation=1e1, curvature=1.0)
    no_force: ReferenceWeights = ReferenceWeights(position=1e7, rotation=1e1, curvature=1e1)


class PaperBatches(FileModel):
    """Reference points a step, of each set; `largest_force` and `no_force` hold all disks, the others part of them.

    Attributes:
        at_base: s = 0.
        between: The disks between.
        at_tip: s = l.
        largest_force: The largest force, all around the sector.
        no_force: The straight robot.
    """

    at_base: Points = 4
    between: Points = 76
    at_tip: Points = 4
    largest_force: Points = 168
    no_force: Points = 128


class PaperSettings(FileModel):
    """The published network and its training (Bensch et al. 2024), numbers as the authors' program has them.

    Attributes:
        hidden: Width of each hidden layer: the first with SiLU, the others with tanh.
        epochs: Epochs in all.
        learning_rate: Peak of the one-cycle rate.
        cycle_epochs: Length of the whole cycle.
        warm_up: Part of the cycle in which the rate rises.
        first_divisor: The rate begins at the peak over this.
        last_divisor: The cycle ends at the first rate over this.
        plateau_from_epoch: From here on the rate stays where the cycle left it, and falls on plateaus of the loss.
        plateau_factor: Factor on the rate when the loss has not fallen.
        plateau_patience: Epochs to wait for a fall.
        plateau_cooldown: Epochs after a fall of the rate in which the loss is not judged.
        weight_decay: AdamW's weight decay.
        grid: Points of the collocation grid along arc length, direction and force.
        batch_size: Collocation points a step.
        reference_grid: Directions and forces of the actuations with a reference shape.
        edge_actuations: Directions with a reference shape at the largest force.
        training_share: Part of the reference points that is trained on; the rest is for validation.
        reference_batch: Reference points a step.
        arc_points: Points by which the length of a predicted shape is measured.
        arc_actuations: Shapes a step whose length is measured: the first of the batch.
        resampling_probability: With which an epoch draws its collocation points around the worst actuations.
        worst_actuations: Actuations of largest error around which is drawn.
        worst_arc_lengths: Arc lengths of each around which is drawn.
        spread_arc_length_m: Standard deviation of those draws along the arc length.
        spread_tension_n: The same of each tension.
        weights: Weights of the parts of the loss.
    """

    hidden: Hidden = (100, 100, 100, 100)
    epochs: Epochs = 6070
    learning_rate: LearningRate = 1.5e-4
    cycle_epochs: Epochs = 1500
    warm_up: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.1
    first_divisor: Annotated[float, Field(ge=1.0)] = 10.0
    last_divisor: Annotated[float, Field(ge=1.0)] = 100.0
    plateau_from_epoch: Annotated[int, Field(ge=0)] = 450
    plateau_factor: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.9
    plateau_patience: Epochs = 20
    plateau_cooldown: Annotated[int, Field(ge=0)] = 10
    weight_decay: NotNegative = 0.01
    grid: tuple[GridPoints, GridPoints, GridPoints] = (32, 32, 32)
    batch_size: Points = 1024
    reference_grid: tuple[GridPoints, GridPoints] = (9, 9)
    edge_actuations: Points = 96
    training_share: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.7
    reference_batch: PaperBatches = PaperBatches()
    arc_points: Annotated[int, Field(ge=2, le=10_000)] = 200
    arc_actuations: Points = 1024
    resampling_probability: Share = 0.1
    worst_actuations: Points = 10
    worst_arc_lengths: Points = 10
    spread_arc_length_m: Positive = 0.0775
    spread_tension_n: Positive = 0.324
    weights: PaperWeights = PaperWeights()

    @model_validator(mode="after")
    def _check_cycle(self) -> PaperSettings:
        if self.plateau_from_epoch > self.cycle_epochs:
            raise ValueError(
                f"expected plateau_from_epoch at most cycle_epochs = {self.cycle_epochs}, got {self.plateau_from_epoch}"
            )
        return self


class TrainSettings(FileModel):
    """Everything that train.toml may say."""

    format: Literal["tdcr-train/1"] = "tdcr-train/1"
    network: Literal["shooting", "paper"] = "shooting"
    seed: Annotated[int, AfterValidator(SEED.validate)] = 1
    domain: DomainSettings = DomainSettings()
    dataset: DatasetSettings = DatasetSettings()
    shooting: ShootingSettings = ShootingSettings()
    optimiser: OptimiserSettings = OptimiserSettings()
    loss: LossSettings = LossSettings()
    measured: MeasuredSettings | None = None
    bound: BoundSettings = BoundSettings()
    paper: PaperSettings = PaperSettings()

    _folder: Path = PrivateAttr(default=Path())

    @model_validator(mode="after")
    def _check_measured(self) -> TrainSettings:
        if (self.measured is None) != (self.loss.measured == 0.0):
            raise ValueError("expected both a table [measured] and loss.measured above 0, or neither")
        return self

    def for_robot(self, robot: RobotSpec) -> TrainSettings:
        """Returns the settings with all that they leave to the robot filled in.

        The tip force follows from the robot's stiffness and length. With each segment the base moment depends on three
        more inputs, and the network's first guess gets worse; one learned Newton step a segment makes up for it, see
        docs/learning.md for the measurements.
        """
        corrections = self.shooting.corrections
        if corrections is None:
            corrections = min(robot.segment_count, DEFAULT_CORRECTIONS)
        domain = {"tip_force_n": self.domain.tip_force(robot), "tip_deflection": None}
        return self.model_copy(
            update={
                "domain": self.domain.model_copy(update=domain),
                "shooting": self.shooting.model_copy(update={"corrections": corrections}),
            }
        )

    def resolve(self, path: Path) -> Path:
        """Returns a path of this file as seen from where the program runs: relative ones start at the file's folder."""
        return path if path.is_absolute() else self._folder / path


def load_train_settings(path: str | Path | None) -> TrainSettings:
    """Returns the settings of a train.toml; None gives the defaults.

    Raises:
        FormatError: Names every unknown key or bad value and what would be valid.
    """
    if path is None:
        return TrainSettings()
    settings = parse_table(TrainSettings, read_toml(path), path)
    settings._folder = Path(path).parent
    return settings
