"""The planning session: everything a scene needs, built once, and plan, verify, repair on top of it."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.attempt import RULED_OUT_M, Attempt
from tdcr_planner.collision.body import RobotBody, Shaft
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.errors import DomainError, InputError
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.ompl_planner import Progress, SearchOutcome, search
from tdcr_planner.planning.path import TensionPath
from tdcr_planner.planning.roadmap import Conditions, Roadmap, conditions_of
from tdcr_planner.planning.roadmap_build import RoadmapBuilder
from tdcr_planner.planning.roadmap_way import RoadmapConnector
from tdcr_planner.planning.scenario import Goal, Scenario, Validity
from tdcr_planner.planning.scene import differences, geometry_sha256, load_scene_meshes, scene_facts, scene_files
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.timing import path_times
from tdcr_planner.planning.validity import ValidityChecker, planning_margins
from tdcr_planner.result import PlanResult, PlanStatus, library_versions
from tdcr_planner.robot import refuse_unknown
from tdcr_planner.shape.base import ShapeModel
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape
from tdcr_planner.shape.reference import ReferenceShape
from tdcr_planner.solved_states import SolvedStates
from tdcr_planner.verification import VerificationReport, Verifier

__all__ = [
    "PlanResult",
    "PlanStatus",
    "PlanningSession",
    "library_versions",
    "load_scene_meshes",
    "plan",
    "verify",
]

# Part of the time limit that the search leaves to verification, and its most.
VERIFY_SHARE = 0.2
VERIFY_RESERVE_S = 1.0

logger = logging.getLogger(__name__)


class PlanningSession:
    """Robot, shape models, meshes and distance fields of one scene, shared by all queries in it.

    Attributes:
        scenario: The scenario that it was made for.
        space: Its configurations.
        meshes: Its meshes, world frame.
        scene: The scene with the robot's body as it is, without margins.
        roadmap: The roadmap that queries ask before their planner, or None.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Loads and builds everything; see `load_scenario`.

        Raises:
            FormatError: A mesh or model cannot be used.
            InputError: The robot has what planning does not know.
            RobotMismatchError: The shape model was made for another robot.
        """
        refuse_unknown(scenario.robot, (), "the planner")
        self.scenario = scenario
        self._files = scene_files(scenario)
        self._facts = scene_facts(scenario, self._files)
        self.space = ConfigurationSpace(scenario)
        self.meshes = load_scene_meshes(scenario)
        self.scene = CollisionScene(self.meshes, self._body(np.zeros(scenario.robot.disk_count)))
        self.roadmap: Roadmap | None = None
        self._models: dict[Validity, ShapeModel] = {}
        self._check_loads()
        self._warm_up()

    def _check_loads(self) -> None:
        """Raises DomainError when gravity or tip force lie outside the model's domain, whatever the configuration."""
        gravity, tip_force = self.scenario.gravity, self.scenario.tip_force
        keys = {"gravity": ("gravity_m_s2", "m/s^2", gravity), "tip_force": ("tip_force_n", "N", tip_force)}
        model = self.model(self.scenario.planner.validity)
        try:
            model.disk_poses(self.scenario.robot.pretensions[None], gravity=gravity, tip_force=tip_force)
        except DomainError as error:
            if error.name not in keys:
                raise
            key, unit, vector = keys[error.name]
            raise DomainError(
                f"scenario {key}",
                error.expected,
                f"{np.linalg.norm(vector):g} {unit}; for more, raise [domain] {key} in train.toml and train again",
            ) from error

    def _warm_up(self) -> None:
        """Runs the compiled kernels once, so that compiling them does not count against a query's time limit."""
        start = self.scenario.file.start
        row = self.space.row(start.bending_n, start.insertion_m, start.roll_deg)
        rows = np.stack([row, row + 1e-3 * (0.5 * (self.space.lower + self.space.upper) - row)])
        EdgeChecker(self.checker(), self.scenario.planner.step_m).check_edge(*rows)
        self.verifier().verify(rows)

    def _body(self, margins: FloatArray) -> RobotBody:
        radius = self.scenario.file.base.shaft_radius_m
        shaft = None if radius is None else Shaft(radius, self.scenario.base_position)
        return RobotBody(self.scenario.robot, margins, shaft)

    def model(self, validity: Validity) -> ShapeModel:
        """Returns the shape model of that name, loaded at its first use."""
        if validity not in self._models:
            self._models[validity] = self._load_model(validity)
        return self._models[validity]

    def _load_model(self, validity: Validity) -> ShapeModel:
        if validity == "reference":
            return ReferenceShape(self.scenario.robot)
        if validity == "constant_curvature":
            return ConstantCurvatureShape(self.scenario.robot)
        # torch takes seconds to import: only a query that asks the learned model pays for it.
        from tdcr_planner.shape.learned import load_shape_model

        if self.scenario.shape_model_path is None:
            raise InputError("validity", "a scenario that names a shape_model", "'learned'")
        return load_shape_model(self.scenario.shape_model_path, self.scenario.robot)

    def checker(self, scenario: Scenario | None = None, *, extra_margin: float = 0.0) -> ValidityChecker:
        """Returns a validity checker for a scenario of this scene, with the margins of its model.

        Args:
            scenario: A scenario in the same scene; None for the session's own.
            extra_margin: Added to every disk's margin, m.
        """
        query = scenario or self.scenario
        model = self.model(query.planner.validity)
        margins = planning_margins(query, model) + extra_margin
        return ValidityChecker(self.space, model, self.scene.with_margins(margins))

    def verifier(self, scenario: Scenario | None = None, *, refine: int = 1) -> Verifier:
        """Returns a verifier for a scenario of this scene, at steps `refine` times finer than its own."""
        query = scenario or self.scenario
        return Verifier(
            self.space,
            self.scene,
            step=query.planner.step_m / refine,
            clearance=query.planner.clearance_m,
            model=self.model(query.planner.validity),
        )

    def conditions(self, scenario: Scenario | None = None) -> Conditions:
        """Returns what a roadmap must have been made under to serve a scenario of this scene."""
        query = scenario or self.scenario
        return conditions_of(query, self.model(query.planner.validity), self._facts)

    def roadmap_builder(self, *, seed: int | None = None) -> RoadmapBuilder:
        """Returns a builder of roadmaps for this scene, at the scenario's margins and from its start.

        Args:
            seed: Seed of the sampling; None for the scenario's.
        """
        settings, start = self.scenario.planner, self.scenario.file.start
        return RoadmapBuilder(
            EdgeChecker(self.checker(), settings.step_m),
            conditions=self.conditions(),
            seed=settings.seed if seed is None else seed,
            first=self.space.row(start.bending_n, start.insertion_m, start.roll_deg)[None],
        )

    def build_roadmap(
        self,
        *,
        time_limit_s: float = 30.0,
        vertices: int | None = None,
        seed: int | None = None,
        progress: Progress | None = None,
    ) -> Roadmap:
        """Returns a roadmap built for this scene; `use_roadmap` puts it to use.

        Ctrl-C and what the progress callback raises pass through; a `roadmap_builder` keeps what was built by then.

        Args:
            time_limit_s: Time for the build; may be infinite where a number of vertices is given.
            vertices: Number of vertices to end at; None for the time alone.
            seed: Seed of the sampling; None for the scenario's. It decides the roadmap where the number of vertices
                ends the build.
            progress: Told the share that is done and a remark now and then.
        """
        builder = self.roadmap_builder(seed=seed)
        builder.run(time_limit_s=time_limit_s, vertices=vertices, progress=progress)
        return builder.roadmap()

    def use_roadmap(self, roadmap: Roadmap | str | Path | None) -> None:
        """Lets queries ask a roadmap before their planner; None for the planner alone.

        A query in the session that asks for another shape model, more clearance or a finer step than the roadmap was
        made for is answered by its planner.

        Args:
            roadmap: The roadmap, or the file that holds it.

        Raises:
            FormatError: The file is missing, damaged or no roadmap.
            InputError: It was made for another scene, robot or model, less clearance or a coarser step.
        """
        name = "roadmap"
        if isinstance(roadmap, str | Path):
            roadmap, name = Roadmap.load(roadmap), str(roadmap)
        if roadmap is not None:
            roadmap.check_fit(self.conditions(), name)
        self.roadmap = roadmap

    def plan(
        self, scenario: Scenario | None = None, *, load_s: float = 0.0, progress: Progress | None = None
    ) -> PlanResult:
        """Searches a path, verifies it with the reference and repairs it within the time limit.

        A roadmap in use is asked first; the planner searches where it has no way. Where verification finds too little
        clearance, the search is repeated with a margin grown by what was missing;
        where the reference has no stable shape or breaks a limit, with that state's neighbourhood ruled out.

        Args:
            scenario: A scenario in the same scene, for example with another start, goal or planner; None for the
                session's own.
            load_s: Seconds that loading took, for the result's timings.
            progress: Told a fraction of the time limit and a remark now and then.

        Raises:
            InputError: The scenario is of another scene, or its planner is not offered.
        """
        query = self._check_same_scene(scenario or self.scenario)
        started = time.monotonic()
        deadline = started + query.planner.time_limit_s
        attempt = Attempt(query)
        while True:
            begin = time.monotonic()
            checker = self._attempt_checker(attempt)
            outcome = self._search(attempt, checker, deadline - begin, progress)
            attempt.add_search(outcome, time.monotonic() - begin)
            if not outcome.found:
                break
            begin = time.monotonic()
            rows, goals = self.path_states(query, checker, outcome)
            report, states = self.verifier(query).verify(rows, goals, deadline=deadline)
            attempt.add_verification(report, states, time.monotonic() - begin)
            if report.verified or time.monotonic() >= deadline:
                break
            logger.info("repair %d: %s", attempt.repairs + 1, report.message)
            attempt.learn()
        return self._result(attempt, load_s, time.monotonic() - started)

    def _attempt_checker(self, attempt: Attempt) -> ValidityChecker:
        checker = self.checker(attempt.query, extra_margin=attempt.extra_margin)
        for row in attempt.ruled_out:
            checker.rule_out(row, RULED_OUT_M)
        return checker

    def _search(
        self, attempt: Attempt, checker: ValidityChecker, left_s: float, progress: Progress | None
    ) -> SearchOutcome:
        """Searches within the time left, of which verification keeps its share."""
        query = attempt.query
        limit = max(left_s - min(VERIFY_SHARE * left_s, VERIFY_RESERVE_S), 0.01)
        seed = query.planner.seed + attempt.repairs
        roadmap, unfit = self.roadmap, ""
        if roadmap is not None:
            unfit = roadmap.conditions.unfit_for(self.conditions(query))
        connector = None if roadmap is None or unfit else RoadmapConnector(roadmap)
        outcome = search(
            query, self.space, checker, time_limit_s=limit, seed=seed, progress=progress, connector=connector
        )
        if roadmap is None:
            return outcome
        known = roadmap.size | ({"answered": False, "unfit": unfit} if connector is None else connector.answers)
        return replace(outcome, statistics=outcome.statistics | {"roadmap": known})

    def path_states(
        self, query: Scenario, checker: ValidityChecker, outcome: SearchOutcome
    ) -> tuple[FloatArray, list[tuple[int, Goal]]]:
        """Returns a found path's states at most step_m apart, and which of them must reach which goal."""
        assert outcome.rows is not None  # a path was found
        edges = EdgeChecker(checker, query.planner.step_m)
        parts = [outcome.rows[:1]]
        index = [0]
        for first, second in pairwise(outcome.rows):
            parts.append(edges.subdivide(first, second)[1:])
            index.append(index[-1] + len(parts[-1]))
        goals = [
            (index[place], query.goals[number]) for place, number in zip(outcome.goals, outcome.order, strict=True)
        ]
        return np.concatenate(parts), goals

    def _check_same_scene(self, query: Scenario) -> Scenario:
        """Returns the scenario if its scene is the session's: files count by what they hold, not by their paths."""
        problems = differences(self._facts, scene_facts(query, self._files))
        if problems:
            raise InputError("scenario", "one in the session's scene", f"{query.path}, which differs: {problems[0]}")
        return query

    def tension_path(self, query: Scenario, states: SolvedStates, order: Sequence[int]) -> TensionPath:
        """Returns solved states as a path with times from the scenario's limits.

        Args:
            query: The scenario.
            states: The states, each goal's own marked by its place in the order of travel.
            order: The goals' numbers in the order of travel.
        """
        rows = states.rows
        return TensionPath(
            bending=self.space.bending(rows),
            insertion=self.space.insertion(rows),
            roll=self.space.roll(rows),
            tensions=states.tensions,
            tendon_displacements=states.displacements,
            tip_positions=states.positions[:, -1],
            times=path_times(query, self.space, rows, states.tensions),
            goal_states=tuple((int(state), order[states.goals[state]]) for state in np.flatnonzero(states.goals >= 0)),
        )

    def rows(self, path: TensionPath) -> FloatArray:
        """Returns a path's configurations, shape (k, dimension)."""
        columns = [path.bending.reshape(len(path), -1)]
        if self.space.has_insertion:
            columns.append(path.insertion[:, None])
        if self.space.has_roll:
            columns.append(path.roll[:, None])
        return np.concatenate(columns, axis=1)

    def _result(self, attempt: Attempt, load_s: float, spent_s: float) -> PlanResult:
        status, message = attempt.verdict()
        query = attempt.query
        model = self.model(query.planner.validity)
        hashes = {"scenario": query.sha256, "robot": query.robot.mechanics_hash}
        hashes["geometry"] = geometry_sha256(self.meshes)
        if hasattr(model, "sha256"):
            hashes["shape_model"] = model.sha256
        return PlanResult(
            status=status,
            message=message,
            scenario=query,
            seed=query.planner.seed,
            path=None if attempt.states is None else self.tension_path(query, attempt.states, attempt.order),
            verification=attempt.report,
            repairs=attempt.repairs,
            timings_s={
                "load": load_s,
                "plan": attempt.plan_s,
                "verify": attempt.verify_s,
                "total": load_s + spent_s,
            },
            planner=attempt.statistics,
            hashes=hashes,
            versions=library_versions(),
        )


def plan(scenario: Scenario, *, seed: int | None = None, progress: Progress | None = None) -> PlanResult:
    """Plans and verifies one scenario.

    Args:
        scenario: From `load_scenario`.
        seed: Seed of the search; None for the scenario's.
        progress: Told a fraction of the time limit and a remark now and then.

    Returns:
        The result; no path, a failed verification or an invalid start are a status in it.
    """
    started = time.monotonic()
    query = scenario if seed is None else scenario.with_planner(seed=seed)
    session = PlanningSession(query)
    return session.plan(load_s=time.monotonic() - started, progress=progress)


def verify(result: PlanResult, *, refine: int = 1) -> VerificationReport:
    """Solves every state of a result's path again with the reference and judges it in the result's scene.

    Args:
        result: A result with a path.
        refine: Verify at steps this many times finer than the scenario's step_m.

    Raises:
        InputError: The result has no path.
    """
    if result.path is None:
        raise InputError("result", "a result with a path", f"status {result.status.value!r} without one")
    session = PlanningSession(result.scenario)
    goals = [(state, result.scenario.goals[number]) for state, number in result.path.goal_states]
    report, _ = session.verifier(refine=refine).verify(session.rows(result.path), goals)
    return report
