"""The card of a learned shape model: what it was made for, where it holds, and how far it can be trusted."""

from __future__ import annotations

import math
from textwrap import wrap
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from tdcr_planner.files import FileModel, NotNegative, Positive
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.convention import Convention

CARD_FORMAT = "tdcr-shape-model/1"


class Domain(FileModel):
    """The inputs that a model answers for: all tensions from 0 to their limit, loads in any direction.

    Attributes:
        max_tension_n: Largest tension of each tendon.
        gravity_m_s2: Largest gravity.
        tip_force_n: Largest tip force.
    """

    max_tension_n: tuple[Positive, ...]
    gravity_m_s2: NotNegative
    tip_force_n: NotNegative


class Accuracy(FileModel):
    """Errors against the reference on cases that took no part in the training; lists have one entry a disk.

    Attributes:
        sample: How the cases were drawn: "uniform" in the domain, or "planner" (tensions of least sum, full gravity).
        cases: How many.
        position_median_mm: Median position error.
        position_p99_mm: 99th percentile of the position error.
        position_max_mm: Largest position error.
        rotation_median_deg: Median rotation error.
        rotation_max_deg: Largest rotation error.
        overall: Over all disks but the base: the figures above and the residual of the cut form, by name.
    """

    sample: Literal["uniform", "planner"]
    cases: Annotated[int, Field(ge=1)]
    position_median_mm: tuple[float, ...]
    position_p99_mm: tuple[float, ...]
    position_max_mm: tuple[float, ...]
    rotation_median_deg: tuple[float, ...]
    rotation_max_deg: tuple[float, ...]
    overall: dict[str, float]


class ErrorBound(FileModel):
    """A bound on the error of every disk at once, by split conformal prediction (Vovk et al. 2005, ch. 4).

    Attributes:
        alpha: A fresh case of either sample exceeds the bound at some disk with at most this probability, with 99 %
            confidence.
        cases: Calibration cases of each sample; the larger of the two bounds is stated.
        disk_m: Bound of each disk: centre error plus disk radius times the rotation's chord.
        residual_limit_nm: A case that leaves a larger moment at the tip counts as not solved; None for no limit.
    """

    alpha: Annotated[float, Field(gt=0.0, lt=1.0)]
    cases: Annotated[int, Field(ge=1)]
    disk_m: tuple[NotNegative, ...]
    residual_limit_nm: Positive | None


class StateMargin(FileModel):
    """A bound that follows the state, by locally weighted split conformal prediction (Lei et al. 2018, sec. 5.2).

    The bound of disk d in a state is `factor[d]` times the state's scale at d: how far one step of correction by
    mechanics moves the disk, what a further step would move it, and `floor_m`. Where it would be above `ceiling_m`
    at a disk, the state is none that the model answers for.

    Attributes:
        alpha: A fresh case of either sample exceeds its bound at some disk with at most this probability, with 99 %
            confidence.
        cases: Calibration cases of each sample.
        floor_m: Smallest scale: the rounding of the integration.
        factor: Of each disk.
        ceiling_m: Of each disk: three times the largest bound among the calibration cases.
        tip_m: Median and largest bound at the tip on the calibration cases.
    """

    alpha: Annotated[float, Field(gt=0.0, lt=1.0)]
    cases: Annotated[int, Field(ge=1)]
    floor_m: Positive
    factor: tuple[NotNegative, ...]
    ceiling_m: tuple[NotNegative, ...]
    tip_m: tuple[NotNegative, NotNegative]


class Adoption(FileModel):
    """Where a foreign network comes from and how it is asked.

    Attributes:
        kind: What evaluates it.
        source: Name of its file.
        source_sha256: Hash of that file when it was adopted.
        module_sha256: Hash of the network as the model file holds it.
        convention: What it takes and gives.
        correct: Whether one Newton step by mechanics is applied to its answers.
        shape_us: Microseconds a shape when it was adopted, in batches of 1,000 on one thread.
        reference_us: The same of the reference.
    """

    kind: Literal["torchscript", "onnx"]
    source: str
    source_sha256: str
    module_sha256: str
    convention: Convention
    correct: bool = False
    shape_us: Positive
    reference_us: Positive


class Calibration(FileModel):
    """What measured shapes said about the robot that the model was made for.

    Attributes:
        measured_file: Name of the CSV file.
        shapes: How many measured shapes.
        stiffness_scale: Identified factor on Young's modulus of the robot file.
        rms_before_mm: Root mean square distance of the measured points from the shapes before.
        rms_after_mm: The same after.
    """

    measured_file: str
    shapes: Annotated[int, Field(ge=1)]
    stiffness_scale: Positive
    rms_before_mm: NotNegative
    rms_after_mm: NotNegative


class ModelCard(FileModel):
    """Everything a model file says about itself.

    Attributes:
        format: Version of the card.
        network: "shooting", "paper", or "adopted" for somebody else's.
        robot: The robot that the model was made for.
        robot_mechanics_hash: Its `RobotSpec.mechanics_hash`.
        units: Unit of each input and output.
        domain: Inputs that the model answers for.
        disk_arc_lengths_m: Arc length of each disk, base included.
        training: The settings that made it, as train.toml has them.
        accuracy: Errors on held-out cases.
        error_bound: Bound on the error of each disk.
        state_margin: The bound that follows the state; None where the uniform one serves.
        adoption: The foreign network; None for a network of this project.
        calibration: Measured shapes that were used, if any.
        libraries: Versions that made it.
    """

    format: Literal["tdcr-shape-model/1"]
    network: Literal["shooting", "paper", "adopted"]
    robot: RobotSpec
    robot_mechanics_hash: str
    units: dict[str, str]
    domain: Domain
    disk_arc_lengths_m: tuple[float, ...]
    training: dict[str, Any]
    accuracy: tuple[Accuracy, ...]
    error_bound: ErrorBound
    state_margin: StateMargin | None = None
    adoption: Adoption | None = None
    calibration: Calibration | None = None
    libraries: dict[str, str]

    @model_validator(mode="after")
    def _check_consistency(self) -> ModelCard:
        if self.robot.mechanics_hash != self.robot_mechanics_hash:
            raise ValueError("the robot in the card does not have the hash that the card states")
        if len(self.error_bound.disk_m) != self.robot.disk_count:
            raise ValueError(
                f"expected a bound for each of {self.robot.disk_count} disks, got {len(self.error_bound.disk_m)}"
            )
        margin = self.state_margin
        if margin is not None and {len(margin.factor), len(margin.ceiling_m)} != {self.robot.disk_count}:
            raise ValueError(f"state_margin: expected a factor and a ceiling for each of {self.robot.disk_count} disks")
        if (self.network == "adopted") != (self.adoption is not None):
            raise ValueError("adoption: expected for network 'adopted', and for no other")
        if self.adoption is not None and len(self.adoption.convention.tendon_order) != self.robot.tendon_count:
            raise ValueError(f"tendon_order: expected each of {self.robot.tendon_count} tendons once")
        if len(self.domain.max_tension_n) != self.robot.tendon_count:
            raise ValueError(
                f"expected a limit for each of {self.robot.tendon_count} tendons, got {len(self.domain.max_tension_n)}"
            )
        arc_lengths = [float(s) for s in self.robot.arc_lengths]
        if len(arc_lengths) != len(self.disk_arc_lengths_m) or not all(
            math.isclose(mine, theirs, rel_tol=1e-9, abs_tol=1e-12)
            for mine, theirs in zip(self.disk_arc_lengths_m, arc_lengths, strict=True)
        ):
            raise ValueError("disk_arc_lengths_m: expected the arc lengths of the robot's disks")
        return self

    def describe(self) -> str:
        """Returns the card for a terminal, with its errors as a table: median, 99th percentile and largest."""
        domain, bound = self.domain, self.error_bound
        lines = [
            f"shape model ({self.network}) of robot {self.robot.name!r}, mechanics {self.robot_mechanics_hash[:12]}",
            "domain: tensions from 0 to " + ", ".join(f"{limit:g}" for limit in domain.max_tension_n) + " N",
            f"  gravity to {domain.gravity_m_s2:g} m/s^2 and tip force to {domain.tip_force_n:g} N, in any direction",
        ]
        for accuracy in self.accuracy:
            title = f"errors on {accuracy.cases:,} unseen cases, {accuracy.sample}"
            lines.append(f"{title:<40}{'median':>12}{'99 %':>12}{'largest':>12}")
            for quantity, unit in (("position", "mm"), ("rotation", "deg"), ("residual", "nm")):
                values = [accuracy.overall.get(f"{quantity}_{which}_{unit}") for which in ("median", "p99", "max")]
                cells = "".join(f"{'-' if value is None else format(value, '.3g'):>12}" for value in values)
                lines.append(f"  {quantity + ' (' + ('N m' if unit == 'nm' else unit) + ')':<38}{cells}")
        lines += [
            f"error bound, exceeded by at most {bound.alpha:g} of cases:",
            f"  {1e3 * bound.disk_m[-1]:.3g} mm at the tip, {1e3 * max(bound.disk_m):.3g} mm at most",
        ]
        lines += self._describe_margin() + self._describe_adoption()
        measured = self.calibration
        if measured is not None:
            lines += [
                f"calibrated on {measured.shapes} measured shapes of {measured.measured_file}:",
                f"  stiffness times {measured.stiffness_scale:.4g}, "
                f"rms {measured.rms_before_mm:.3g} mm to {measured.rms_after_mm:.3g} mm",
            ]
        made = [f"{name} {version}" for name, version in self.libraries.items()]
        return "\n".join([*lines, *wrap("made with " + ", ".join(made), 79, subsequent_indent="  ")])

    def _describe_margin(self) -> list[str]:
        margin = self.state_margin
        if margin is None:
            return []
        median, largest = (1e3 * value for value in margin.tip_m)
        return [
            f"bound that follows the state, exceeded by at most {margin.alpha:g} of cases:",
            f"  at the tip {median:.3g} mm in the median, {largest:.3g} mm at most",
        ]

    def _describe_adoption(self) -> list[str]:
        adoption = self.adoption
        if adoption is None:
            return []
        corrected = "one Newton step by mechanics is applied" if adoption.correct else "as it is"
        return [
            f"adopted {adoption.kind} network of {adoption.source}, {corrected}",
            *(f"  {line}" for line in adoption.convention.describe().splitlines()),
            f"  {adoption.shape_us:.3g} us a shape in batches of 1,000, the reference {adoption.reference_us:.3g} us",
        ]
