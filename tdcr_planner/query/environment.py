"""The environment of queries: a scene's meshes, fields, space and shape models, built once, and roadmaps of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.body import RobotBody, Shaft
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.errors import DomainError, InputError
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.planner import Progress
from tdcr_planner.planning.roadmap import Conditions, Roadmap, conditions_of
from tdcr_planner.planning.roadmap_build import RoadmapBuilder
from tdcr_planner.planning.scenario import Scenario, Validity
from tdcr_planner.planning.scene import differences, geometry_sha256, load_scene_meshes, scene_facts, scene_files
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import ValidityChecker, planning_margins
from tdcr_planner.query.verification import Verifier
from tdcr_planner.robot import refuse_unknown
from tdcr_planner.shape.base import ShapeModel
from tdcr_planner.shape.registry import SHAPE_MODELS


class Environment:
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
        self._refuse_validity(scenario)
        self.scenario = scenario
        self._files = scene_files(scenario)
        self._facts = scene_facts(scenario, self._files)
        self.space = ConfigurationSpace(scenario)
        self.meshes = load_scene_meshes(scenario)
        self.scene = CollisionScene(self.meshes, self._body(np.zeros(scenario.robot.disk_count)))
        self.roadmap: Roadmap | None = None
        self._models: dict[str, ShapeModel] = {}
        self._warm: set[str] = set()
        self._chosen = _engine_of(scenario)
        self._check_loads()
        self.warm_up(scenario)

    @staticmethod
    def _refuse_validity(query: Scenario) -> None:
        """Raises InputError where the shape model that a query asks does not know its robot."""
        known = SHAPE_MODELS.find(query.planner.validity).knows
        try:
            refuse_unknown(query.robot, known, f"validity = {query.planner.validity!r}")
        except InputError as error:
            offered = [name for name in SHAPE_MODELS.names() if query.robot.features <= SHAPE_MODELS.find(name).knows]
            names = " or ".join(repr(name) for name in offered)
            raise InputError(
                error.name, error.expected, f"{error.got}; for this robot use validity = {names}"
            ) from None

    def _check_loads(self) -> None:
        """Raises DomainError when gravity or tip force lie outside the model's domain, whatever the configuration."""
        gravity, tip_force = self.scenario.gravity, self.scenario.tip_force
        keys = {"gravity": ("gravity_m_s2", "m/s^2", gravity), "tip_force": ("tip_force_n", "N", tip_force)}
        model = self.model(self.scenario.planner.validity)
        try:
            at_rest = self.space.coordinates.driven(np.zeros((1, self.space.bending_count)))
            model.disk_poses(at_rest, gravity=gravity, tip_force=tip_force)
        except DomainError as error:
            if error.name not in keys:
                raise
            key, unit, vector = keys[error.name]
            raise DomainError(
                f"scenario {key}",
                error.expected,
                f"{np.linalg.norm(vector):g} {unit}; for more, raise [domain] {key} in train.toml and train again",
            ) from error

    def warm_up(self, query: Scenario) -> None:
        """Answers a little with a query's shape model, once a model.

        What the first answers cost, as compiling and loading do, is then no part of a query's time.
        """
        if query.planner.validity in self._warm:
            return
        self._refuse_validity(query)
        self._warm.add(query.planner.validity)
        self.model(query.planner.validity).warm_up()
        row = self.space.row_of(query.file.start)
        rows = np.stack([row, row + 1e-3 * (0.5 * (self.space.lower + self.space.upper) - row)])
        EdgeChecker(self.checker(query), query.planner.step_m).check_edge(*rows)
        self.verifier(query).verify(rows)

    def _body(self, margins: FloatArray) -> RobotBody:
        radius = self.scenario.file.base.shaft_radius_m
        shaft = None if radius is None else Shaft(radius, self.scenario.base_position)
        return RobotBody(self.scenario.robot, margins, shaft)

    def model(self, validity: Validity) -> ShapeModel:
        """Returns the shape model of that name, loaded at its first use.

        Raises:
            InputError: There is no such model, or it needs a file and the scenario names none.
        """
        if validity not in self._models:
            kind, file = SHAPE_MODELS.find(validity), self.scenario.shape_model_path
            if kind.needs_file and file is None:
                raise InputError("validity", "a scenario that names a shape_model", repr(validity))
            self._models[validity] = kind.load(self.scenario.robot, file)
            if kind.needs_file:
                self._choose(self._models[validity], self.scenario)
        return self._models[validity]

    def _choose(self, model: ShapeModel, query: Scenario) -> None:
        """Lets a model of a file be evaluated, and state its bound, as a query says."""
        settings = query.planner
        model.use(engine=settings.shape_engine, device=settings.shape_device, bound=settings.error_bound)
        self._chosen = _engine_of(query)

    def use_model(self, name: str, model: ShapeModel) -> None:
        """Answers queries that ask the shape model of a name with a given one."""
        self._models[name] = model

    def checker(self, scenario: Scenario | None = None, *, extra_margin: float | FloatArray = 0.0) -> ValidityChecker:
        """Returns a validity checker for a scenario of this scene, with the margins of its model.

        Args:
            scenario: A scenario in the same scene; None for the session's own.
            extra_margin: Added to the disks' margins, one for all or shape (d,), m.
        """
        query = scenario or self.scenario
        model = self.model(query.planner.validity)
        if _engine_of(query) != self._chosen and SHAPE_MODELS.find(query.planner.validity).needs_file:
            self._choose(model, query)
        margins = planning_margins(query, model) + extra_margin
        base = np.maximum(margins - model.error_bound, 0.0)
        return ValidityChecker(self.space, model, self.scene.with_margins(margins), base_margins=base)

    def verifier(self, scenario: Scenario | None = None, *, refine: int = 1) -> Verifier:
        """Returns a verifier for a scenario of this scene, at steps `refine` times finer than its own."""
        query = scenario or self.scenario
        return Verifier(
            self.space,
            self.scene,
            step=query.planner.step_m / refine,
            clearance=query.required_clearance,
            model=self.model(query.planner.validity),
        )

    def conditions(self, scenario: Scenario | None = None) -> Conditions:
        """Returns what a roadmap must have been made under to serve a scenario of this scene."""
        query = scenario or self.scenario
        return conditions_of(query, self.model(query.planner.validity), self._facts)

    def hashes(self, query: Scenario) -> dict[str, str]:
        """Returns the SHA-256 of what decides a query's answer: scenario, robot mechanics, geometry, shape model."""
        found = {"scenario": query.sha256, "robot": query.robot.mechanics_hash}
        found["geometry"] = geometry_sha256(self.meshes)
        model = self.model(query.planner.validity).sha256
        return found if model is None else {**found, "shape_model": model}

    def roadmap_builder(self, *, seed: int | None = None) -> RoadmapBuilder:
        """Returns a builder of roadmaps for this scene, at the scenario's margins and from its start.

        Args:
            seed: Seed of the sampling; None for the scenario's.
        """
        settings = self.scenario.planner
        return RoadmapBuilder(
            EdgeChecker(self.checker(), settings.step_m),
            conditions=self.conditions(),
            seed=settings.seed if seed is None else seed,
            first=self.space.row_of(self.scenario.file.start)[None],
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
            progress: Called with the completed fraction and a message now and then.
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

    def check_same_scene(self, query: Scenario) -> Scenario:
        """Returns the scenario if its scene is the session's: files count by what they hold, not by their paths."""
        problems = differences(self._facts, scene_facts(query, self._files))
        if problems:
            raise InputError("scenario", "one in the session's scene", f"{query.path}, which differs: {problems[0]}")
        return query


def _engine_of(query: Scenario) -> tuple[str | None, str, str]:
    """Returns what a query says of the evaluation of a model file."""
    return query.planner.shape_engine, query.planner.shape_device, query.planner.error_bound
