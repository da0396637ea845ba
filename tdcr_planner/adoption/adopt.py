"""Adopting a network: found, checked, measured against the reference, bounded, and written as a model file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tdcr_planner.adoption.discovery import Found, Given, find_convention
from tdcr_planner.adoption.faults import check_faults
from tdcr_planner.adoption.mistakes import explain_error
from tdcr_planner.adoption.write import write_adopted
from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.files import sha256_of_file
from tdcr_planner.learning.dataset import Cases, Progress, Sample, SolvedCases, draw_cases, no_progress, solve_cases
from tdcr_planner.learning.evaluate import best_time
from tdcr_planner.learning.export import UNITS, library_versions
from tdcr_planner.learning.fitness import FIT_IN_RADII
from tdcr_planner.learning.judge import body_errors, calibrate_bound, measure_accuracy
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.learning.state_margin import calibrate_state_margin, cases_needed
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import CARD_FORMAT, Adoption, Domain, ErrorBound, ModelCard
from tdcr_planner.shape.foreign_network import ForeignNetwork, load_network
from tdcr_planner.shape.learned import LearnedShape
from tdcr_planner.shape.model_file import ModelFile
from tdcr_planner.statics.solver import solve_statics

_SAMPLES: tuple[Sample, ...] = ("planner", "uniform")
_DISCOVERY_CASES, _FAULT_CASES = 60, 200
_TIMED, _TIMED_REFERENCE = 1000, 200


@dataclass(frozen=True)
class AdoptSettings:
    """How a network is adopted.

    Attributes:
        given: What is known of its convention.
        domain: The inputs that it shall answer for; loads that it does not take are left out.
        correct: Whether one Newton step by mechanics is applied to its answers.
        alpha: Probability with which a fresh case may exceed each of the bounds.
        cases: Calibration cases of each sample.
        judged: Unseen cases of each sample for the card's accuracy.
        seed: Seed of all cases.
        threads: Threads of the reference.
    """

    given: Given = field(default_factory=Given)
    domain: DomainSettings = field(default_factory=DomainSettings)
    correct: bool = False
    alpha: float = 0.001
    cases: int = 8_000
    judged: int = 5_000
    seed: int = 0
    threads: int = 1

    def __post_init__(self) -> None:
        if not 1e-5 <= self.alpha <= 0.5:
            raise InputError("alpha", "a number from 1e-5 to 0.5", self.alpha)
        needed = cases_needed(self.alpha)
        if self.cases < needed:
            raise InputError("cases", f"at least {needed:,} for alpha = {self.alpha:g}", self.cases)


@dataclass(frozen=True)
class Adopted:
    """An adopted network.

    Attributes:
        card: Its card.
        cases: Unseen cases, uniform in its domain.
        errors: Its errors on them at the tip's disk, shape (n,), m.
        bounds: Its bounds there, shape (n,), m.
    """

    card: ModelCard
    cases: Cases
    errors: FloatArray
    bounds: FloatArray

    def describe_speed(self) -> str:
        """Returns how its speed compares with the reference's."""
        adoption = self.card.adoption
        assert adoption is not None  # an adopted network's card has it
        ratio = adoption.reference_us / adoption.shape_us
        if ratio < 1.0:
            return f"slower than the reference, {1.0 / ratio:.1f} times: plan with validity = 'reference' instead"
        return f"{ratio:.1f} times as fast as the reference, in batches of {_TIMED:,}"


def adopt(
    module: Path, robot: RobotSpec, out: Path, settings: AdoptSettings, *, progress: Progress = no_progress
) -> Adopted:
    """Adopts a network and writes its model file, whole or not at all.

    Args:
        module: A TorchScript archive (`.pt`) or an ONNX file (`.onnx`).
        robot: The robot whose shapes it gives.
        out: The model file.
        settings: How.
        progress: Called with stage, steps done, steps in all and a remark.

    Raises:
        FormatError: The file cannot be used; see `load_network`.
        InputError: The network does not fit the robot, cannot be planned with, or a mistake explains its error.
    """
    source = sha256_of_file(module)
    network = load_network(module)
    found = _convention(network, robot, settings, progress)
    domain = _domain(settings.domain.for_robot(robot), found)
    for sample in _SAMPLES:
        cases = _solved(robot, domain, sample, _FAULT_CASES, settings, 3000, progress)
        check_faults(network, robot, found.convention, cases)
    card = _first_card(module, source, network, robot, domain, found, settings)
    model = LearnedShape(module, ModelFile(card, None, {}, network.content), robot)
    card = _measured(model, card, settings, progress)
    judged = _solved(robot, domain, "uniform", settings.judged, settings, 5000, progress)
    planned = _solved(robot, domain, "planner", settings.judged, settings, 5001, progress)
    predict = _predict(model)
    accuracy = measure_accuracy(predict, "planner", planned), measure_accuracy(predict, "uniform", judged)
    card = card.model_copy(update={"accuracy": accuracy})
    if sha256_of_file(module) != source:
        raise FormatError(module, "changed while it was adopted; start again")
    write_adopted(out, card, network.content)
    bounded = LearnedShape(module, ModelFile(card, None, {}, network.content), robot)
    positions, rotations, _ = predict(judged.cases)
    bounds = bounded.error_bound_at(judged.cases.tensions, judged.cases.gravity, judged.cases.tip_force)
    errors = body_errors(robot, positions, rotations, judged)
    tip = np.broadcast_to(bounds, errors.shape)[:, -1]
    return Adopted(card, judged.cases, errors[:, -1], tip)


def _convention(network: ForeignNetwork, robot: RobotSpec, settings: AdoptSettings, progress: Progress) -> Found:
    """Returns the network's convention; refuses one whose error a mistake explains."""
    unloaded = settings.domain.for_robot(robot).model_copy(update={"gravity_m_s2": 0.0, "tip_force_n": 0.0})
    solved = _solved(robot, unloaded, "planner", _DISCOVERY_CASES, settings, 4000, progress)
    found = find_convention(network, robot, settings.given, solved)
    if found.error > FIT_IN_RADII * float(robot.disk_radii[-1]):
        reasons = explain_error(network, robot, found, solved)
        if reasons:
            raise InputError(
                "convention",
                "the one that the network was trained in",
                f"an error of {1e3 * found.error:.3g} mm at the tip in the median, which would be explained by "
                + ", or by ".join(reasons[:3]),
            )
    return found


def _domain(domain: Domain, found: Found) -> Domain:
    """Returns a domain without the loads that the network does not take."""
    inputs = found.convention.inputs
    changes: dict[str, float] = {}
    if "gravity" not in inputs:
        changes["gravity_m_s2"] = 0.0
    if "tip_force" not in inputs:
        changes["tip_force_n"] = 0.0
    return domain.model_copy(update=changes)


def _solved(
    robot: RobotSpec,
    domain: Domain,
    sample: Sample,
    count: int,
    settings: AdoptSettings,
    stream: int,
    progress: Progress,
) -> SolvedCases:
    generator = np.random.default_rng([settings.seed, stream])
    cases = draw_cases(robot, domain, sample, count, generator)
    return solve_cases(robot, cases, threads=settings.threads, progress=progress, stage=f"{sample} cases")


def _first_card(
    module: Path,
    source: str,
    network: ForeignNetwork,
    robot: RobotSpec,
    domain: Domain,
    found: Found,
    settings: AdoptSettings,
) -> ModelCard:
    """Returns the card with all that is known before anything is measured."""
    adoption = Adoption(
        kind=network.kind,
        source=module.name,
        source_sha256=source,
        module_sha256=hashlib.sha256(network.content).hexdigest(),
        convention=found.convention,
        correct=settings.correct,
        shape_us=1.0,
        reference_us=1.0,
    )
    return ModelCard(
        format=CARD_FORMAT,
        network="adopted",
        robot=robot,
        robot_mechanics_hash=robot.mechanics_hash,
        units=UNITS,
        domain=domain,
        disk_arc_lengths_m=tuple(float(s) for s in robot.arc_lengths),
        training={"adopted": module.name, "seed": settings.seed},
        accuracy=(),
        error_bound=ErrorBound(alpha=settings.alpha, cases=1, disk_m=(0.0,) * robot.disk_count, residual_limit_nm=None),
        adoption=adoption,
        libraries=library_versions(),
    )


def _predict(model: LearnedShape):  # type: ignore[no-untyped-def]
    def predict(cases: Cases) -> tuple[FloatArray, FloatArray, FloatArray]:
        answer = model.answer(cases.tensions, cases.gravity, cases.tip_force, with_scale=False)
        residual = np.full(len(cases), np.nan) if answer.residual is None else answer.residual
        return answer.positions, answer.rotations, residual

    return predict


def _measured(model: LearnedShape, card: ModelCard, settings: AdoptSettings, progress: Progress) -> ModelCard:
    """Returns the card with bounds, calibrated on cases of both samples, and speed."""
    robot = card.robot
    samples = [
        _solved(robot, card.domain, sample, settings.cases, settings, 1000 + index, progress)
        for index, sample in enumerate(_SAMPLES)
    ]
    predict = _predict(model)

    def scales(cases: Cases) -> FloatArray:
        scale = model.answer(cases.tensions, cases.gravity, cases.tip_force, with_scale=True).scale
        assert scale is not None  # it was asked for
        return scale

    errors = []
    for solved in samples:
        positions, rotations, _ = predict(solved.cases)
        errors.append(body_errors(robot, positions, rotations, solved))
    part = samples[0].cases.take(np.arange(_TIMED) % len(samples[0].cases))
    few = part.take(slice(0, _TIMED_REFERENCE))
    shape_s = best_time(lambda: model.answer(part.tensions, part.gravity, part.tip_force, with_scale=False), 5)
    reference_s = best_time(lambda: solve_statics(robot, few.tensions, gravity=few.gravity, tip_force=few.tip_force), 2)
    assert card.adoption is not None  # an adopted network's card has it
    speed = {"shape_us": 1e6 * shape_s / len(part), "reference_us": 1e6 * reference_s / len(few)}
    return card.model_copy(
        update={
            "error_bound": calibrate_bound(robot, predict, samples, settings.alpha),
            "state_margin": calibrate_state_margin(scales, samples, errors, settings.alpha),
            "adoption": card.adoption.model_copy(update=speed),
        }
    )
