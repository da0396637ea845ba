"""The planner's hot path: the weights of a `shooting` network and the rod's equations as one compiled call."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import FloatArray
from tdcr_planner.shape.rod_kernel import EIGHT, FAST_MATH, SIXTEEN, STATE, WORK_ROWS, RodConstants, load, shoot

Float32Array = NDArray[np.float32]

# OpenBLAS hands products of more multiplications than 2^18 to several threads, which wait for each other longer than
# they work here, and far longer where cores are busy.
_ONE_THREAD = 200_000


@dataclass(frozen=True)
class ShootingWeights:
    """What a `shooting` network has learned, as arrays.

    Attributes:
        features: Affine map from tensions, gravity and tip force to the network's inputs, shape (k, t + 7).
        load_scale: Moment that each of the six loads can exert, shape (6,), N m.
        matrices: Weights of each layer, the head last, shape (out, in).
        biases: Biases of each layer, shape (out,).
        corrections: Number of learned Newton steps.
    """

    features: Float32Array
    load_scale: Float32Array
    matrices: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    corrections: int


class ShootingFunction:
    """Tensions and loads to disk poses, compiled; equal to the TorchScript module of the same weights."""

    def __init__(self, constants: RodConstants, weights: ShootingWeights) -> None:
        """Lays the weights out for the compiled code."""
        self._constants = constants
        self._corrections = weights.corrections
        matrices = [weights.features[:, :-1], *weights.matrices]
        biases = [weights.features[:, -1], *weights.biases]
        self._matrices = tuple(np.ascontiguousarray(matrix.T, dtype=np.float32) for matrix in matrices)
        self._biases = tuple(np.ascontiguousarray(bias, dtype=np.float32) for bias in biases)
        widest = max(max(matrix.shape) for matrix in self._matrices)
        self._block = max(16, _ONE_THREAD // widest**2)
        self._load_scale = np.ascontiguousarray(weights.load_scale, dtype=np.float32)

    def __call__(
        self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Returns positions (n, d, 3) m, rotations (n, d, 3, 3), and the moment left over at the tip (n,), N m.

        That moment is the residual of the cut form: how far the poses are from equilibrium.

        Args:
            tensions: Shape (n, t), N, C-contiguous float64.
            gravity: Shape (n, 3), m/s^2, base frame, C-contiguous float64.
            tip_force: Shape (n, 3), N, base frame, C-contiguous float64.
        """
        return self.with_constants(self._constants, tensions, gravity, tip_force)

    def with_constants(
        self, constants: RodConstants, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The same for constants with other stops along the rod: poses at each stop instead of at each disk."""
        count, stops = len(tensions), len(constants.gaps) + 1
        positions, rotations = np.empty((count, stops, 3)), np.empty((count, stops, 3, 3))
        residual = np.empty(count)
        _predict(
            constants.gaps,
            constants.first_tendon,
            constants.offsets,
            constants.base_mass,
            self._matrices,
            self._biases,
            self._load_scale,
            self._block,
            self._corrections,
            tensions,
            gravity,
            tip_force,
            positions,
            rotations,
            residual,
        )
        return positions, rotations, residual


@numba.njit(fastmath=FAST_MATH, cache=True, error_model="numpy", boundscheck=False)
def _evaluate_network(matrices, biases, load_scale, tensions, gravity, tip_force, moment, inverse):  # type: ignore[no-untyped-def]
    """Fills base moments (n, 3) and inverse Jacobians (n, 9)."""
    cases, tendons = tensions.shape
    x = np.empty((cases, tendons + 6), dtype=np.float32)
    for case in range(cases):
        for tendon in range(tendons):
            x[case, tendon] = tensions[case, tendon]
        for axis in range(3):
            x[case, tendons + axis] = gravity[case, axis]
            x[case, tendons + 3 + axis] = tip_force[case, axis]
    y = np.dot(x, matrices[0])
    y += biases[0]
    first = y.shape[1] - 6
    loads = np.empty((cases, 6), dtype=np.float32)
    for case in range(cases):
        for axis in range(6):
            loads[case, axis] = load_scale[axis] * y[case, first + axis]
    one = np.float32(1.0)
    for index in range(1, len(matrices)):
        z = np.dot(y, matrices[index])
        bias = biases[index]
        for case in range(cases):
            for j in range(z.shape[1]):
                z[case, j] += bias[j]
        if index < len(matrices) - 1:
            flat = z.reshape(z.size)
            for i in range(flat.size):
                flat[i] = flat[i] / np.sqrt(one + flat[i] * flat[i])
        y = z
    for case in range(cases):
        for row in range(3):
            total = np.float32(0.0)
            for axis in range(6):
                total += y[case, 6 * row + axis] * loads[case, axis]
            moment[case, row] = total
        for entry in range(9):
            inverse[case, entry] = y[case, 18 + entry] + (one if entry % 4 == 0 else np.float32(0.0))


@numba.njit(fastmath=FAST_MATH, cache=True, error_model="numpy", boundscheck=False)
def _correct_and_shoot(  # type: ignore[no-untyped-def]
    gaps,
    first_tendon,
    offsets,
    base_mass,
    corrections,
    tensions,
    gravity,
    tip_force,
    moment,
    inverse,
    positions,
    rotations,
    residual,
    start,
    stop,
    side_by_side,
):
    """Learned Newton steps and the last integration, for cases start ... stop."""
    lanes = len(side_by_side)
    work = np.zeros((WORK_ROWS + len(offsets)) * lanes)
    while start < stop:
        count = min(lanes, stop - start)
        for correction in range(corrections + 1):
            load(work, tensions, gravity, tip_force, moment, base_mass, start, count, side_by_side)
            last = correction == corrections
            shoot(work, gaps, first_tendon, offsets, last, positions, rotations, start, count, side_by_side)
            for lane in range(count):
                square = 0.0
                for row in range(3):
                    left_over = work[(STATE + row) * lanes + lane]
                    square += left_over * left_over
                    if not last:
                        for entry in range(3):
                            moment[start + lane, entry] -= inverse[start + lane, 3 * entry + row] * left_over
                residual[start + lane] = np.sqrt(square)
        start += count


@numba.njit(cache=True, error_model="numpy", boundscheck=False)
def _predict(  # type: ignore[no-untyped-def]
    gaps,
    first_tendon,
    offsets,
    base_mass,
    matrices,
    biases,
    load_scale,
    block,
    corrections,
    tensions,
    gravity,
    tip_force,
    positions,
    rotations,
    residual,
):
    """Sixteen lanes are the fastest for many shapes, eight for up to eight."""
    cases = len(tensions)
    moment, inverse = np.empty((cases, 3)), np.empty((cases, 9))
    for start in range(0, cases, block):
        stop = min(start + block, cases)
        _evaluate_network(
            matrices,
            biases,
            load_scale,
            tensions[start:stop],
            gravity[start:stop],
            tip_force[start:stop],
            moment[start:stop],
            inverse[start:stop],
        )
    wide = cases // 16 * 16
    if cases - wide > 8:
        wide = cases
    if wide > 0:
        _correct_and_shoot(
            gaps, first_tendon, offsets, base_mass, corrections, tensions, gravity, tip_force,
            moment, inverse, positions, rotations, residual, 0, wide, SIXTEEN,
        )  # fmt: skip
    if wide < cases:
        _correct_and_shoot(
            gaps, first_tendon, offsets, base_mass, corrections, tensions, gravity, tip_force,
            moment, inverse, positions, rotations, residual, wide, cases, EIGHT,
        )  # fmt: skip
