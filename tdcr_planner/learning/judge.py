"""Judging a model against the reference: its errors on unseen cases, and the bound that covers them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import binom

from tdcr_planner.arrays import FloatArray
from tdcr_planner.learning.dataset import Cases, Sample, SolvedCases
from tdcr_planner.learning.settings import CONFIDENCE
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import rotation_distance
from tdcr_planner.shape.card import Accuracy, ErrorBound

Predict = Callable[[Cases], tuple[FloatArray, FloatArray, FloatArray]]
"""Cases to positions (n, d, 3) m, rotations (n, d, 3, 3) and residual of the cut form (n,) N m (NaN if unknown)."""


def position_errors(positions: FloatArray, solved: SolvedCases) -> FloatArray:
    """Returns the distance of each disk centre from the reference's, shape (n, d), m."""
    return np.linalg.norm(positions - solved.positions, axis=2)


def body_errors(robot: RobotSpec, positions: FloatArray, rotations: FloatArray, solved: SolvedCases) -> FloatArray:
    """Returns how far any point of each disk can be from where the reference has it, shape (n, d), m.

    Centre error plus disk radius times |R - R_ref|, the spectral norm: 2 sin(angle / 2).
    """
    chord = 2.0 * np.sin(0.5 * rotation_distance(rotations, solved.rotations))
    return np.asarray(position_errors(positions, solved) + robot.disk_radii * chord)


def measure_accuracy(predict: Predict, sample: Sample, solved: SolvedCases) -> Accuracy:
    """Returns the errors of a model on solved cases."""
    positions, rotations, residual = predict(solved.cases)
    distance = 1e3 * position_errors(positions, solved)
    angle = np.degrees(rotation_distance(rotations, solved.rotations))
    free, turned = distance[:, 1:], angle[:, 1:]
    overall = {
        "position_median_mm": float(np.median(free)),
        "position_p99_mm": float(np.quantile(free, 0.99)),
        "position_max_mm": float(free.max()),
        "rotation_median_deg": float(np.median(turned)),
        "rotation_p99_deg": float(np.quantile(turned, 0.99)),
        "rotation_max_deg": float(turned.max()),
    }
    if np.isfinite(residual).all():
        quantiles = float(np.median(residual)), float(np.quantile(residual, 0.99))
        overall |= dict(zip(("residual_median_nm", "residual_p99_nm"), quantiles, strict=True))
    return Accuracy(
        sample=sample,
        cases=len(solved.cases),
        position_median_mm=_tuple(np.median(distance, axis=0)),
        position_p99_mm=_tuple(np.quantile(distance, 0.99, axis=0)),
        position_max_mm=_tuple(distance.max(axis=0)),
        rotation_median_deg=_tuple(np.median(angle, axis=0)),
        rotation_max_deg=_tuple(angle.max(axis=0)),
        overall=overall,
    )


def conformal_bound(errors: FloatArray, alpha: float) -> FloatArray:
    """Returns a bound for every disk that a fresh case of the same distribution exceeds somewhere with at most alpha.

    Split conformal prediction (Vovk et al. 2005, ch. 4) with the score max_d error_d / scale_d, scale_d the 99th
    percentile of disk d. The score that fresh cases may reach is chosen such that the promise holds with 99 %
    confidence in the draw of the calibration cases (Vovk 2012, prop. 2a), not only on average over such draws.

    Args:
        errors: Shape (n, d), m, of cases that took no part in the training.
        alpha: Probability with which a fresh case may exceed the bound.

    Returns:
        Shape (d,), m.
    """
    beyond = int(binom.ppf(1.0 - CONFIDENCE, len(errors), alpha)) - 1
    if beyond < 0:
        raise ValueError(f"alpha = {alpha:g} needs more than {len(errors)} cases")
    scale = np.quantile(errors, 0.99, axis=0)
    counted = scale > 0.0
    scores = np.zeros(len(errors))
    if counted.any():
        scores = (errors[:, counted] / scale[counted]).max(axis=1)
    return np.asarray(scale * np.sort(scores)[-1 - beyond])


def calibrate_bound(robot: RobotSpec, predict: Predict, samples: list[SolvedCases], alpha: float) -> ErrorBound:
    """Returns the bound that holds for each of several samples by itself: the largest of theirs.

    Args:
        robot: The robot.
        predict: The model.
        samples: Calibration cases, one entry a distribution.
        alpha: Probability with which a fresh case may exceed the bound.
    """
    bounds, residuals = [], []
    for solved in samples:
        positions, rotations, residual = predict(solved.cases)
        bounds.append(conformal_bound(body_errors(robot, positions, rotations, solved), alpha))
        residuals.append(residual)
    largest = float(np.max(np.concatenate(residuals)))
    return ErrorBound(
        alpha=alpha,
        cases=min(len(solved.cases) for solved in samples),
        disk_m=_tuple(np.max(bounds, axis=0)),
        # Ten times the largest of the calibration: far outside what was seen, near a shape that is none.
        residual_limit_nm=10.0 * largest + 1e-9 if np.isfinite(largest) else None,
    )


def _tuple(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
