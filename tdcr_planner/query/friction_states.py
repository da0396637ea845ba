"""Friction states: the directions in which the tendons may have slid into a state, as far as they are tried.

Where a tendon slid last, towards the drive or away from it, decides its tension along the robot, between the two bounds
of Euler and Eytelwein's capstan. At the start of a path nobody knows it.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from tdcr_planner.robot import RobotSpec

FrictionState = tuple[str, ...] | None
"""The name "pull" or "release" of each tendon, as for `solve_statics`; None for no friction."""

MOST_COMBINED = 6
"""Rubbing tendons up to which all combinations are tried."""
DRAWN = 8
"""Combinations drawn at random where there are too many to try all."""


def friction_states(robot: RobotSpec) -> list[FrictionState]:
    """Returns the friction states that are tried: no friction first, then combinations of directions.

    All combinations of up to `MOST_COMBINED` rubbing tendons; else all one way, each tendon alone against the others,
    both ways, and some at random. A robot without friction has the first alone.
    """
    rubbing = [i for i, tendon in enumerate(robot.tendons) if tendon.friction_coefficient > 0.0]
    count = len(rubbing)
    if not count:
        return [None]
    if count <= MOST_COMBINED:
        signs = [np.array(combination) for combination in product((False, True), repeat=count)]
    else:
        alone = np.eye(count, dtype=np.bool_)
        drawn = np.random.default_rng(0).integers(0, 2, (DRAWN, count)).astype(np.bool_)
        signs = [np.zeros(count, np.bool_), np.ones(count, np.bool_), *alone, *~alone, *drawn]
    states: list[FrictionState] = [None]
    for released in signs:
        names = np.full(robot.tendon_count, "pull", dtype=object)
        names[np.array(rubbing)[released]] = "release"
        states.append(tuple(names.tolist()))
    return states


def describe_state(state: FrictionState) -> str:
    """Returns a friction state in words."""
    if state is None:
        return "without friction"
    released = [str(index + 1) for index, name in enumerate(state) if name == "release"]
    if not released:
        return "with all tendons sliding towards the drive"
    if len(released) == len(state):
        return "with all tendons sliding away from the drive"
    return f"with tendon {', '.join(released)} sliding away from the drive and the others towards it"
