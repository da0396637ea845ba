"""One run of an OMPL planner: its trees, their renewal, and callbacks that cannot bring it down."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.goal import GoalSource
from tdcr_planner.planning.interrupts import forget_frames, interrupts_kept
from tdcr_planner.planning.objectives import PathCost
from tdcr_planner.planning.offered import COMMON_PARAMETERS, FIRST_TREE, OMPL_TRAITS, planner_setters
from tdcr_planner.planning.planner import Progress, convert_parameter
from tdcr_planner.planning.validity import ValidityChecker

_KEPT_SHARE = 0.2  # OMPL's default of the shortest part of a motion that KPIECE1 keeps
_PROGRESS_PERIOD_S = 0.1
_DEFAULT_RANGE = 0.1  # longest edge of a tree, in robot lengths of body motion
_RANGES = 5  # each tree's edges are half as long as the last one's, and after so many trees as long as the first's


@dataclass
class PlannerRun:
    """One run of a planner from a start to a source of goal states.

    Attributes:
        checker: Validity of states.
        edges: Validity of edges.
        name: The planner.
        parameters: Its parameters.
        deadline: When to end, by time.monotonic().
        cost: What the planners that improve their path minimise.
        progress: Told a fraction of the time and a message now and then; may raise to end the search.
        iterations: How often the planner has asked whether to go on, in all of its trees; above 0 to go on counting
            from an earlier run, after whose trees this one's come.
        most: Ends the run once there are so many iterations; 0 for no such end.
        error: What a callback or Ctrl-C has raised, while OMPL runs.
    """

    checker: ValidityChecker
    edges: EdgeChecker
    name: str
    parameters: dict[str, Any]
    deadline: float
    cost: PathCost
    progress: Progress | None = None
    iterations: int = 0
    most: int = 0
    error: BaseException | None = None

    def __post_init__(self) -> None:
        self._begin = time.monotonic()
        self._reported = self._begin
        limits = [limit for limit in (self.most, int(self.parameters.get("iterations", 0))) if limit]
        self._most = min(limits, default=0)
        self._scale = self.checker.motion_scale
        self._trees, self._tree = 0, FIRST_TREE
        self._traits = OMPL_TRAITS[self.name]
        self._renewal = float(FIRST_TREE) if self._traits.begins_anew else math.inf
        while self.iterations >= self._renewal:
            self._next_tree(self._renewal)
        self._samples = 0
        self._over = False
        share = float(self.parameters.get("min_valid_path_fraction", _KEPT_SHARE))
        self._halvings = int(-math.log2(min(max(share, 1e-3), 1.0))) if self._traits.keeps_valid_part else 0

    def run(self, starts: FloatArray, goal: GoalSource, seed: int) -> FloatArray | None:
        """Returns the waypoints of a path, shape (k, dimension), or None.

        Args:
            starts: Valid configurations from one of which the path leads, shape (k, dimension) or (dimension,).
            goal: Where to end; asked for more states while the planner runs.
            seed: Seed of the planner's random numbers, above 0.
        """
        _seed(seed)
        if self._traits.chatty:
            ou.setLogLevel(ou.LOG_NONE)
        space = self._space()
        information = ob.SpaceInformation(space)
        validator = _EdgeValidator(information, self)
        information.setMotionValidator(validator)
        information.setStateValidityChecker(self._state_valid)
        information.setup()
        states = ob.GoalStates(information)
        self._goal, self._states, self._information = goal, states, information
        with interrupts_kept(self._keep):
            rows = self._solve(information, states, np.atleast_2d(starts))
        # The binding keeps what a callback holds alive: without this the planner's tree would never be freed.
        del self._goal, self._states, self._information
        if self.error is not None:
            error, self.error = self.error, None
            forget_frames(error)
            raise error
        return rows

    def _solve(self, information: Any, states: Any, starts: FloatArray) -> FloatArray | None:
        definition = ob.ProblemDefinition(information)
        for start in starts:
            first = information.allocState()
            self._write(first, start)
            definition.addStartState(first)
        self._offer()
        if self.error is None and not states.hasStates():
            return None
        definition.setGoal(states)
        if self.cost.plain:
            definition.setOptimizationObjective(ob.PathLengthOptimizationObjective(information))
        else:
            definition.setOptimizationObjective(_CostObjective(information, self))
        condition = ob.PlannerTerminationCondition(self._stop)
        while self.error is None:
            planner = getattr(og, self.name)(information)
            self._configure(planner)
            planner.setProblemDefinition(definition)
            planner.setup()
            planner.solve(condition)
            if definition.hasExactSolution() or self._over or not self._renew(planner):
                break
            definition.clearSolutionPaths()
        if self.error is not None or not definition.hasExactSolution():
            return None
        path = definition.getSolutionPath()
        return np.array([self._read(path.getState(index)) for index in range(path.getStateCount())])

    def _renew(self, planner: Any) -> bool:
        """Returns whether to search again from the start, with more samples or longer; not where a planner gave up."""
        if self._traits.single_shot:
            self._samples = max(2 * self._samples, 2 * planner.getNumSamples())
            return not self._stop()
        if self.iterations < self._renewal:
            return False
        self._next_tree(self.iterations)
        return True

    def _next_tree(self, begun: float) -> None:
        """Takes note that a tree begins after so many iterations: a larger one of shorter edges."""
        self._trees += 1
        self._tree *= 2
        self._renewal = begun + self._tree

    def _configure(self, planner: Any) -> None:
        setters = planner_setters(self.name)
        if "range" in setters and "range" not in self.parameters:
            planner.setRange(_DEFAULT_RANGE * self.checker.robot.length / 2.0 ** (self._trees % _RANGES))
        for key, value in self.parameters.items():
            if key not in COMMON_PARAMETERS:
                setter, kind = setters[key]
                getattr(planner, setter)(convert_parameter(key, value, kind))
        if self._samples:
            planner.setNumSamples(self._samples)

    def _space(self) -> Any:
        """Returns the space whose coordinates are metres of motion of the body (row times motion scale)."""
        rows = self.checker.space
        space = ob.RealVectorStateSpace(rows.dimension)
        bounds = ob.RealVectorBounds(rows.dimension)
        for index in range(rows.dimension):
            bounds.setLow(index, float(rows.lower[index] * self._scale[index]))
            bounds.setHigh(index, float(rows.upper[index] * self._scale[index]))
        space.setBounds(bounds)
        return space

    def _read(self, state: Any) -> FloatArray:
        return np.array([state[index] for index in range(len(self._scale))]) / self._scale

    def _write(self, state: Any, row: FloatArray) -> None:
        for index, value in enumerate((row * self._scale).tolist()):
            state[index] = value

    def _offer(self) -> None:
        """Adds goal states that the source has found since the last call."""
        for row in self._goal.take():
            state = self._information.allocState()
            self._write(state, row)
            self._states.addState(state)

    def _keep(self, error: BaseException) -> None:
        """Keeps the first error, which ends the search."""
        if self.error is None:
            self.error = error

    # These callbacks run inside OMPL. What they raise is kept and ends the search; `run` raises it outside.

    def _state_valid(self, state: Any) -> bool:
        if self.error is not None:
            return False
        try:
            return bool(self.edges.state_valid(self._read(state)))
        except BaseException as error:
            self.error = error
            return False

    def edge_valid(self, state_a: Any, state_b: Any) -> bool:
        """Returns whether an edge of the planner is valid.

        For KPIECE1, whether the edge or its first half, quarter ... is, of which state_b is made the end: the planner
        adds to its tree what state_b holds, and asks about no other edges than those of its tree.
        """
        if self._over or self.error is not None:
            return False
        try:
            if time.monotonic() >= self.deadline:
                # AORRTC can add edges to its trees for ever without asking whether to go on.
                self._over = True
                return False
            start, end = self._read(state_a), self._read(state_b)
            for halving in range(self._halvings + 1):
                if self.edges.check_edge(start, end):
                    if halving:
                        self._write(state_b, end)
                    return True
                end = 0.5 * (start + end)
            return False
        except BaseException as error:
            self.error = error
            return False

    def price(self, state_a: Any, state_b: Any, least: bool) -> float:
        """Returns the cost of an edge of the planner, or the least that it can be."""
        if self.error is not None:
            return 0.0
        try:
            measure = self.cost.length if least else self.cost.edge
            return float(measure(self._read(state_a), self._read(state_b)))
        except BaseException as error:
            self.error = error
            return 0.0

    def _stop(self) -> bool:
        if self._over or self.error is not None:
            return True
        try:
            self.iterations += 1
            now = time.monotonic()
            if now >= self.deadline or (self._most and self.iterations >= self._most):
                self._over = True
                return True
            if self._goal.due(self.iterations):
                self._goal.search()
                self._offer()
            if self.progress is not None and now - self._reported > _PROGRESS_PERIOD_S:
                self._reported = now
                share = (now - self._begin) / max(self.deadline - self._begin, 1e-9)
                self.progress(share, f"{self.edges.edges_checked} edges, {self.checker.states_checked} states")
            return self.iterations >= self._renewal
        except BaseException as error:
            self.error = error
            return True


class _EdgeValidator(ob.MotionValidator):
    """OMPL's question about an edge, passed on. It must not keep the space information: that leaks it for good."""

    def __init__(self, information: Any, run: PlannerRun) -> None:
        super().__init__(information)
        self._run = run

    def checkMotion(self, state_a: Any, state_b: Any, *_: Any) -> bool:  # noqa: N802
        """Returns whether the edge is valid; the form that asks for the last valid state is answered the same way."""
        return self._run.edge_valid(state_a, state_b)


class _CostObjective(ob.OptimizationObjective):
    """OMPL's question about costs, passed on."""

    def __init__(self, information: Any, run: PlannerRun) -> None:
        super().__init__(information)
        self._run = run

    def stateCost(self, _: Any) -> Any:  # noqa: N802
        """Returns no cost: only motion has one."""
        return ob.Cost(0.0)

    def motionCost(self, state_a: Any, state_b: Any) -> Any:  # noqa: N802
        """Returns the cost of an edge."""
        return ob.Cost(self._run.price(state_a, state_b, least=False))

    def motionCostHeuristic(self, state_a: Any, state_b: Any) -> Any:  # noqa: N802
        """Returns the least that an edge between two states can cost."""
        return ob.Cost(self._run.price(state_a, state_b, least=True))


def _seed(seed: int) -> None:
    """Seeds OMPL; it warns when a generator exists already, though planners built afterwards do follow the seed."""
    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(int(seed))
    ou.setLogLevel(ou.LOG_ERROR)
