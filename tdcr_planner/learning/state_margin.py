"""The bound that follows the state: calibrated by locally weighted split conformal prediction, and what it covers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.learning.dataset import Cases, Progress, Sample, SolvedCases, draw_cases, no_progress, solve_cases
from tdcr_planner.learning.judge import Predict, body_errors, conformal_bound
from tdcr_planner.learning.settings import CONFIDENCE
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import Domain, StateMargin
from tdcr_planner.shape.correction import Corrector
from tdcr_planner.workers import Backend

FLOOR_M = 1e-6
"""Smallest scale: three times the rounding of the compiled integration (docs/learning.md)."""
DECILES = 10

_BEYOND = 3.0  # times the largest bound of the calibration: corners of the domain are rarely drawn
_SPARE = 1.3  # cases beyond the fewest that a bound takes, so that not the very largest score decides

Scales = Callable[[Cases], FloatArray]
"""Cases to the scale of each disk, shape (n, d), m; see `LearnedShape.answer`."""


def cases_needed(alpha: float) -> int:
    """Returns the fewest cases of a sample that a bound which follows the state takes, at a level alpha."""
    # The largest of n errors bounds a part of alpha with confidence 1 - (1 - alpha)^n.
    return math.ceil(math.log(1.0 - CONFIDENCE) / math.log(1.0 - alpha)) + 1


def measure_state_margin(
    robot: RobotSpec,
    domain: Domain,
    predict: Predict,
    alpha: float,
    generator: np.random.Generator,
    *,
    threads: int = 1,
    backend: Backend | None = None,
    progress: Progress = no_progress,
) -> StateMargin:
    """Returns the bound that follows the state of a model whose answers are not corrected.

    Args:
        robot: The robot.
        domain: The model's domain.
        predict: The model.
        alpha: Probability with which a fresh case may exceed the bound.
        generator: Draws the cases.
        threads: Threads of the reference.
        backend: Where the reference runs instead; None for this process.
        progress: Called after each block of cases.
    """
    corrector = Corrector(robot)

    def scales(cases: Cases) -> FloatArray:
        positions, rotations, _ = predict(cases)
        step = corrector.correct(positions, cases.tensions, cases.gravity, cases.tip_force)
        return corrector.scale(positions, rotations, step)

    samples, errors = [], []
    kinds: tuple[Sample, ...] = ("planner", "uniform")
    for sample in kinds:
        cases = draw_cases(robot, domain, sample, math.ceil(_SPARE * cases_needed(alpha)), generator)
        solved = solve_cases(
            robot, cases, threads=threads, backend=backend, progress=progress, stage=f"{sample} cases of the margin"
        )
        positions, rotations, _ = predict(solved.cases)
        samples.append(solved)
        errors.append(body_errors(robot, positions, rotations, solved))
    return calibrate_state_margin(scales, samples, errors, alpha)


def calibrate_state_margin(
    scales: Scales, samples: list[SolvedCases], errors: list[FloatArray], alpha: float
) -> StateMargin:
    """Returns the bound that follows the state and holds for each of several samples by itself.

    The score of a case is its largest error over the disks, each divided by the state's scale at that disk (Lei et al.
    2018, sec. 5.2) and by the 99th percentile of that ratio. A state whose bound would be above three times
    that of every calibration case is none that the model answers for.

    Args:
        scales: The scale of a case.
        samples: Calibration cases, one entry a distribution.
        errors: The model's errors on them as `body_errors` has them, shape (n, d), m.
        alpha: Probability with which a fresh case may exceed the bound.
    """
    factors, own = [], []
    for solved, error in zip(samples, errors, strict=True):
        scale = scales(solved.cases) + FLOOR_M
        known = np.isfinite(scale).all(axis=1)
        factors.append(conformal_bound(error[known] / scale[known], alpha))
        own.append(scale[known])
    factor = np.max(factors, axis=0)
    # The scale estimates the error itself: less than it is not promised, whatever the calibration cases say.
    factor = np.where(factor > 0.0, np.maximum(factor, 1.0), 0.0)
    bounds = np.concatenate(own) * factor
    ceiling = _BEYOND * bounds.max(axis=0)
    tip = bounds[:, -1]
    return StateMargin(
        alpha=alpha,
        cases=min(len(solved.cases) for solved in samples),
        floor_m=FLOOR_M,
        factor=tuple(factor.tolist()),
        ceiling_m=tuple(ceiling.tolist()),
        tip_m=(float(np.median(tip)), float(tip.max())),
    )


@dataclass(frozen=True)
class Coverage:
    """What part of cases a bound covers at every disk.

    Attributes:
        cases: How many.
        overall: Of all of them.
        deciles: Of those in each decile of the tip's bound, the smallest first.
        median_tip_m: The median bound at the tip.
    """

    cases: int
    overall: float
    deciles: tuple[float, ...]
    median_tip_m: float


def measure_coverage(errors: FloatArray, bounds: FloatArray) -> Coverage:
    """Returns the coverage of bounds on fresh cases, over all and by deciles of the tip's bound.

    Args:
        errors: Shape (n, d), m, as `body_errors` has them.
        bounds: Shape (n, d), m, or (d,) where it is the same for all.
    """
    inside = np.asarray((errors <= bounds).all(axis=1))
    tip = np.broadcast_to(bounds, errors.shape)[:, -1]
    order = np.argsort(tip, kind="stable")
    deciles = tuple(float(inside[part].mean()) for part in np.array_split(order, DECILES))
    return Coverage(len(errors), float(inside.mean()), deciles, float(np.median(tip)))
