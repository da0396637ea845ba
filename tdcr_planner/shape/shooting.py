"""The planner's hot path: the weights of a `shooting` network and the rod's equations as one compiled call."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compiled import njit
from tdcr_planner.shape.rod_kernel import COMPILED, EIGHT, ONE, RodConstants, shoot, work_size

Float32Array = NDArray[np.float32]

# OpenBLAS hands products of more multiplications than 2^18 to several threads, which wait for each other longer than
# they work here, and far longer where cores are busy.
_ONE_THREAD = 200_000

MOST_LAYERS = 16
MOST_WIDTH = 1024
"""Of a network, head included: 64 MB of weights. A wider one takes longer for a shape than the reference does."""
MOST_CORRECTIONS = 5


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
        # One array instead of a dozen: each array argument of a compiled function costs time in every call.
        parts = [weights.load_scale]
        for matrix, bias in zip(matrices, biases, strict=True):
            parts += [matrix.T.ravel(), bias]
        self._weights = np.concatenate(parts).astype(np.float32)
        self._widths = np.array([matrices[0].shape[1], *map(len, biases)], dtype=np.int64)

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

    @property
    def arguments(self) -> tuple[Any, ...]:
        """What `predict` takes before the inputs, for compiled code that calls it."""
        return *self._constants.arguments, self._weights, self._widths, self._corrections

    def with_constants(
        self, constants: RodConstants, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The same for constants with other stops along the rod: poses at each stop instead of at each disk."""
        count, stops = len(tensions), len(constants.gaps) + 1
        positions, rotations = np.empty((count, stops, 3)), np.empty((count, stops, 3, 3))
        residual = np.empty(count)
        predict(
            *constants.arguments,
            self._weights,
            self._widths,
            self._corrections,
            tensions,
            gravity,
            tip_force,
            positions,
            rotations,
            residual,
        )
        return positions, rotations, residual


@njit(**COMPILED)
def _evaluate_network(weights, widths, tensions, gravity, tip_force, moment, inverse):  # type: ignore[no-untyped-def]
    """Fills base moments (n, 3) and inverse Jacobians (n, 9)."""
    cases, tendons = tensions.shape
    y = np.empty((cases, tendons + 6), dtype=np.float32)
    for case in range(cases):
        for tendon in range(tendons):
            y[case, tendon] = tensions[case, tendon]
        for axis in range(3):
            y[case, tendons + axis] = gravity[case, axis]
            y[case, tendons + 3 + axis] = tip_force[case, axis]
    loads = np.empty((cases, 6), dtype=np.float32)
    one = np.float32(1.0)
    at, layers = 6, len(widths) - 1
    for layer in range(layers):
        rows, columns = widths[layer], widths[layer + 1]
        matrix = weights[at : at + rows * columns].reshape(rows, columns)
        bias = weights[at + rows * columns : at + (rows + 1) * columns]
        at += (rows + 1) * columns
        z = np.dot(y, matrix)
        for case in range(cases):
            for j in range(columns):
                z[case, j] += bias[j]
        if layer == 0:
            for case in range(cases):
                for axis in range(6):
                    loads[case, axis] = weights[axis] * z[case, columns - 6 + axis]
        elif layer < layers - 1:
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


@njit(**COMPILED)
def _correct_and_shoot(  # type: ignore[no-untyped-def]
    gaps,
    first_tendon,
    offsets,
    base_mass,
    tendons,
    corrections,
    tensions,
    gravity,
    tip_force,
    moment,
    inverse,
    positions,
    rotations,
    residual,
    side_by_side,
):
    """Learned Newton steps and the last integration."""
    cases, lanes = len(tensions), len(side_by_side)
    work = np.empty(work_size(len(offsets), side_by_side))
    left_over = np.empty((cases, 3))
    for start in range(0, cases, lanes):
        count = min(lanes, cases - start)
        for correction in range(corrections + 1):
            last = correction == corrections
            shoot(
                gaps, first_tendon, offsets, base_mass, tendons, tensions, gravity, tip_force, moment,
                last, positions, rotations, left_over, work, start, count, side_by_side,
            )  # fmt: skip
            if last:
                break
            for case in range(start, start + count):
                for row in range(3):
                    for column in range(3):
                        moment[case, row] -= inverse[case, 3 * row + column] * left_over[case, column]
    for case in range(cases):
        residual[case] = np.sqrt(left_over[case, 0] ** 2 + left_over[case, 1] ** 2 + left_over[case, 2] ** 2)


@njit(**COMPILED)
def predict(  # type: ignore[no-untyped-def]
    gaps,
    first_tendon,
    offsets,
    base_mass,
    tendons,
    weights,
    widths,
    corrections,
    tensions,
    gravity,
    tip_force,
    positions,
    rotations,
    residual,
):
    """Tensions and loads to disk poses; may be called from other compiled code.

    Args:
        gaps: As in `RodConstants`; `ShootingFunction.arguments` has this and all that follow up to `corrections`.
        first_tendon: As in `RodConstants`.
        offsets: As in `RodConstants`.
        base_mass: As in `RodConstants`.
        tendons: A tuple as long as there are tendons.
        weights: Load scale (6), then matrix (in, out) and bias (out) of each layer, one after the other, float32.
        widths: Number of inputs, then of outputs of each layer.
        corrections: Number of learned Newton steps.
        tensions: Shape (n, t), N, C-contiguous float64, as all that follow.
        gravity: Shape (n, 3), m/s^2, base frame.
        tip_force: Shape (n, 3), N, base frame.
        positions: Output, shape (n, d, 3), m, base frame.
        rotations: Output, shape (n, d, 3, 3), base frame.
        residual: Output, shape (n,), N m: the moment left over at the tip.
    """
    cases = len(tensions)
    moment, inverse = np.empty((cases, 3)), np.empty((cases, 9))
    block = max(16, _ONE_THREAD // widths.max() ** 2)
    for start in range(0, cases, block):
        part = slice(start, min(start + block, cases))
        _evaluate_network(
            weights, widths, tensions[part], gravity[part], tip_force[part], moment[part], inverse[part]
        )  # fmt: skip
    if cases == 1:
        _correct_and_shoot(
            gaps, first_tendon, offsets, base_mass, tendons, corrections, tensions, gravity, tip_force,
            moment, inverse, positions, rotations, residual, ONE,
        )  # fmt: skip
    else:
        _correct_and_shoot(
            gaps, first_tendon, offsets, base_mass, tendons, corrections, tensions, gravity, tip_force,
            moment, inverse, positions, rotations, residual, EIGHT,
        )  # fmt: skip
