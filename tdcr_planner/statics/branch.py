"""The equilibrium that follows from the unloaded shape: Newton's method on M(0), load steps, stability.

Tensions are given here; `drive` does the same for tendons whose displacements are given.
"""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.statics.chord import solve_chord_strain
from tdcr_planner.statics.cross_section import solve_strain
from tdcr_planner.statics.cut_loads import CutLoads, empty_loads, scale_loads
from tdcr_planner.statics.integration import add_payload, integrate
from tdcr_planner.statics.motion import se3_exp
from tdcr_planner.statics.options import OPTIONS
from tdcr_planner.statics.rod import RodArrays
from tdcr_planner.statics.small_matrices import invert3, positive_spectrum
from tdcr_planner.statics.tension import TendonTension
from tdcr_planner.statics.variations import variations

CONVERGED, UNSTABLE, LIMIT_POINT, NOT_CONVERGED = 0, 1, 2, 3

NEWTON_LIMIT = 12
INTEGRATION_LIMIT = 2000
CONTRACTION = 0.5
CAUTIOUS_CONTRACTION = 0.25
# A branch that follows on loses its derivative at a limit point: det dM(l)/dM(0), 1 for a rod without loads, is zero.
LIMIT_DETERMINANT = 0.1
SMALLEST_LOAD_STEP = 2e-5
LONG_LOAD_STEP = 1.0 / 16.0
LARGEST_MOMENT = 1e6


@njit(**OPTIONS)
def smallest_level(rod: RodArrays, tolerance: float, scale: float) -> float:
    """Returns the residual at which a case is solved, N m: relative to its loads, and not below rounding."""
    stiffness = 0.0
    for c in range(rod.step_lengths.shape[0]):
        if not rod.rigid[c]:
            stiffness = rod.stiffness[c, 0, 3] / rod.length[0]
            break
    return max(tolerance * scale, 1e-13 * stiffness)


@njit(**OPTIONS)
def integrate_exactly(
    rod: RodArrays,
    loads: CutLoads,
    tension: TendonTension,
    base_moment: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
    end: FloatArray,
    moment: FloatArray,
    record: FloatArray,
    at_disks: FloatArray,
) -> tuple[bool, bool]:
    """Integrates the rod and its variations with M(0), the latter to the integrator's own order; see `integrate`.

    Near a buckling load dM(l)/dM(0) is nearly singular, and the second-order variations of `integrate` do not suffice.

    Args:
        rod: RodArrays.
        loads: The case's loads.
        tension: The tensions along the tendons.
        base_moment: As for `integrate`.
        positions: As for `integrate`.
        rotations: As for `integrate`.
        end: M(l); written.
        moment: dM(l)/dM(0), shape (3, 3); written.
        record: Shape (c, 4, 21); written.
        at_disks: Variations at the disks, shape (d, 6, 3); written.

    Returns:
        Whether every cross-section was solved, and whether the shape is stable.
    """
    tendons = rod.tendons.shape[1]
    none, no_rates = np.empty((0, tendons)), np.empty((0, 3))
    ok, _ = integrate(
        rod, loads, tension, base_moment, False, positions, rotations, end, moment, moment, none, no_rates, record
    )
    if not ok:
        return False, False
    variations(
        rod, tension, record, np.empty((0, rod.step_lengths.shape[0], 3)), at_disks, moment, np.empty((tendons, 3))
    )
    last = at_disks.shape[0] - 1
    add_payload(rod, loads, rotations[last], np.empty(3), at_disks[last, :3], moment)
    stable = positive_spectrum(moment, at_disks[last, :3])
    for disk in range(2, at_disks.shape[0]):
        bent = False
        for i in range(3):
            for j in range(3):
                bent = bent or at_disks[disk - 1, i, j] != 0.0
        stable = stable and (not bent or positive_spectrum(at_disks[disk, :3], at_disks[disk - 1, :3]))
    return True, stable


@njit(**OPTIONS)
def newton(
    rod: RodArrays,
    loads: CutLoads,
    tension: TendonTension,
    base_moment: FloatArray,
    tolerance: float,
    cautious: bool,
    long: bool,
    positions: FloatArray,
    rotations: FloatArray,
) -> tuple[bool, float, int, bool, float]:
    """Newton's method on M(0), given up as soon as it does not contract.

    Contraction from the first step on keeps it on the branch of its starting point (Deuflhard 2011, ch. 5). A cautious
    run asks for more of it and ends at a stable shape or not at all; after a long step every shape on the way has to be
    stable too. What that refuses only shorter steps can decide.

    Returns:
        Whether it converged, residual in N m, integrations made, whether the equilibrium is stable, determinant of
        dM(l)/dM(0); `base_moment`, `positions` and `rotations` hold the result.
    """
    limit = CAUTIOUS_CONTRACTION if cautious else CONTRACTION
    steps, tendons = rod.tendons.shape
    end, trial, delta = np.empty(3), base_moment.copy(), np.zeros(3)
    angle, moment, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    record = np.empty((0 if long else steps, 4, 21))
    none, no_rates = np.empty((0, tendons)), np.empty((0, 3))
    at_disks = np.empty((positions.shape[0], 6, 3))
    made, size, residual = 0, np.inf, np.inf
    while True:
        if long:
            ok, modes = integrate(
                rod, loads, tension, trial, True, positions, rotations, end, angle, moment, none, no_rates, record
            )
            stable = modes == 0
        else:
            ok, stable = integrate_exactly(
                rod, loads, tension, trial, positions, rotations, end, moment, record, at_disks
            )
        made += 1
        if not ok or (long and not stable):
            return False, residual, made, False, 0.0
        for j in range(3):
            end[j] -= loads.tip_moment[j]
        residual = np.sqrt(end[0] ** 2 + end[1] ** 2 + end[2] ** 2)
        if residual > tolerance and made > 1:
            natural = 0.0
            for i in range(3):
                natural += (inverse[i, 0] * end[0] + inverse[i, 1] * end[1] + inverse[i, 2] * end[2]) ** 2
            if not natural <= limit**2 * size:
                return False, residual, made, False, 0.0
        for j in range(3):
            base_moment[j] = trial[j]
        determinant = invert3(moment, inverse)
        if residual <= tolerance:
            break
        if made > NEWTON_LIMIT or determinant == 0.0:
            return False, residual, made, False, 0.0
        size = 0.0
        for i in range(3):
            delta[i] = inverse[i, 0] * end[0] + inverse[i, 1] * end[1] + inverse[i, 2] * end[2]
            trial[i] = base_moment[i] - delta[i]
            size += delta[i] ** 2
        if not size < LARGEST_MOMENT:
            return False, residual, made, False, 0.0
    if long and abs(determinant) < LIMIT_DETERMINANT:
        record = np.empty((steps, 4, 21))
        ok, stable = integrate_exactly(
            rod, loads, tension, base_moment, positions, rotations, end, moment, record, at_disks
        )
        made += 1
        determinant = invert3(moment, inverse)
    return stable or not cautious, residual, made, stable, determinant


@njit(**OPTIONS)
def unloaded_tangent(rod: RodArrays, loads: CutLoads, tension: TendonTension, tangent: FloatArray) -> bool:
    """Writes the derivative of M(0) with the load fraction at the unloaded shape: all moments + the integral of p' x N.

    Without loads M is zero along the rod, so that the strain of each cross-section stands by itself; that of the middle
    is taken for the step.

    Returns:
        Whether the cross-section of every step was solved.
    """
    strain, zero, inverse, twist = np.empty(6), np.zeros(6), np.empty((6, 6)), np.empty(6)
    R, Q, d = np.eye(3), np.empty((3, 3)), np.empty(3)
    for j in range(3):
        tangent[j] = loads.tip_moment[j] + rod.length[0] * loads.line_moment[j]
        for disk in range(loads.disk_moments.shape[0]):
            tangent[j] += loads.disk_moments[disk, j]
    for c in range(rod.step_lengths.shape[0]):
        h = rod.step_lengths[c]
        if not rod.repeats[c]:
            if not unloaded_strain(rod, tension, c, zero, strain, inverse):
                return False
            for j in range(3):
                twist[j] = h * strain[3 + j]
                twist[3 + j] = h * strain[j]
            se3_exp(twist, Q, d)
        dx = R[0, 0] * d[0] + R[0, 1] * d[1] + R[0, 2] * d[2]
        dy = R[1, 0] * d[0] + R[1, 1] * d[1] + R[1, 2] * d[2]
        dz = R[2, 0] * d[0] + R[2, 1] * d[1] + R[2, 2] * d[2]
        fx = loads.forces[c, 0] - 0.5 * loads.line_loads[c, 1, 0]
        fy = loads.forces[c, 1] - 0.5 * loads.line_loads[c, 1, 1]
        fz = loads.forces[c, 2] - 0.5 * loads.line_loads[c, 1, 2]
        tangent[0] += dy * fz - dz * fy
        tangent[1] += dz * fx - dx * fz
        tangent[2] += dx * fy - dy * fx
        for i in range(3):
            x, y, z = R[i, 0], R[i, 1], R[i, 2]
            for j in range(3):
                R[i, j] = x * Q[0, j] + y * Q[1, j] + z * Q[2, j]
    for j in range(3):
        zero[j] = 0.0
    add_payload(rod, loads, R, zero[:3], np.empty((3, 0)), np.empty((3, 0)))
    for j in range(3):
        tangent[j] -= zero[j]
    return True


@njit(**OPTIONS)
def unloaded_strain(
    rod: RodArrays, tension: TendonTension, c: int, zero: FloatArray, strain: FloatArray, inverse: FloatArray
) -> bool:
    """Writes the strain at the middle of a step of the unloaded rod, and the inverse of its derivative there.

    Returns:
        Whether the cross-section was solved.
    """
    if c == 0 or rod.joins[c] or rod.rigid[c]:
        for j in range(6):
            strain[j] = rod.rest_strain[c, 1, j]
    if rod.rigid[c]:
        for i in range(6):
            for j in range(6):
                inverse[i, j] = 0.0
        return True
    count = rod.tendon_counts[c]
    if rod.chords[c, 1, 0] > 0.0:
        return solve_chord_strain(
            zero, strain, rod.stiffness[c, 1], rod.rest_strain[c, 1], rod.offsets[c, 1], rod.slopes[c, 1],
            tension.pulls[c, 1], count, rod.chords[c, 1], inverse, rod.length[0],
        )  # fmt: skip
    return solve_strain(
        zero, strain, rod.stiffness[c, 1], rod.rest_strain[c, 1], rod.offsets[c, 1], rod.slopes[c, 1],
        tension.pulls[c, 1], count, inverse, True, rod.length[0],
    )  # fmt: skip


@njit(**OPTIONS)
def follow_branch(
    rod: RodArrays,
    loads: CutLoads,
    tension: TendonTension,
    base_moment: FloatArray,
    tolerance: float,
    first_step: float,
    positions: FloatArray,
    rotations: FloatArray,
) -> tuple[int, float, int, float]:
    """Follows the equilibrium from the unloaded shape to the full loads.

    Returns:
        Status code, residual in N m, integrations made, fraction of the loads reached.
    """
    scaled = empty_loads(rod)
    tangent, last, guess = np.zeros(3), np.zeros(3), np.zeros(3)
    if not unloaded_tangent(rod, loads, tension, tangent):
        return NOT_CONVERGED, np.inf, 0, 0.0
    total = 0
    fraction, step = 0.0, first_step
    residual, determinant, on_stable = np.inf, 1.0, True
    while True:
        target = min(1.0, fraction + step)
        for j in range(3):
            guess[j] = last[j] + tangent[j] * (target - fraction)
        scale_loads(loads, target, scaled)
        # A stable branch may turn unstable only within the smallest step: anything longer could have left it.
        cautious = on_stable and step > 2.0 * SMALLEST_LOAD_STEP
        long = on_stable and step > LONG_LOAD_STEP
        converged, residual, made, stable, found = newton(
            rod, scaled, tension, guess, tolerance, cautious, long, positions, rotations
        )
        total += made
        if converged:
            if target == 1.0:
                for j in range(3):
                    base_moment[j] = guess[j]
                return (CONVERGED if stable else UNSTABLE), residual, total, 1.0
            for j in range(3):
                tangent[j] = (guess[j] - last[j]) / (target - fraction)
                last[j] = guess[j]
            fraction, determinant, on_stable = target, found, stable
            if made <= 4:
                step *= 2.0
        else:
            step = 0.5 * min(step, 1.0 - fraction)
            if step < SMALLEST_LOAD_STEP or total > INTEGRATION_LIMIT:
                return (
                    (LIMIT_POINT if abs(determinant) < LIMIT_DETERMINANT else NOT_CONVERGED),
                    residual,
                    total,
                    fraction,
                )
