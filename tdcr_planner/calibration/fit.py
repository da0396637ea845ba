"""Robust least squares: the numbers under which a robot on its bench shows what was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.forward import Forward
from tdcr_planner.calibration.parameters import Block, Parameter

OUTLIER = 3.0
"""Residuals beyond this many noise deviations count linearly in place of quadratically (soft L1)."""
ROUNDS = 4
NOISE_CHANGE = 0.1
UNSOLVED = 5.0
"""Residual of a state without equilibrium, in noise deviations."""
LEAST_NOISE_M, LEAST_NOISE_N = 1e-7, 1e-6
STEP = 1e-4
"""Of the differences, in spreads of the parameters before measuring."""

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviation of what the fit leaves over: of a coordinate, m, and of a tension, N."""

    position: float
    tension: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted bench; k numbers, r residuals.

    Attributes:
        bench: The robot on its bench with the fitted numbers.
        blocks: What was fitted.
        numbers: Shape (k,).
        noise: What is left over.
        residuals: Of the states fitted to, in noise deviations, shape (r,).
        jacobian: Derivative of the residuals with respect to the numbers, shape (r, k).
        rows: State and component of each residual, shape (r, 2).
        evaluations: Sequences that were solved.
    """

    bench: Bench
    blocks: tuple[Block, ...]
    numbers: FloatArray
    noise: Noise
    residuals: FloatArray
    jacobian: FloatArray
    rows: FloatArray
    evaluations: int

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters in the order of the numbers."""
        return parameters_of(self.blocks)


def parameters_of(blocks: tuple[Block, ...]) -> tuple[Parameter, ...]:
    """Returns the parameters of blocks, one after the other."""
    return tuple(parameter for block in blocks for parameter in block.parameters)


def spreads_of(blocks: tuple[Block, ...]) -> FloatArray:
    """Returns the standard deviation of each number before measuring, shape (k,)."""
    return np.array([parameter.spread for parameter in parameters_of(blocks)])


class Problem:
    """Residuals of some states as a function of the numbers.

    Attributes:
        forward: What predicts the measurements.
        bench: The bench to which the numbers are applied.
        blocks: What is fitted.
        chosen: Which states count, shape (n,).
        evaluations: Sequences that were solved so far.
    """

    def __init__(self, forward: Forward, bench: Bench, blocks: tuple[Block, ...], chosen: BoolArray) -> None:
        self.forward, self.bench, self.blocks, self.chosen = forward, bench, blocks, chosen
        self.evaluations = 0
        self._cuts = np.cumsum([len(block.parameters) for block in blocks])[:-1]
        # Blocks that move the robot come first, so that the shapes of a robot are found once for all others.
        self._order = sorted(range(len(blocks)), key=lambda index: not blocks[index].moves_robot)
        self._last: tuple[bytes, Bench] | None = None

    def bench_at(self, numbers: FloatArray) -> Bench:
        """Returns the bench with numbers applied."""
        parts = np.split(numbers, self._cuts)
        moving = np.concatenate(
            [parts[index] for index in self._order if self.blocks[index].moves_robot] or [np.zeros(0)]
        )
        key = moving.tobytes()
        bench = self._last[1] if self._last is not None and self._last[0] == key else None
        if bench is None:
            bench = self.bench
            for index in self._order:
                if self.blocks[index].moves_robot:
                    bench = self.blocks[index].apply(bench, parts[index])
            self._last = (key, bench)
        for index in self._order:
            if not self.blocks[index].moves_robot:
                bench = self.blocks[index].apply(bench, parts[index])
        return bench

    def differences(self, numbers: FloatArray, *, keep: bool = True) -> FloatArray:
        """Returns predicted less measured, shape (chosen, 3 k + t): coordinates in m, then tensions in N, NaN if none.

        Args:
            numbers: Shape (k,).
            keep: Whether the next solution starts from this one.
        """
        self.evaluations += 1
        bench = self.bench_at(numbers)
        states = self.forward.states
        points = (self.forward.points(bench, keep=keep) - states.positions).reshape(len(states), -1)
        tensions = np.full_like(states.tensions, np.nan)
        if bench.drives_displacement and np.isfinite(states.tensions).any():
            tensions = self.forward.shapes(bench, keep=keep).tensions - states.tensions
        return np.concatenate([points, tensions], axis=1)[self.chosen]

    def measured(self) -> BoolArray:
        """Returns which differences exist, shape (chosen, 3 k + t)."""
        states = self.forward.states
        tensions = (
            np.isfinite(states.tensions)
            if self.bench.drives_displacement
            else np.zeros_like(states.tensions, dtype=bool)
        )
        positions = np.isfinite(states.positions).reshape(len(states), -1)
        return np.concatenate([positions, tensions], axis=1)[self.chosen]

    def scales(self, noise: Noise) -> FloatArray:
        """Returns the noise of each column of the differences, shape (3 k + t,)."""
        states = self.forward.states
        width = 3 * len(states.points)
        return np.concatenate([np.full(width, noise.position), np.full(states.tensions.shape[1], noise.tension)])

    def noise(self, numbers: FloatArray) -> Noise:
        """Returns the noise that differences show, by the median of their sizes (normal distribution)."""
        differences = self.differences(numbers)
        width = 3 * len(self.forward.states.points)

        def deviation(values: FloatArray, least: float) -> float:
            seen = np.abs(values[np.isfinite(values)])
            return max(float(1.4826 * np.median(seen)), least) if len(seen) else 1.0

        return Noise(deviation(differences[:, :width], LEAST_NOISE_M), deviation(differences[:, width:], LEAST_NOISE_N))

    def residuals(self, numbers: FloatArray, noise: Noise, seen: BoolArray, *, keep: bool = True) -> FloatArray:
        """Returns differences in noise deviations where something was measured, shape (r,)."""
        scaled = self.differences(numbers, keep=keep) / self.scales(noise)
        return np.nan_to_num(scaled, nan=UNSOLVED)[seen]

    def jacobian(self, numbers: FloatArray, noise: Noise, seen: BoolArray) -> FloatArray:
        """Returns the derivative of the residuals by differences, shape (r, k)."""
        at = self.residuals(numbers, noise, seen)
        jacobian = np.empty((len(at), len(numbers)))
        for index, parameter in enumerate(parameters_of(self.blocks)):
            step = STEP * parameter.spread
            moved = numbers.copy()
            moved[index] += step
            jacobian[:, index] = (self.residuals(moved, noise, seen, keep=False) - at) / step
        return jacobian


def fit_bench(
    forward: Forward,
    bench: Bench,
    blocks: tuple[Block, ...],
    chosen: BoolArray,
    *,
    start: FloatArray | None = None,
    progress: Progress = lambda _: None,
) -> Fit:
    """Returns the numbers of least cost, robust against outliers.

    Minimises sum rho(difference / noise) + sum (number / spread)^2 with the soft L1 loss rho, alternating with the
    noise that the differences show. The second sum is what drawings and handbooks say; measurements that tell more
    outweigh it.

    Args:
        forward: What predicts the measurements.
        bench: The bench as the robot's file has it.
        blocks: What to fit.
        chosen: Which states count, shape (n,).
        start: Numbers to start from; None for those of the file.
        progress: Called with a message as the fit goes on.
    """
    problem = Problem(forward, bench, blocks, chosen)
    spreads = spreads_of(blocks)
    lowest = np.array([parameter.lowest for parameter in parameters_of(blocks)])
    numbers = np.zeros(len(spreads)) if start is None else start.copy()
    seen = problem.measured()
    noise = problem.noise(numbers)
    for round_index in range(ROUNDS):
        here = noise

        def cost(values: FloatArray, noise: Noise = here) -> FloatArray:
            return np.concatenate([problem.residuals(values, noise, seen), values / spreads])

        def slope(values: FloatArray, noise: Noise = here) -> FloatArray:
            return np.concatenate([problem.jacobian(values, noise, seen), np.diag(1.0 / spreads)])

        inside = np.maximum(numbers, lowest + 1e-9 * spreads)
        found = least_squares(
            cost, inside, jac=slope, bounds=(lowest, np.inf), x_scale=spreads, loss="soft_l1", f_scale=OUTLIER,
            ftol=1e-5, xtol=1e-5, max_nfev=30,
        )  # fmt: skip
        numbers, before = found.x, noise
        noise = problem.noise(numbers)
        progress(f"round {round_index + 1}: {1e3 * noise.position:.3g} mm left over a coordinate")
        if abs(noise.position - before.position) <= NOISE_CHANGE * before.position:
            break
    residuals = problem.residuals(numbers, noise, seen)
    jacobian = problem.jacobian(numbers, noise, seen)
    states, components = np.nonzero(seen)
    rows = np.stack([np.flatnonzero(chosen)[states], components], axis=1)
    return Fit(problem.bench_at(numbers), blocks, numbers, noise, residuals, jacobian, rows, problem.evaluations)
