"""Which parameters measurements can determine: names that are added one after the other while each can be told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.fit import Noise, Problem, spreads_of
from tdcr_planner.calibration.forward import Forward
from tdcr_planner.calibration.parameters import Block, is_meaningful, make_blocks
from tdcr_planner.calibration.uncertainty import HARDLY_DETERMINED, find_inseparable
from tdcr_planner.errors import InputError

ORDER = (
    "base", "marker", "offsets", "angles", "transmission", "modulus", "friction", "radii", "pretension", "drift",
    "mass",
)  # fmt: skip
"""The names in the order in which they are tried; the earlier of two that cannot be told apart is fitted."""
NOISE = 0.01
"""Noise that is assumed of positions before anything is fitted, in lengths of the robot: what models leave over."""
NOISE_TENSION_N = 0.1
EXACTLY_ALIKE = 1e-2
"""Information on a combination of parameters, in units of what was known before, below which nothing tells it."""


@dataclass(frozen=True)
class Selection:
    """Names to fit, and why the others are not.

    Attributes:
        names: What is fitted.
        left_out: Name and reason of what is not.
    """

    names: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...]


def select_names(forward: Forward, bench: Bench, chosen: BoolArray) -> Selection:
    """Returns the names that the measurements can determine, judged by their Jacobian at the robot's file.

    Args:
        forward: What predicts the measurements.
        bench: The bench as the robot's file has it.
        chosen: Which states count, shape (n,).
    """
    states = forward.states
    possible = [name for name in ORDER if is_meaningful(bench, name)]
    left_out: list[tuple[str, str]] = []
    for name, lacks, why in (
        ("marker", not any(states.is_marker), "no marker is tracked"),
        ("mass", not states.gravity.any(), "no gravity acts"),
        ("drift", not states.timed, "the file has no times"),
    ):
        if name in possible and lacks:
            possible.remove(name)
            left_out.append((name, why))
    blocks = make_blocks(bench, possible, _duration(forward))
    information = _information(forward, bench, blocks, chosen)
    names: list[str] = []
    columns = _columns(blocks)
    for name in possible:
        trial = [index for other in (*names, name) for index in columns[other]]
        covariance = np.linalg.inv(information[np.ix_(trial, trial)] + np.eye(len(trial)))
        if np.sqrt(np.diag(covariance)).max() <= HARDLY_DETERMINED:
            names.append(name)
        else:
            left_out.append((name, _reason(information, columns, names, name, blocks)))
    return Selection(tuple(names), tuple(left_out))


def check_separable(forward: Forward, bench: Bench, blocks: tuple[Block, ...], chosen: BoolArray) -> None:
    """Raises InputError where required names hold parameters of which the measurements tell only a combination."""
    information = _information(forward, bench, blocks, chosen)
    labels = [parameter.label for block in blocks for parameter in block.parameters]
    owner = {parameter.label: block.name for block in blocks for parameter in block.parameters}
    for group in find_inseparable(information, labels, below=EXACTLY_ALIKE):
        names = sorted({owner[label] for label in group})
        if len(names) > 1:
            raise InputError(
                "--fit",
                "names that these measurements tell apart",
                f"{' and '.join(names)}: they do not tell {' from '.join(group)}; leave one out",
            )


def _duration(forward: Forward) -> float:
    return float(forward.states.times[-1])


def _information(forward: Forward, bench: Bench, blocks: tuple[Block, ...], chosen: BoolArray) -> FloatArray:
    """Returns the information of the measurements in units of what was known before, shape (k, k)."""
    problem = Problem(forward, bench, blocks, chosen)
    spreads = spreads_of(blocks)
    noise = Noise(NOISE * bench.robot.length, NOISE_TENSION_N)
    jacobian = problem.jacobian(np.zeros(len(spreads)), noise, problem.measured()) * spreads
    return np.asarray(jacobian.T @ jacobian)


def _columns(blocks: tuple[Block, ...]) -> dict[str, list[int]]:
    columns, first = {}, 0
    for block in blocks:
        columns[block.name] = list(range(first, first + len(block.parameters)))
        first += len(block.parameters)
    return columns


def _reason(
    information: FloatArray, columns: dict[str, list[int]], names: list[str], name: str, blocks: tuple[Block, ...]
) -> str:
    """Returns why a name is left out: with which it is mixed up, or that little depends on it."""
    own = columns[name]
    alone = np.linalg.inv(information[np.ix_(own, own)] + np.eye(len(own)))
    if np.sqrt(np.diag(alone)).max() > HARDLY_DETERMINED:
        return "the measurements hardly depend on it"
    for other in names:
        both = columns[other] + own
        covariance = np.linalg.inv(information[np.ix_(both, both)] + np.eye(len(both)))
        if np.sqrt(np.diag(covariance)).max() > HARDLY_DETERMINED:
            return f"the measurements do not tell it from {other}"
    known = ", ".join(block.name for block in blocks if block.name in names)
    return f"the measurements do not tell it from {known} together"
