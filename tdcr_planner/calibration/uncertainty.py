"""What measurements say of each parameter: standard errors, correlations, and what they cannot tell apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.fit import OUTLIER, Fit, spreads_of

HARDLY_DETERMINED = 0.5
"""A parameter whose deviation the measurements leave above this fraction of the one before is not determined."""
ALIKE = 0.95
"""Parameters of a correlation beyond this are told apart badly."""
MAIN_COMPONENT = 0.25
"""Parameters count to a combination that nothing tells when they act by more than this fraction of the strongest."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How well each of k parameters is known.

    Attributes:
        deviations: Standard errors of the numbers, shape (k,).
        correlations: Shape (k, k).
        determined: Names of parameters; those that the measurements determine.
        undetermined: Those that they leave about as open as before.
        inseparable: Groups of parameters of which only a combination is determined.
        alike: Pairs that are told apart badly, with their correlation.
        inflation: Factor on the variance since what is left over is correlated from state to state.
    """

    deviations: FloatArray
    correlations: FloatArray
    determined: tuple[str, ...]
    undetermined: tuple[str, ...]
    inseparable: tuple[tuple[str, ...], ...]
    alike: tuple[tuple[str, str, float], ...]
    inflation: float


def assess_uncertainty(fit: Fit) -> Uncertainty:
    """Returns what a fit's measurements say of each parameter.

    The covariance is that of an M-estimator (Huber and Ronchetti 2009, eq. 7.43) with what was known before as a
    prior. What is left over is correlated from state to state where the model is not the robot; the variance is
    multiplied by the integrated autocorrelation, as if there were so many fewer states.
    """
    spreads = spreads_of(fit.blocks)
    labels = [parameter.label for parameter in fit.parameters]
    scaled = fit.jacobian * spreads
    inflation = autocorrelation_factor(fit)
    information = scaled.T @ scaled / (inflation * variance_factor(fit))
    covariance = np.linalg.inv(information + np.eye(len(spreads)))
    left = np.sqrt(np.diag(covariance))
    correlations = covariance / np.outer(left, left)
    undetermined = tuple(label for label, value in zip(labels, left, strict=True) if value > HARDLY_DETERMINED)
    determined = tuple(label for label in labels if label not in undetermined)
    pairs = [
        (labels[a], labels[b], float(correlations[a, b]))
        for a in range(len(labels))
        for b in range(a)
        if abs(correlations[a, b]) > ALIKE
    ]
    return Uncertainty(
        deviations=left * spreads,
        correlations=correlations,
        determined=determined,
        undetermined=undetermined,
        inseparable=find_inseparable(information, labels),
        alike=tuple(sorted(pairs, key=lambda pair: -abs(pair[2]))),
        inflation=inflation,
    )


def find_inseparable(information: FloatArray, labels: list[str], *, below: float = 1.0) -> tuple[tuple[str, ...], ...]:
    """Returns groups of parameters of which the measurements tell a combination less than was known before.

    Args:
        information: Information of the measurements in units of what was known before, shape (k, k).
        labels: Names of the parameters.
        below: Information on a combination below which it counts as not told.
    """
    values, vectors = np.linalg.eigh(information)
    # What each parameter by itself would do to the measurements: in a combination that does nothing they cancel.
    actions = np.abs(vectors) * np.sqrt(np.diag(information))[:, None]
    groups = []
    for value, action in zip(values, actions.T, strict=True):
        main = [label for label, part in zip(labels, action, strict=True) if part > MAIN_COMPONENT * action.max()]
        if value < below and len(main) > 1:
            groups.append(tuple(main))
    return tuple(groups)


def variance_factor(fit: Fit) -> float:
    """Returns the variance of a residual as the robust loss counts it; 1 for normal noise of the stated deviation."""
    square = 1.0 + (fit.residuals / OUTLIER) ** 2
    freedom = max(len(fit.residuals) - len(fit.numbers), 1)
    influence = fit.residuals / np.sqrt(square)
    return float((influence @ influence / freedom) / np.mean(square**-1.5) ** 2)


def autocorrelation_factor(fit: Fit) -> float:
    """Returns by how much the correlation of what is left over, from state to state, multiplies the variance.

    It is 1 + 2 sum of autocorrelations up to the first that is not above what independent noise shows, over states
    that follow one another, averaged over the components.
    """
    components = np.unique(fit.rows[:, 1])
    series = [fit.residuals[fit.rows[:, 1] == component] for component in components]
    energy = sum(float(values @ values) for values in series)
    count = min(len(values) for values in series)
    floor = 2.0 / np.sqrt(max(sum(len(values) for values in series), 1))
    factor = 1.0
    for lag in range(1, max(count // 4, 1)):
        correlation = sum(float(values[lag:] @ values[:-lag]) for values in series) / max(energy, 1e-300)
        if correlation <= floor:
            break
        factor += 2.0 * correlation
    return factor
