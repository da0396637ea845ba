"""Passages: the ways of one leg that follow from its structure, and the states that they give a planner."""

from __future__ import annotations

import time
from functools import cached_property
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.goal import GoalSource
from tdcr_planner.planning.plain_motions import PlainMotions
from tdcr_planner.planning.relaxation import Relaxation, offers_room
from tdcr_planner.planning.retraction import WANTED, Retraction, thinned
from tdcr_planner.planning.shortfall import describe_shortfall

_MOST_ROOTS = 6  # goal states that are retracted before the planner runs
_MOST_MEASURED = 32  # goal states whose room is asked for
_TURN = 12  # steps of one tree before it is tried to join it and the next takes its turn
_TURNS = 20
_TURNS_WHILE_SEARCHING = 4
_JOINED_TRIED = 10  # plain motions tried after each turn


class Passage:
    """One leg's start and goal, and what is known of the ways out of the places in which they lie.

    Pulling out is easier than pushing in, so trees of pulled-back states grow from goal states, and from the start
    where it can be pulled back itself. A plain motion between two of them is a path; where there is none, their states
    are start and goal states of the planner, whose trees need only reach one of them.

    Attributes:
        source: The leg's own goal states.
    """

    def __init__(self, edges: EdgeChecker, start: FloatArray, goal: GoalSource, seed: int, deadline: float) -> None:
        """Prepares the passage of a leg; nothing is tried yet.

        Args:
            edges: Validity of edges.
            start: A valid configuration, shape (dimension,).
            goal: The leg's goal states.
            seed: Seed of what is varied at random.
            deadline: When to end, by time.monotonic().
        """
        self._edges = edges
        self._start = start
        self.source = goal
        self._seed = seed
        self._deadline = deadline
        self._plain = PlainMotions(edges)
        self._from_start: Retraction | None = None
        self._from_goals: list[Retraction] = []
        self._rooted = 0

    @property
    def offered(self) -> bool:
        """Whether the scene can say how much room there is, without which nothing is pulled back."""
        return offers_room(self._edges.checker)

    @cached_property
    def goal(self) -> GoalSource:
        """The leg's goal states and those pulled back from them, for the planner."""
        return _PulledBackGoal(self, self.source)

    @property
    def narrow(self) -> bool:
        """Whether the body lacks room in every goal state, so that pulling back promises more than a tree."""
        if not self.offered:
            return False
        checker = self._edges.checker
        wanted = WANTED * float(checker.robot.disk_radii[1:].min())
        rooms = Relaxation(checker, wanted, wanted).measure(np.array(self.source.rows[:_MOST_MEASURED])).rooms
        return bool(rooms.max() < wanted)

    @property
    def starts(self) -> FloatArray:
        """The start and what has been pulled back from it, shape (k, dimension)."""
        return self._start[None] if self._from_start is None else np.array(self._from_start.rows)

    def by_plain_motions(self) -> FloatArray | None:
        """Returns the waypoints of a plain motion from the start to a goal state, or None."""
        return self._plain.connect(self._start, self.source.rows, self._deadline)

    def by_retraction(self) -> FloatArray | None:
        """Returns the waypoints of a way whose ends were pulled back until a plain motion joined them, or None."""
        self._from_start = Retraction(self._edges, self._start, self._seed)
        self._root(_MOST_ROOTS)
        found = self._grow(self._from_start)
        for _ in range(_TURNS):
            growing = [tree for tree in self._from_goals if not tree.finished]
            if found is not None or not growing or time.monotonic() >= self._deadline:
                break
            for tree in growing:
                found = self._grow(tree)
                if found is not None:
                    break
            if found is None and not self._from_start.finished:
                found = self._grow(self._from_start)
        return found

    def pull_back_more(self) -> None:
        """Pulls back a goal state that has come since."""
        for tree in self._root(1):
            tree.grow(_TURN * _TURNS_WHILE_SEARCHING, self._deadline)

    def pulled_back(self) -> list[FloatArray]:
        """Returns all states pulled back from goal states, the goal states among them."""
        return [row for tree in self._from_goals for row in tree.rows]

    def whole(self, rows: FloatArray) -> FloatArray:
        """Returns a way between pulled-back states, waypoints (k, dimension), led on to start and goal state."""
        parts = [rows]
        if self._from_start is not None:
            parts.insert(0, self._chain([self._from_start], rows[0])[::-1][:-1])
        parts.append(self._chain(self._from_goals, rows[-1])[1:])
        return np.concatenate([part for part in parts if len(part)])

    def statistics(self) -> dict[str, Any]:
        """States, steps, and how far the farthest tree from a goal state was pulled back; empty without any."""
        trees = self._from_goals
        if not trees:
            return {}
        told: dict[str, Any] = {
            "states": sum(len(tree.rows) for tree in trees),
            "steps": sum(tree.steps for tree in trees),
            "out": any(tree.is_out for tree in trees),
        }
        space = self._edges.checker.space
        if space.has_insertion:
            best = self._farthest()
            column = space.bending_count
            told["from_insertion_m"] = float(best.rows[0][column])
            told["to_insertion_m"] = min(float(row[column]) for row in best.rows)
        return told

    def stopped_by(self) -> str:
        """Returns how far a goal state was pulled back and what stopped it, as a part of a sentence; may be empty."""
        told = self.statistics()
        if "to_insertion_m" not in told or told["out"]:
            return ""
        text = f"pulled back from the goal, the body came from insertion {told['from_insertion_m']:.4f} m "
        text += f"to {told['to_insertion_m']:.4f} m"
        obstacle = self._farthest().obstacle
        return text if obstacle is None else f"{text}: {describe_shortfall(self._edges.checker, obstacle.row)}"

    def _farthest(self) -> Retraction:
        column = self._edges.checker.space.bending_count
        return max(self._from_goals, key=lambda tree: tree.rows[0][column] - min(row[column] for row in tree.rows))

    def _root(self, most: int) -> list[Retraction]:
        """Starts trees of goal states that have none yet, up to a number of them."""
        fresh = self.source.rows[self._rooted : self._rooted + most]
        trees = [Retraction(self._edges, row, self._seed + 1 + self._rooted + k) for k, row in enumerate(fresh)]
        self._rooted += len(fresh)
        self._from_goals += trees
        return trees

    def _grow(self, tree: Retraction) -> FloatArray | None:
        """Lets a tree take its turn and tries to join what it has added to the other end of the leg."""
        added = tree.grow(_TURN, self._deadline)
        if not added or self._from_start is None:
            return None
        # The states last added are pulled back farthest.
        rows = [tree.rows[number] for number in sorted({added[-1], added[len(added) // 2]}, reverse=True)]
        if tree is self._from_start:
            ends = [goal for other in self._from_goals for goal in (other.rows[0], other.rows[-1])]
            starts = rows
        else:
            ends, starts = rows, [self._start, self._from_start.rows[-1]]
        for start in starts:
            found = self._plain.connect(start, ends, self._deadline, _JOINED_TRIED)
            if found is not None:
                return self.whole(found)
        return None

    def _chain(self, trees: list[Retraction], row: FloatArray) -> FloatArray:
        """Returns the states from one of the trees' to that tree's root, without those that can be left out."""
        for tree in trees:
            for number, known in enumerate(tree.rows):
                if np.array_equal(known, row):
                    return thinned(self._edges, tree.chain(number))
        return row[None]


class _PulledBackGoal:
    """The goal states of a leg and those pulled back from them, as a planner asks for goal states."""

    def __init__(self, passage: Passage, source: GoalSource) -> None:
        self._passage = passage
        self._source = source
        self._fresh = list(source.rows)
        source.take()
        self._pulled = 0

    @property
    def rows(self) -> list[FloatArray]:
        """All of them."""
        return [*self._source.rows, *self._passage.pulled_back()]

    def take(self) -> list[FloatArray]:
        """Returns those found since the last call."""
        pulled = self._passage.pulled_back()
        fresh = [*self._fresh, *self._source.take(), *pulled[self._pulled :]]
        self._fresh, self._pulled = [], len(pulled)
        return fresh

    def due(self, iterations: int) -> bool:
        """Returns whether it is time to look for more."""
        return self._source.due(iterations)

    def search(self) -> None:
        """Looks for more goal states and pulls one back."""
        self._source.search()
        self._passage.pull_back_more()

    def unreachable(self) -> str:
        """Returns why the goal cannot be one; see `GoalSource`."""
        return self._source.unreachable()

    def obstruction(self) -> str:
        """Returns what is in the way of the goal; see `GoalSource`."""
        return self._source.obstruction()

    def exhausted(self) -> bool:
        """Returns whether looking for more has stopped gaining."""
        return self._source.exhausted()

    def satisfied(self, row: FloatArray) -> bool:
        """Returns whether a configuration reaches the goal."""
        return self._source.satisfied(row)
