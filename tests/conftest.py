"""Fixtures shared by all tests: the shipped robots, the repository's folders, scenarios made on the spot."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.robot import RobotSpec, load_robot

ROOT = Path(__file__).resolve().parents[1]
ROBOT_NAMES = ("paper", "inspection", "two_segment")


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session", params=ROBOT_NAMES)
def any_robot(request: pytest.FixtureRequest) -> RobotSpec:
    return load_robot(ROOT / f"models/robots/{request.param}.toml")


@pytest.fixture(scope="session")
def paper_robot() -> RobotSpec:
    return load_robot(ROOT / "models/robots/paper.toml")


@pytest.fixture(scope="session")
def inspection_robot() -> RobotSpec:
    return load_robot(ROOT / "models/robots/inspection.toml")


@pytest.fixture(scope="session")
def two_segment_robot() -> RobotSpec:
    return load_robot(ROOT / "models/robots/two_segment.toml")


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(20240513)


def to_toml(table: dict[str, Any]) -> str:
    """Returns a table as TOML, nested tables as inline ones."""
    return "".join(f"{key} = {_value(value)}\n" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return json.dumps(value)


def base_table(robot: str = "paper") -> dict[str, Any]:
    """Returns a small valid scenario: a box beside the robot, constant curvature as validity."""
    rows = 2 if robot == "two_segment" else 1
    return {
        "format": "tdcr-scenario/1",
        "robot": str(ROOT / f"models/robots/{robot}.toml"),
        "meshes": [{"file": "box.stl", "unit": "mm", "role": "obstacle"}],
        "start": {"bending_n": [[0.0, 0.0]] * rows},
        "goal": {"bending_n": [[1.0, 0.0]] * rows},
        "planner": {"validity": "constant_curvature"},
    }


@pytest.fixture
def write_scenario(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Returns a function that writes a scenario table beside a 100 mm box 300 mm off the robot and gives its path."""

    def write(table: dict[str, Any]) -> Path:
        box = trimesh.creation.box((100.0, 100.0, 100.0))
        box.apply_translation((300.0, 0.0, 0.0))
        box.export(tmp_path / "box.stl")
        path = tmp_path / "scenario.toml"
        path.write_text(to_toml(table))
        return path

    return write


@pytest.fixture
def make_scenario(write_scenario: Callable[[dict[str, Any]], Path]) -> Callable[..., Scenario]:
    """Returns a function that gives a loaded scenario: the base table of a robot with some keys replaced."""

    def make(robot: str = "paper", **changes: Any) -> Scenario:
        return load_scenario(write_scenario({**base_table(robot), **changes}))

    return make


@dataclass
class BoxScene:
    """Axis-aligned boxes against points on the rims and centres of all disks but the base, and between them."""

    boxes: np.ndarray  # (b, 2, 3) lower and upper corner, m
    margins: np.ndarray  # (d,) m
    radii: np.ndarray  # (d,) m
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
        points = self.body_points(positions, rotations)
        nearest = np.full(points.shape[:2], np.inf)
        for lower, upper in self.boxes:
            outside = np.maximum(np.maximum(lower - points, points - upper), 0.0)
            nearest = np.minimum(nearest, np.linalg.norm(outside, axis=-1).min(axis=2))
        return nearest

    def check(self, positions, rotations):
        assert np.isfinite(positions).all()
        self.asked += len(positions)
        return (self.gaps(positions, rotations) <= self.margins[1:]).any(axis=1).astype(np.int8)

    def first_contact(self, positions, rotations):
        gaps = self.gaps(positions[None], rotations[None])[0]
        touching = np.flatnonzero(gaps <= self.margins[1:])
        return None if not len(touching) else f"disk {touching[0] + 1} with box.stl"

    def clearance(self, positions, rotations):
        return self.gaps(positions, rotations).min(axis=1)


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
        scenario = make_scenario(robot, planner=settings, **changes)
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
