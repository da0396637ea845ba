"""Fitting the reference by way of the arcs, which are a hundred times as quick and nearly right."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.fit import Fit, Progress, fit_bench
from tdcr_planner.calibration.forward import Forward
from tdcr_planner.calibration.parameters import Block

ROUNDS = 4
CHANGE = 2e-4
"""Change of the correction, 95 % of the states, in lengths of the robot, below which the fit has converged."""


def fit_reference(
    arcs: Forward,
    reference: Forward,
    bench: Bench,
    blocks: tuple[Block, ...],
    chosen: BoolArray,
    *,
    start: FloatArray | None = None,
    rounds: int = ROUNDS,
    progress: Progress = lambda _: None,
) -> Fit:
    """Returns the numbers under which the reference shows what was measured.

    The arcs, corrected by how much the reference differs from them at the numbers found last, are fitted in its place,
    and the correction is renewed until it stays (output space mapping: Bandler et al. 2004, sec. III; Koziel, Bandler
    and Madsen 2008). At the end predictions are the reference's; derivatives, and so standard errors, are the arcs'.

    Args:
        arcs: Predictions by arcs; its correction is renewed.
        reference: Predictions by the reference.
        bench: The bench as the robot's file has it.
        blocks: What to fit.
        chosen: Which states count, shape (n,).
        start: Numbers to start from; None for those of the file.
        rounds: Most corrections.
        progress: Called with a message as the fit goes on.
    """
    fit = fit_bench(arcs, bench, blocks, chosen, start=start, progress=progress)
    for _ in range(rounds):
        before = arcs.correction
        renew_correction(arcs, reference, fit.bench)
        change = float(np.quantile(np.linalg.norm(arcs.correction - before, axis=2), 0.95))
        progress(f"reference and arcs differ by {1e3 * change:.3g} mm more than before")
        fit = fit_bench(arcs, bench, blocks, chosen, start=fit.numbers, progress=progress)
        if change < CHANGE * bench.robot.length:
            break
    return fit


def renew_correction(arcs: Forward, reference: Forward, bench: Bench) -> None:
    """Sets the arcs' correction to what the reference differs by at a bench; 0 where the reference has no shape."""
    uncorrected = arcs.points(bench) - arcs.correction
    arcs.correction = np.nan_to_num(reference.points(bench) - uncorrected, nan=0.0)
