"""A scene of boxes that answers as a collision scene does, and everything the search needs on top of it."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tdcr_planner.collision.slack import SlackRecord
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.scenario import Goal, Scenario, load_scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import ValidityChecker, planning_margins
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape


@dataclass
class BoxScene:
    """Axis-aligned boxes against all disks but the base: balls of the disks' radius, or points of their rims."""

    boxes: np.ndarray  # (b, 2, 3) lower and upper corner, m
    margins: np.ndarray  # (d,) m
    radii: np.ndarray  # (d,) m
    rims: bool = False
    asked: int = 0

    def body_points(self, positions, rotations):
        """Returns points (n, d - 1, 17, 3) on rims and centres."""
        angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(16)], axis=1)
        circle = np.concatenate([circle, np.zeros((1, 3))])
        offsets = self.radii[1:, None, None] * circle
        return positions[:, 1:, None] + np.einsum("ndij,dkj->ndki", rotations[:, 1:], offsets)

    def gaps(self, positions, rotations):
        """Returns the distance of each disk from the nearest box, shape (n, d - 1), m."""
        points = self.body_points(positions, rotations) if self.rims else positions[:, 1:, None]
        nearest = np.full(points.shape[:2], np.inf)
        for lower, upper in self.boxes:
            outside = np.maximum(np.maximum(lower - points, points - upper), 0.0)
            nearest = np.minimum(nearest, np.sqrt((outside**2).sum(axis=-1)).min(axis=2))
        return nearest if self.rims else nearest - self.radii[1:]

    def check(self, positions, rotations):
        assert np.isfinite(positions).all()
        self.asked += len(positions)
        return (self.gaps(positions, rotations) <= self.margins[1:]).any(axis=1).astype(np.int8)

    def find_hit(self, positions, rotations):
        # The first state is the likeliest to hit, so it is asked about alone.
        for start, stop in ((0, 1), (1, len(positions))):
            if start < stop:
                codes = self.check(positions[start:stop], rotations[start:stop])
                hits = np.flatnonzero(codes)
                if len(hits):
                    return start + int(hits[0]), int(codes[hits[0]])
        return -1, 0

    def first_contact(self, positions, rotations):
        gaps = self.gaps(positions[None], rotations[None])[0]
        touching = np.flatnonzero(gaps <= self.margins[1:])
        return None if not len(touching) else f"disk {touching[0] + 1} with box.stl"

    def clearance(self, positions, rotations):
        return self.gaps(positions, rotations).min(axis=1)

    @property
    def prover(self):
        return self

    def record(self, states):
        return SlackRecord.empty(1, states, len(self.radii) - 1)

    def open_intervals(self, positions, rotations, order, motion, stray, record, exact_below):
        slack = (self.gaps(positions, rotations) - self.margins[1:])[order]
        room, moved = slack[:-1] + slack[1:], motion[:, 1:]
        lacking = room < moved
        worst = np.argmax(lacking, axis=1)[:, None]
        left_open = lacking.any(axis=1)
        worst_of = (np.take_along_axis(values, worst, axis=1)[:, 0] for values in (room, moved))
        return tuple(np.where(left_open, values, 0.0) for values in worst_of)

    @property
    def required(self):
        return self.margins[1:]

    def slack(self, positions, rotations, cap):
        return np.minimum((self.gaps(positions, rotations) - self.margins[1:]).min(axis=1), cap)


@pytest.fixture
def make_setup(make_scenario: Callable[..., Scenario]) -> Callable[..., SimpleNamespace]:
    """Returns a function that builds a scenario's space, constant-curvature model, box scene and checkers."""

    def make(
        robot: str = "paper",
        *,
        boxes: Any = (),
        planner: dict[str, Any] | None = None,
        spec: RobotSpec | None = None,
        model: Any = ConstantCurvatureShape,
        **changes: Any,
    ) -> SimpleNamespace:
        settings = {"validity": "constant_curvature", **(planner or {})}
        goals = changes.pop("goals", None)
        scenario = make_scenario(robot, planner=settings, **changes)
        if goals is not None:
            tour = {"goal": None, "goals": tuple(Goal.model_validate(goal) for goal in goals)}
            file = scenario.file.model_copy(update=tour)
            scenario = Scenario(scenario.path, scenario.sha256, file, scenario.robot)
        if spec is not None:
            scenario = Scenario(scenario.path, scenario.sha256, scenario.file, spec)
        space = ConfigurationSpace(scenario)
        shape = model(scenario.robot)
        corners = np.array(boxes, dtype=np.float64).reshape(-1, 2, 3)
        scene = BoxScene(corners, planning_margins(scenario, shape), scenario.robot.disk_radii)
        checker = ValidityChecker(space, shape, scene)
        edges = EdgeChecker(checker, scenario.planner.step_m)
        return SimpleNamespace(scenario=scenario, space=space, model=shape, scene=scene, checker=checker, edges=edges)

    return make


PORT = """format = "tdcr-scenario/1"
robot = "{root}/models/robots/borescope.toml"
[[meshes]]
file = "{mesh}"
unit = "mm"
role = "obstacle"
[base]
position_m = [-0.105, 0.0, 0.0]
quaternion_wxyz = [0.0, 0.70710678, 0.0, 0.70710678]
insertion_m = [0.0, 0.15]
[start]
bending_n = [[0.0, 0.0], [0.0, 0.0]]
[goal]
tip_position_m = {goal}
tip_tolerance_m = 0.002
[planner]
step_m = 0.0005
clearance_m = 0.0001
validity = "constant_curvature"
"""


@pytest.fixture(scope="session")
def port(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., SimpleNamespace]:
    """Returns a function that sets up the borescope before a plate of 10 mm with a hole of a diameter in mm.

    The goal is 20 mm beside the axis and 40 mm behind the plate unless another is given.
    """
    file = root / "scenes/port/make_scene.py"
    spec = importlib.util.spec_from_file_location("make_port", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    folder = tmp_path_factory.mktemp("port")

    @cache
    def make(hole: float = 4.8, goal: tuple[float, float, float] = (0.05, 0.02, 0.0)) -> SimpleNamespace:
        mesh = folder / f"plate_{hole}.stl"
        module.make_plate(hole, 10.0).export(mesh)
        path = folder / f"port_{hole}_{goal[0]}.toml"
        path.write_text(PORT.format(root=root, mesh=mesh, goal=list(goal)))
        session = PlanningSession(load_scenario(path))
        checker = session.checker()
        start = session.space.row([[0.0, 0.0], [0.0, 0.0]])
        edges = EdgeChecker(checker, session.scenario.planner.step_m)
        return SimpleNamespace(session=session, checker=checker, edges=edges, start=start, scenario=session.scenario)

    return make
