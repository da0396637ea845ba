"""Evaluating a finished model: errors by disk, by load and over the actuation plane, physics, and speed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.learning.dataset import (
    Cases,
    Progress,
    Sample,
    SolvedCases,
    draw_cases,
    no_progress,
    solve_cases,
)
from tdcr_planner.learning.judge import body_errors, measure_accuracy, position_errors
from tdcr_planner.learning.state_margin import Coverage, measure_coverage
from tdcr_planner.se3 import rotation_distance
from tdcr_planner.shape.card import Accuracy
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape
from tdcr_planner.shape.learned import LearnedShape
from tdcr_planner.statics.solver import solve_statics

LOAD_BINS = 4
_REFERENCE_CASES = 200


@dataclass(frozen=True)
class Timing:
    """Best time of several repeats, all in one run.

    Attributes:
        batch: Shapes a call.
        model_us: Microseconds a shape, poses ready for collision.
        reference_us: The same of the Cosserat reference.
    """

    batch: int
    model_us: float
    reference_us: float


@dataclass(frozen=True)
class Evaluation:
    """What was measured of a model.

    Attributes:
        accuracy: Errors on fresh cases of each sample.
        constant_curvature: Errors of the constant-curvature baseline on the same uniform cases.
        coverage: Share of fresh cases of each sample inside the error bound at every disk: the one that the model
            states, by state or uniform.
        margin: The coverage of a bound that follows the state, with its deciles, of each sample; empty where the
            uniform one serves.
        solved: The uniform cases.
        errors: Position errors on them, shape (n, d), m.
        angles: Rotation errors on them, shape (n, d), rad.
        load_share: Load of each, as a share of the largest of the domain, shape (n,).
        by_load: Median and 99th percentile of the position error in each of equal bins of the load, shape (bins, 2), m.
        plane: Bending vectors of the first segment, shape (n, 2), N.
        arc_length_violation: Largest | |p'| - 1 | between neighbouring cross-sections; axial strain included.
        rotation_violation: Largest |R'R - I|.
        timings: Speed against the reference.
    """

    accuracy: tuple[Accuracy, ...]
    constant_curvature: Accuracy
    coverage: dict[str, float]
    margin: dict[str, Coverage]
    solved: SolvedCases
    errors: FloatArray
    angles: FloatArray
    load_share: FloatArray
    by_load: FloatArray
    plane: FloatArray
    arc_length_violation: float
    rotation_violation: float
    timings: tuple[Timing, ...]


def evaluate_model(
    model: LearnedShape, samples: int, *, seed: int = 0, threads: int = 1, progress: Progress = no_progress
) -> Evaluation:
    """Measures a model on fresh cases.

    Args:
        model: The model.
        samples: Cases of each sample.
        seed: Seed of the cases; any but the one of the training gives cases that the training has not seen.
        threads: Threads of the reference.
        progress: Called with stage, steps done, steps in all and a remark.
    """
    if samples < 10:
        raise InputError("samples", "10 or more", samples)
    robot, domain = model.card.robot, model.card.domain

    def predict(cases: Cases) -> tuple[FloatArray, FloatArray, FloatArray]:
        poses = model.disk_poses_unchecked(cases.tensions, cases.gravity, cases.tip_force)
        residual = np.full(len(cases), np.nan)
        if model.has_residual:
            residual = model.residual(cases.tensions, gravity=cases.gravity, tip_force=cases.tip_force)
        return poses.positions, poses.rotations, residual

    accuracy: list[Accuracy] = []
    coverage: dict[str, float] = {}
    margin: dict[str, Coverage] = {}
    kinds: tuple[Sample, ...] = ("planner", "uniform")
    for index, sample in enumerate(kinds):
        generator = np.random.default_rng([seed, 1000 + index])
        cases = draw_cases(robot, domain, sample, samples, generator)
        solved = solve_cases(robot, cases, threads=threads, progress=progress, stage=f"{sample} cases")
        accuracy.append(measure_accuracy(predict, sample, solved))
        positions, rotations, _ = predict(solved.cases)
        own = body_errors(robot, positions, rotations, solved)
        asked = solved.cases
        poses, bounds = model.poses_and_bounds(asked.tensions, asked.gravity, asked.tip_force)
        # A state that the model does not answer for has no bound.
        covered = measure_coverage(own[poses.solved], bounds[poses.solved] if bounds.ndim > 1 else bounds)
        coverage[sample] = covered.overall
        if model.bound_follows_state:
            margin[sample] = covered
    baseline = ConstantCurvatureShape(robot)

    def predict_arcs(cases: Cases) -> tuple[FloatArray, FloatArray, FloatArray]:
        poses = baseline.disk_poses(cases.tensions)
        return poses.positions, poses.rotations, np.full(len(cases), np.nan)

    errors = position_errors(positions, solved)
    load_share = _load_share(model, solved.cases)
    return Evaluation(
        accuracy=tuple(accuracy),
        constant_curvature=measure_accuracy(predict_arcs, "uniform", solved),
        coverage=coverage,
        margin=margin,
        solved=solved,
        errors=errors,
        angles=rotation_distance(rotations, solved.rotations),
        load_share=load_share,
        by_load=_errors_by_load(errors, load_share),
        plane=robot.bending_from_tensions(solved.cases.tensions)[:, 0],
        arc_length_violation=_arc_length_violation(model, solved.cases),
        rotation_violation=float(np.abs(np.swapaxes(rotations, -1, -2) @ rotations - np.eye(3)).max()),
        timings=measure_speed(model, solved.cases),
    )


def measure_speed(model: LearnedShape, cases: Cases, batches: tuple[int, ...] = (1000, 10, 1)) -> tuple[Timing, ...]:
    """Returns the time a shape of model and reference for several batch sizes, as the planner calls the model."""
    timings = []
    for batch in batches:
        rows = np.arange(batch) % len(cases)
        part = cases.take(rows)

        def ask(part: Cases = part) -> object:
            return model.disk_poses_unchecked(part.tensions, part.gravity, part.tip_force)

        few = part.take(slice(0, _REFERENCE_CASES))

        def solve(few: Cases = few) -> object:
            return solve_statics(model.card.robot, few.tensions, gravity=few.gravity, tip_force=few.tip_force)

        timings.append(Timing(batch, best_time(ask, 20) / batch * 1e6, best_time(solve, 3) / len(few) * 1e6))
    return tuple(timings)


def best_time(call: Callable[[], object], repeats: int) -> float:
    """Returns the shortest of several runs, s, after one to warm up."""
    call()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return min(times)


def _load_share(model: LearnedShape, cases: Cases) -> FloatArray:
    domain = model.card.domain
    parts = [np.zeros(len(cases))]
    for vectors, largest in ((cases.gravity, domain.gravity_m_s2), (cases.tip_force, domain.tip_force_n)):
        if largest > 0.0:
            parts.append(np.linalg.norm(vectors, axis=1) / largest)
    return np.asarray(np.mean(parts[1:] or parts, axis=0))


def _errors_by_load(errors: FloatArray, load_share: FloatArray) -> FloatArray:
    bins = np.minimum((load_share * LOAD_BINS).astype(int), LOAD_BINS - 1)
    rows = []
    for index in range(LOAD_BINS):
        part = errors[bins == index, 1:]
        rows.append([np.median(part), np.quantile(part, 0.99)] if part.size else [np.nan, np.nan])
    return np.array(rows)


def _arc_length_violation(model: LearnedShape, cases: Cases, stops: int = 2001) -> float:
    """Chords of a fine division of a few shapes; they fall short of the arc by (u h)^2 / 24, below 1e-7 here."""
    few = cases.take(slice(0, 20))
    if model.card.network == "shooting":
        arc_lengths = np.linspace(0.0, model.robot.length, stops)
        poses = model.poses_at(arc_lengths, few.tensions, gravity=few.gravity, tip_force=few.tip_force)
        spacing = np.diff(arc_lengths)
    else:
        poses = model.disk_poses_unchecked(few.tensions, few.gravity, few.tip_force)
        spacing = np.diff(model.robot.arc_lengths)
    chords = np.linalg.norm(np.diff(poses.positions, axis=1), axis=2)
    return float(np.abs(chords / spacing - 1.0).max())
