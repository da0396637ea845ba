"""Cases to learn from and to be judged by: how they are drawn, and what the reference says about them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.errors import InputError
from tdcr_planner.learning.limit_use import LimitUse
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import Domain
from tdcr_planner.statics.solver import SolverSettings, solve_statics
from tdcr_planner.workers import Backend, Outcome, WorkersError

Sample = Literal["uniform", "planner"]
Progress = Callable[[str, int, int, str], None]
"""Called as progress(stage, steps done, steps in all, remark)."""

# Cases a job: some 0.1 s of work, and results of a few MB.
_BLOCK = 1024
# How often tensions beyond the robot's own limits are drawn again before they are scaled down.
_REDRAWS = 8


def no_progress(stage: str, done: int, total: int, remark: str) -> None:
    """Says nothing."""


@dataclass(frozen=True)
class Cases:
    """A batch of inputs.

    Attributes:
        tensions: Shape (n, t), N.
        gravity: Shape (n, 3), m/s^2, base frame.
        tip_force: Shape (n, 3), N, base frame.
    """

    tensions: FloatArray
    gravity: FloatArray
    tip_force: FloatArray

    def __len__(self) -> int:
        return len(self.tensions)

    def take(self, rows: slice | IntArray) -> Cases:
        """Returns some of the cases."""
        return Cases(self.tensions[rows], self.gravity[rows], self.tip_force[rows])


@dataclass(frozen=True)
class SolvedCases:
    """Cases with the stable equilibrium that the reference found.

    Attributes:
        cases: The inputs.
        base_moment: Shape (n, 3), N m, base frame.
        positions: Shape (n, d, 3), m, base frame.
        rotations: Shape (n, d, 3, 3).
        asked: How many cases were drawn; left out are those without a stable equilibrium on the branch from rest, and
            those beyond the robot's own limits on strain and tendon displacement.
    """

    cases: Cases
    base_moment: FloatArray
    positions: FloatArray
    rotations: FloatArray
    asked: int


def draw_cases(robot: RobotSpec, domain: Domain, sample: Sample, count: int, generator: np.random.Generator) -> Cases:
    """Returns cases drawn from a domain.

    "uniform": every tension uniform up to its limit; gravity and tip force uniform in direction and size.
    "planner": in each segment two neighbouring tendons uniform above the pretension and the others at it, which are
    the tensions of least sum for their bending vector; gravity at its limit in any direction; half without tip force.
    In both, tensions that bend the unloaded robot beyond its own limits on strain or tendon displacement are drawn
    again.
    """
    if count < 1:
        raise InputError("count", "1 or more", count)
    tensions = _draw_tensions(robot, domain, sample, count, generator)
    gravity = domain.gravity_m_s2 * _directions(count, generator)
    tip_force = domain.tip_force_n * generator.uniform(0.0, 1.0, (count, 1)) * _directions(count, generator)
    if sample == "uniform":
        return Cases(tensions, gravity * generator.uniform(0.0, 1.0, (count, 1)), tip_force)
    tip_force[generator.uniform(size=count) < 0.5] = 0.0
    return Cases(tensions, gravity, tip_force)


def _draw_tensions(
    robot: RobotSpec, domain: Domain, sample: Sample, count: int, generator: np.random.Generator
) -> FloatArray:
    """Returns tensions of a sample that the robot's own limits allow, shape (count, t), N."""
    tensions = _draw_any_tensions(robot, domain, sample, count, generator)
    use = LimitUse(robot)
    if not use.any:
        return tensions
    for _ in range(_REDRAWS):
        beyond = np.flatnonzero(use.largest(tensions) > 1.0)
        if not len(beyond):
            return tensions
        tensions[beyond] = _draw_any_tensions(robot, domain, sample, len(beyond), generator)
    # Where the limits leave little of the domain, what is still beyond is scaled down to somewhere within them.
    largest = use.largest(tensions)
    beyond = np.flatnonzero(largest > 1.0)
    tensions[beyond] *= (generator.uniform(0.0, 1.0, len(beyond)) / largest[beyond])[:, None]
    return tensions


def _draw_any_tensions(
    robot: RobotSpec, domain: Domain, sample: Sample, count: int, generator: np.random.Generator
) -> FloatArray:
    """Returns tensions of a sample up to the domain's limits, shape (count, t), N."""
    limits = np.asarray(domain.max_tension_n)
    tensions = generator.uniform(0.0, 1.0, (count, robot.tendon_count)) * limits
    if sample == "uniform":
        return tensions
    rows = np.arange(count)
    pretension = np.minimum(robot.pretensions, limits)
    pulled = np.zeros((count, robot.tendon_count), dtype=np.bool_)
    for index in range(robot.segment_count):
        columns = np.flatnonzero(robot.tendon_segments == index)
        order = columns[np.argsort(np.mod(robot.tendon_angles[columns], 2.0 * np.pi), kind="stable")]
        first = generator.integers(0, len(order), count)
        pulled[rows, order[first]] = True
        pulled[rows, order[(first + 1) % len(order)]] = True
    return np.asarray(pretension + np.where(pulled, tensions / limits * (limits - pretension), 0.0))


def draw_mixture(
    robot: RobotSpec, domain: Domain, planner_share: float, count: int, generator: np.random.Generator
) -> Cases:
    """Returns cases of both samples: a share of "planner", the rest "uniform"."""
    planned = round(planner_share * count)
    parts = []
    if planned:
        parts.append(draw_cases(robot, domain, "planner", planned, generator))
    if count - planned:
        parts.append(draw_cases(robot, domain, "uniform", count - planned, generator))
    return Cases(
        np.concatenate([part.tensions for part in parts]),
        np.concatenate([part.gravity for part in parts]),
        np.concatenate([part.tip_force for part in parts]),
    )


def solve_cases(
    robot: RobotSpec,
    cases: Cases,
    *,
    threads: int = 1,
    backend: Backend | None = None,
    progress: Progress = no_progress,
    stage: str = "reference",
) -> SolvedCases:
    """Returns the cases that have a stable equilibrium within the robot's limits, as the reference has them.

    The cases are solved in numbered blocks and put together in the order of the numbers. A case's solution depends on
    nothing but the case, so the result is the same, up to the rounding of their processors, whichever workers solved
    the blocks, how many there were, and whether some died on the way (with the same versions of the libraries).

    Args:
        robot: The robot.
        cases: The inputs.
        threads: Threads of the solver in this process.
        backend: Where the blocks are solved instead, each with one thread; None solves them in this process.
        progress: Called after each block.
        stage: What to call this in the progress.

    Raises:
        InputError: Not one case has a stable equilibrium within the robot's limits.
        WorkersError: The workers are gone, or a block failed on each worker that had it.
    """
    starts = range(0, len(cases), _BLOCK)
    solve = _solve_here if backend is None else backend
    blocks = [
        _Block(robot, cases.take(slice(start, start + _BLOCK)), threads if backend is None else 1) for start in starts
    ]
    answers: dict[int, _Answer] = {}
    done = 0
    progress(stage, 0, len(cases), "")
    with contextlib.closing(solve(_solve_block, blocks)) as outcomes:
        for outcome in outcomes:
            if outcome.error:
                raise WorkersError(f"{stage}: block {outcome.index + 1} of {len(blocks)} failed: {outcome.error}")
            answers[outcome.index] = outcome.value
            done += len(blocks[outcome.index].cases)
            progress(stage, done, len(cases), "")
    ordered = [answers[index] for index in range(len(blocks))]
    rows = np.concatenate([start + answer.rows for start, answer in zip(starts, ordered, strict=True)])
    if not len(rows):
        raise InputError(
            "domain",
            "loads that the robot carries",
            f"no stable equilibrium within max_strain and max_tendon_displacement_m in {len(cases)} cases of robot "
            f"{robot.name!r}",
        )
    return SolvedCases(
        cases.take(rows),
        np.concatenate([answer.base_moment for answer in ordered]),
        np.concatenate([answer.positions for answer in ordered]),
        np.concatenate([answer.rotations for answer in ordered]),
        len(cases),
    )


@dataclass(frozen=True)
class _Block:
    """One job: some cases, complete in itself."""

    robot: RobotSpec
    cases: Cases
    threads: int


@dataclass(frozen=True)
class _Answer:
    """What the reference says about a block.

    Attributes:
        rows: Which of its cases have a stable equilibrium within the robot's limits, shape (k,).
        base_moment: Shape (k, 3), N m.
        positions: Shape (k, d, 3), m.
        rotations: Shape (k, d, 3, 3).
    """

    rows: IntArray
    base_moment: FloatArray
    positions: FloatArray
    rotations: FloatArray


def _solve_block(block: _Block) -> _Answer:
    cases = block.cases
    solution = solve_statics(
        block.robot,
        cases.tensions,
        gravity=cases.gravity,
        tip_force=cases.tip_force,
        settings=SolverSettings(threads=block.threads),
    )
    usable = solution.converged & solution.stable
    if LimitUse(block.robot).any:
        usable &= LimitUse.kept(block.robot, solution)
    rows = np.flatnonzero(usable)
    return _Answer(rows, solution.base_moment[rows], solution.positions[rows], solution.rotations[rows])


def _solve_here(
    function: Callable[[Any], Any], jobs: Sequence[Any], **_options: object
) -> Generator[Outcome, None, None]:
    for index, job in enumerate(jobs):
        yield Outcome(index, function(job))


def _directions(count: int, generator: np.random.Generator) -> FloatArray:
    vectors = generator.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])
