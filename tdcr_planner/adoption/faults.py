"""Faults of a foreign network that no convention mends: numbers that are none, random answers, answers by batch."""

from __future__ import annotations

import numpy as np

from tdcr_planner.adoption.discovery import ask
from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.learning.dataset import Cases, SolvedCases
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.convention import Convention
from tdcr_planner.shape.foreign_network import ForeignNetwork

_ONE_BY_ONE = 8
# Parts of the robot's length: rounding in single precision, and that of sums in another order.
_SAME = {"float32": 2e-6, "float64": 2e-6}


def check_faults(network: ForeignNetwork, robot: RobotSpec, convention: Convention, solved: SolvedCases) -> None:
    """Refuses a network whose answers cannot be planned with.

    Args:
        network: The network.
        robot: The robot.
        convention: Its convention.
        solved: Cases of its domain.

    Raises:
        InputError: It gives numbers that are not finite, other answers when it is asked again, or other answers for
            a batch than for its states one by one.
    """
    for least in (np.zeros(robot.tendon_count), robot.pretensions):
        rest = _at_rest(solved, least)
        if not all(np.isfinite(part).all() for part in ask(network, robot, convention, rest)):
            told = ", ".join(f"{value:g}" for value in least)
            raise InputError("network", "finite numbers", f"NaN or infinity for tensions of ({told}) N without loads")
    first, turns = ask(network, robot, convention, solved)
    bad = np.flatnonzero(~(np.isfinite(first).all(axis=(1, 2)) & np.isfinite(turns).all(axis=(1, 2, 3))))
    if len(bad):
        tensions = ", ".join(f"{value:.4g}" for value in solved.cases.tensions[bad[0]])
        raise InputError(
            "network", "finite numbers", f"NaN or infinity in {len(bad)} of {len(first)} shapes, as for ({tensions}) N"
        )
    allowed = _SAME[convention.number] * robot.length
    again = _farthest(first, ask(network, robot, convention, solved)[0])
    if again > allowed:
        raise InputError(
            "network",
            "the same answer for the same state; is dropout left on? call eval() before it is saved",
            f"answers up to {1e3 * again:.3g} mm apart",
        )
    for row in range(min(_ONE_BY_ONE, len(first))):
        one = SolvedCases(
            solved.cases.take(slice(row, row + 1)),
            solved.base_moment[row : row + 1],
            solved.positions[row : row + 1],
            solved.rotations[row : row + 1],
            1,
        )
        apart = _farthest(first[row], ask(network, robot, convention, one)[0][0])
        if apart > allowed:
            raise InputError(
                "network",
                "the same answer for a state alone and in a batch; is batch normalisation in training mode?",
                f"answers {1e3 * apart:.3g} mm apart",
            )


def _at_rest(solved: SolvedCases, tensions: FloatArray) -> SolvedCases:
    """Returns one case without loads, of unknown shape: there a robot starts, and there a formula may divide by 0."""
    none = np.zeros((1, 3))
    return SolvedCases(Cases(tensions[None], none, none), none, solved.positions[:1], solved.rotations[:1], 1)


def _farthest(a: FloatArray, b: FloatArray) -> float:
    return float(np.abs(a - b).max())
