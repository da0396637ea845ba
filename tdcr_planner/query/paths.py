"""Paths between waypoints, states and tensions: the forms that a query's answer takes on its way to the result."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.path import TensionPath
from tdcr_planner.planning.planner import SearchOutcome
from tdcr_planner.planning.scenario import Goal, Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.timing import path_times, smooth_states
from tdcr_planner.planning.validity import ValidityChecker
from tdcr_planner.query.solved_states import SolvedStates

# A planner's coordinates may be rounded by their scaling, far less than any drive resolves.
_ROUNDING = 1e-6


def check_outcome(query: Scenario, space: ConfigurationSpace, outcome: SearchOutcome) -> FloatArray:
    """Returns the waypoints that a planner has found, shape (k, dimension), if they lead from the start to all goals.

    Raises:
        InputError: They do not; the message names the planner.
    """
    name, rows = f"the answer of planner {query.planner.name!r}", np.asarray(outcome.rows, dtype=np.float64)
    if rows.ndim != 2 or not len(rows) or rows.shape[1] != space.dimension or not np.isfinite(rows).all():
        raise InputError(name, f"finite rows of shape (k, {space.dimension})", f"shape {rows.shape}")
    ends = [("start", rows[0], space.row_of(query.file.start))]
    count = len(query.goals)
    if sorted(outcome.order) != list(range(count)) or len(outcome.goals) != count:
        got = f"goals {tuple(outcome.goals)} and order {tuple(outcome.order)}"
        raise InputError(name, f"the row at which each of {count} goals is reached, in the order of travel", got)
    if any(not 0 <= place < len(rows) for place in outcome.goals) or list(outcome.goals) != sorted(outcome.goals):
        raise InputError(name, f"goals that are increasing indices below {len(rows)}", tuple(outcome.goals))
    for place, number in zip(outcome.goals, outcome.order, strict=True):
        if query.goals[number].is_configuration:
            ends.append((f"goal {number + 1}", rows[place], space.row_of(query.goals[number])))
    for end, row, wanted in ends:
        if not np.allclose(row, wanted, rtol=0.0, atol=_ROUNDING):
            raise InputError(name, f"the {end} {wanted.tolist()} on the path", row.tolist())
    return rows


def path_states(
    query: Scenario, checker: ValidityChecker, outcome: SearchOutcome
) -> tuple[FloatArray, list[tuple[int, Goal]]]:
    """Returns a found path's states at most step_m apart, and which of them must reach which goal.

    Raises:
        InputError: The path does not lead from the start to all goals.
    """
    rows = check_outcome(query, checker.space, outcome)
    edges = EdgeChecker(checker, query.planner.step_m)
    parts = [rows[:1]]
    index = [0]
    for first, second in pairwise(rows):
        states = edges.subdivide(first, second)
        if query.file.limits.accelerations:
            states = smooth_states(checker.space, states)
        parts.append(states[1:])
        index.append(index[-1] + len(parts[-1]))
    goals = [(index[place], query.goals[number]) for place, number in zip(outcome.goals, outcome.order, strict=True)]
    return np.concatenate(parts), goals


def tension_path(query: Scenario, space: ConfigurationSpace, states: SolvedStates, order: Sequence[int]) -> TensionPath:
    """Returns solved states as a path with times from the scenario's limits.

    Args:
        query: The scenario.
        space: Its configurations.
        states: The states, each goal's own marked by its place in the order of travel.
        order: The goals' numbers in the order of travel.
    """
    rows = states.rows
    return TensionPath(
        bending=space.bending(rows),
        insertion=space.insertion(rows),
        roll=space.roll(rows),
        drive=None if space.coordinates.key == "bending_n" else space.drive(rows),
        tensions=states.tensions,
        tendon_displacements=states.displacements,
        tip_positions=states.positions[:, -1],
        times=path_times(query, space, rows, states.tensions),
        goal_states=tuple((int(state), order[states.goals[state]]) for state in np.flatnonzero(states.goals >= 0)),
    )


def path_rows(space: ConfigurationSpace, path: TensionPath) -> FloatArray:
    """Returns a path's configurations, shape (k, dimension)."""
    columns = [path.bending.reshape(len(path), -1) if path.drive is None else path.drive]
    if space.has_insertion:
        columns.append(path.insertion[:, None])
    if space.has_roll:
        columns.append(path.roll[:, None])
    return np.concatenate(columns, axis=1)
