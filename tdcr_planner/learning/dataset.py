"""Cases to learn from and to be judged by: how they are drawn, and what the reference says about them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import Domain
from tdcr_planner.statics.solver import SolverSettings, solve_statics

Sample = Literal["uniform", "planner"]
Progress = Callable[[str, int, int, str], None]
"""Called as progress(stage, steps done, steps in all, remark)."""

_CHUNK = 4096


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
        asked: How many cases were drawn; those without a stable equilibrium on the branch from rest are left out.
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
    """
    if count < 1:
        raise InputError("count", "1 or more", count)
    limits = np.asarray(domain.max_tension_n)
    tensions = generator.uniform(0.0, 1.0, (count, robot.tendon_count)) * limits
    gravity = domain.gravity_m_s2 * _directions(count, generator)
    tip_force = domain.tip_force_n * generator.uniform(0.0, 1.0, (count, 1)) * _directions(count, generator)
    if sample == "uniform":
        return Cases(tensions, gravity * generator.uniform(0.0, 1.0, (count, 1)), tip_force)
    tip_force[generator.uniform(size=count) < 0.5] = 0.0
    rows = np.arange(count)
    pretension = np.minimum(robot.pretensions, limits)
    pulled = np.zeros((count, robot.tendon_count), dtype=np.bool_)
    for index in range(robot.segment_count):
        columns = np.flatnonzero(robot.tendon_segments == index)
        order = columns[np.argsort(np.mod(robot.tendon_angles[columns], 2.0 * np.pi), kind="stable")]
        first = generator.integers(0, len(order), count)
        pulled[rows, order[first]] = True
        pulled[rows, order[(first + 1) % len(order)]] = True
    tensions = pretension + np.where(pulled, tensions / limits * (limits - pretension), 0.0)
    return Cases(tensions, gravity, tip_force)


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
    progress: Progress = no_progress,
    stage: str = "reference",
) -> SolvedCases:
    """Returns the cases that have a stable equilibrium, with what the reference says about them.

    Args:
        robot: The robot.
        cases: The inputs.
        threads: Threads of the solver.
        progress: Called after each chunk.
        stage: What to call this in the progress.

    Raises:
        InputError: Not one case has a stable equilibrium: the loads are beyond what this robot carries.
    """
    settings = SolverSettings(threads=threads)
    kept, moments, positions, rotations = [], [], [], []
    for start in range(0, len(cases), _CHUNK):
        part = cases.take(slice(start, start + _CHUNK))
        solution = solve_statics(
            robot, part.tensions, gravity=part.gravity, tip_force=part.tip_force, settings=settings
        )
        rows = np.flatnonzero(solution.converged & solution.stable)
        kept.append(start + rows)
        moments.append(solution.base_moment[rows])
        positions.append(solution.positions[rows])
        rotations.append(solution.rotations[rows])
        progress(stage, min(start + _CHUNK, len(cases)), len(cases), "")
    rows = np.concatenate(kept)
    if not len(rows):
        raise InputError(
            "domain",
            "loads that the robot carries",
            f"no stable equilibrium in {len(cases)} cases of robot {robot.name!r}",
        )
    return SolvedCases(
        cases.take(rows), np.concatenate(moments), np.concatenate(positions), np.concatenate(rotations), len(cases)
    )


def _directions(count: int, generator: np.random.Generator) -> FloatArray:
    vectors = generator.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])
