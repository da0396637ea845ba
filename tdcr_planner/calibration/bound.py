"""An error bound from measured states that a fit has not seen: conformal at tracked points, grown to all disks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.forward import Forward

LEVEL = 0.95
_STEP_M, _STEP_N = 1e-4, 1e-2


def conformal_quantile(errors: FloatArray, level: float) -> float:
    """Returns the ceil((n + 1) level)-th smallest of n errors; infinite where n is too small for the level.

    A further error of the same distribution is at or below it with at least the probability `level` (Vovk, Gammerman
    and Shafer 2005, prop. 2.3; Lei et al. 2018, theorem 2.2 for the split form).

    Args:
        errors: Shape (n,).
        level: Between 0 and 1.
    """
    rank = math.ceil((len(errors) + 1) * level - 1e-9)
    return math.inf if rank > len(errors) else float(np.sort(errors)[rank - 1])


def disk_sensitivity(forward: Forward, bench: Bench) -> FloatArray:
    """Returns how far each disk moves with the actuation, root mean square over states and tendons, shape (d,).

    In m per m of displacement, or per N of tension; only ratios between disks are meant.

    Args:
        forward: What predicts the shapes.
        bench: The robot on its bench.
    """
    base = forward.shapes(bench).positions
    total = np.zeros(base.shape[1])
    for tendon in range(bench.robot.tendon_count):
        moved = _with_actuation(bench, tendon)
        change = forward.shapes(moved, keep=False).positions - base
        total += np.nanmean(np.sum(change**2, axis=2), axis=0)
    return np.sqrt(total)


def _with_actuation(bench: Bench, tendon: int) -> Bench:
    unit = np.eye(bench.robot.tendon_count)[tendon]
    if bench.drives_displacement:
        return replace(bench, zeros=bench.zeros + _STEP_M * unit)
    return replace(bench, pretension_shift=bench.pretension_shift + _STEP_N * unit)


def bound_per_disk(forward: Forward, bench: Bench, errors: FloatArray, level: float = LEVEL) -> FloatArray:
    """Returns the distance within which each disk of a further state lies with the stated probability, shape (d,), m.

    At tracked points it is the conformal quantile of the errors. From there it falls to the base, where it is 0, as
    the sensitivity of the shape to the actuation does; each disk takes it from the nearest tracked point beyond.

    Args:
        forward: What predicts the shapes.
        bench: The calibrated robot on its bench.
        errors: Distance between predicted and measured points of held-out states, shape (n, k), m, NaN if not seen.
        level: Probability.
    """
    sensitivity = disk_sensitivity(forward, bench)
    disks = np.where(forward.states.points < 0, len(sensitivity) - 1, forward.states.points)
    bound = np.zeros(len(sensitivity))
    for disk in range(1, len(sensitivity)):
        beyond = [index for index in range(len(disks)) if disks[index] >= disk]
        nearest = min(disks[index] for index in beyond) if beyond else disks.max()
        at = [index for index in range(len(disks)) if disks[index] == nearest]
        quantile = max(conformal_quantile(errors[np.isfinite(errors[:, index]), index], level) for index in at)
        bound[disk] = quantile * sensitivity[disk] / sensitivity[nearest]
    return np.maximum.accumulate(bound)
