"""Batches of cases in compiled code: each solved by itself, and solved ones integrated again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.branch import CONVERGED, LIMIT_POINT, NOT_CONVERGED, follow_branch, newton, smallest_level
from tdcr_planner.statics.cut_loads import LoadBatch, empty_loads, fill_loads
from tdcr_planner.statics.drive import GAP_TOLERANCE, DriveArrays, drive_newton, empty_state, follow_drive
from tdcr_planner.statics.integration import add_lengths, integrate
from tdcr_planner.statics.options import OPTIONS
from tdcr_planner.statics.rod import RodArrays
from tdcr_planner.statics.tension import fill_pulls, fill_tension, frictionless_tension
from tdcr_planner.statics.variations import variations


class BatchResults(NamedTuple):
    """Room for the results of n cases, as in `solver.RodSolution`.

    Attributes:
        positions: Shape (n, d, 3), m.
        rotations: Shape (n, d, 3, 3).
        base_moments: Shape (n, 3), N m.
        residuals: Shape (n,), N m.
        codes: Status codes, shape (n,).
        iterations: Shape (n,).
        fractions: Shape (n,).
    """

    positions: FloatArray
    rotations: FloatArray
    base_moments: FloatArray
    residuals: FloatArray
    codes: IntArray
    iterations: IntArray
    fractions: FloatArray


@njit(**OPTIONS)
def solve_cases(
    rod: RodArrays,
    tensions: FloatArray,
    batch: LoadBatch,
    guesses: FloatArray,
    warm: bool,
    tolerance: float,
    first_step: float,
    start: int,
    stop: int,
    results: BatchResults,
) -> None:
    """Solves the cases from start to stop for given tensions, each by itself, and writes its results."""
    loads, tension = empty_loads(rod), frictionless_tension(rod)
    for case in range(start, stop):
        scale = fill_loads(rod, batch, case, loads)
        fill_tension(rod, tensions[case], tension)
        level = smallest_level(rod, tolerance, scale)
        positions, rotations, moment = results.positions[case], results.rotations[case], guesses[case]
        done = False
        total = 0
        if warm and np.isfinite(moment[0] + moment[1] + moment[2]):
            converged, residual, total, stable, _ = newton(
                rod, loads, tension, moment, level, True, True, positions, rotations
            )
            if converged and stable:
                done = True
                for j in range(3):
                    results.base_moments[case, j] = moment[j]
                results.residuals[case] = residual
                results.codes[case] = CONVERGED
                results.fractions[case] = 1.0
        if not done:
            code, residual, made, fraction = follow_branch(
                rod, loads, tension, results.base_moments[case], level, first_step, positions, rotations
            )
            total += made
            results.codes[case] = code
            results.residuals[case] = residual
            results.fractions[case] = fraction
            if code in (LIMIT_POINT, NOT_CONVERGED):
                results.positions[case] = np.nan
                results.rotations[case] = np.nan
                results.base_moments[case] = np.nan
        results.iterations[case] = total


@njit(**OPTIONS)
def solve_drive_cases(
    rod: RodArrays,
    drive: DriveArrays,
    displacements: FloatArray,
    batch: LoadBatch,
    guesses: FloatArray,
    tensions: FloatArray,
    warm: bool,
    tolerance: float,
    first_step: float,
    start: int,
    stop: int,
    results: BatchResults,
) -> None:
    """Solves the cases from start to stop for given displacements, each by itself, and writes its results.

    `tensions`, shape (n, t), N, hold the tensions to start from where `warm`, and then those found.
    """
    loads, tension, state = empty_loads(rod), frictionless_tension(rod), empty_state(rod.tendons.shape[1])
    for case in range(start, stop):
        scale = fill_loads(rod, batch, case, loads)
        tolerances = (smallest_level(rod, tolerance, scale), GAP_TOLERANCE * tolerance * rod.length[0])
        positions, rotations, moment = results.positions[case], results.rotations[case], guesses[case]
        done, total = False, 0
        if warm and np.isfinite(moment[0] + moment[1] + moment[2]):
            converged, residual, total, stable, _ = drive_newton(
                rod, drive, loads, displacements[case], tension, moment, tensions[case], tolerances, True, state,
                positions, rotations,
            )  # fmt: skip
            if converged and stable:
                done = True
                for j in range(3):
                    results.base_moments[case, j] = moment[j]
                results.residuals[case] = residual
                results.codes[case] = CONVERGED
                results.fractions[case] = 1.0
        if not done:
            code, residual, made, fraction = follow_drive(
                rod, drive, loads, displacements[case], tension, results.base_moments[case], tensions[case],
                tolerances, first_step, state, positions, rotations,
            )  # fmt: skip
            total += made
            results.codes[case] = code
            results.residuals[case] = residual
            results.fractions[case] = fraction
            if code in (LIMIT_POINT, NOT_CONVERGED):
                results.positions[case] = np.nan
                results.rotations[case] = np.nan
                results.base_moments[case] = np.nan
                tensions[case] = np.nan
        results.iterations[case] = total


@njit(**OPTIONS)
def record_cases(
    rod: RodArrays,
    tensions: FloatArray,
    pulls: FloatArray,
    batch: LoadBatch,
    converged: BoolArray,
    base_moments: FloatArray,
    record: FloatArray,
) -> None:
    """Integrates solved cases again and keeps what happens at every Runge-Kutta stage, record (n, c, 4, 21).

    `pulls`, shape (n, c, 3, t), N, are the tensions along the tendons; (0, c, 3, t) where they are the same all along.
    """
    disks, tendons = rod.disk_masses.shape[0], rod.tendons.shape[1]
    loads, tension = empty_loads(rod), frictionless_tension(rod)
    positions, rotations = np.empty((disks, 3)), np.empty((disks, 3, 3))
    end, angle, moment = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for case in range(tensions.shape[0]):
        if not converged[case]:
            record[case] = np.nan
            continue
        fill_loads(rod, batch, case, loads)
        fill_pulls(rod, tensions[case], pulls, case, tension)
        integrate(
            rod, loads, tension, base_moments[case], False, positions, rotations, end, angle, moment,
            np.empty((0, tendons)), np.empty((0, 3)), record[case],
        )  # fmt: skip


@njit(**OPTIONS)
def variations_of_cases(
    rod: RodArrays,
    tensions: FloatArray,
    converged: BoolArray,
    record: FloatArray,
    profiles: FloatArray,
    at_disks: FloatArray,
    end: FloatArray,
    length_rates: FloatArray,
) -> None:
    """Integrates the variational equations of every case with an equilibrium; see `variations`."""
    tension = frictionless_tension(rod)
    for case in range(tensions.shape[0]):
        if converged[case]:
            fill_tension(rod, tensions[case], tension)
            variations(rod, tension, record[case], profiles, at_disks[case], end[case], length_rates[case])


@njit(**OPTIONS)
def lengths_of_cases(
    rod: RodArrays,
    tensions: FloatArray,
    pulls: FloatArray,
    converged: BoolArray,
    record: FloatArray,
    lengths: FloatArray,
) -> None:
    """Writes the path lengths of solved cases and the tensions' integrals along them, shape (n, 2, t).

    `pulls` as for `record_cases`.
    """
    tension = frictionless_tension(rod)
    for case in range(tensions.shape[0]):
        if not converged[case]:
            lengths[case] = np.nan
            continue
        fill_pulls(rod, tensions[case], pulls, case, tension)
        lengths[case] = 0.0
        for c in range(rod.step_lengths.shape[0]):
            for stage in range(4):
                point = 0 if stage == 0 else (2 if stage == 3 else 1)
                share = rod.step_lengths[c] / (6.0 if stage == 0 or stage == 3 else 3.0)
                add_lengths(rod, tension, c, point, record[case, c, stage, 6:12], share, lengths[case])


@njit(**OPTIONS)
def rest_lengths(rod: RodArrays) -> FloatArray:
    """Returns the length of each tendon's path in the rest shape, shape (t,), m."""
    tension = frictionless_tension(rod)
    lengths = np.zeros((2, rod.tendons.shape[1]))
    for c in range(rod.step_lengths.shape[0]):
        for point in range(3):
            share = rod.step_lengths[c] * (2.0 / 3.0 if point == 1 else 1.0 / 6.0)
            add_lengths(rod, tension, c, point, rod.rest_strain[c, point], share, lengths)
    return lengths[0]
