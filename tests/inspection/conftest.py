"""A robot before a plate with a post between, and a camera: small enough to inspect in seconds."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh

from tdcr_planner.inspection.scene import make_visibility
from tdcr_planner.inspection.visibility import Visibility
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.query.session import PlanningSession

PAPER = Path(__file__).resolve().parents[2] / "models/robots/paper.toml"
INSPECT = {"surfaces": ["plate.stl"], "spacing_m": 0.012}
CAMERA = {
    "position_m": [0.0, 0.0, 0.001],
    "field_of_view_deg": 90.0,
    "range_m": [0.005, 0.15],
    "max_incidence_deg": 75.0,
}
TEMPLATE = """format = "tdcr-scenario/1"
robot = "{robot}"
gravity_m_s2 = [0.0, 0.0, 0.0]
meshes = [{{file = "plate.stl", unit = "m", role = "obstacle"}}, {{file = "post.stl", unit = "m", role = "obstacle"}}]
[base]
insertion_m = [0.0, 0.05]
[start]
bending_n = [[0.0, 0.0]]
[planner]
validity = "constant_curvature"
time_limit_s = {time_limit_s}
step_m = 0.004
seed = {seed}
"""


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return json.dumps(value)


def _write(folder: Path, *, camera: Any = (), time_limit_s: float = 1.5, seed: int = 1, **inspect: Any) -> Scenario:
    """Writes the scenario with other keys of [inspect] and its camera into a folder, and loads it."""
    plate = trimesh.creation.box(extents=(0.3, 0.3, 0.01))
    plate.apply_translation((0.0, 0.0, 0.32))
    plate.export(folder / "plate.stl")
    post = trimesh.creation.box(extents=(0.02, 0.3, 0.02))
    post.apply_translation((0.05, 0.0, 0.29))
    post.export(folder / "post.stl")
    text = TEMPLATE.format(robot=PAPER, time_limit_s=time_limit_s, seed=seed)
    table = {**INSPECT, **inspect}
    if camera is not None:
        table["camera"] = {**CAMERA, **dict(camera)}
    text += "[inspect]\n" + "".join(f"{key} = {_value(value)}\n" for key, value in table.items())
    file = folder / "inspect.toml"
    file.write_text(text)
    return load_scenario(file)


@pytest.fixture(scope="session")
def write_inspection() -> Callable[..., Scenario]:
    """Returns a function that writes the scenario into a folder and loads it."""
    return _write


@pytest.fixture
def make_inspection(tmp_path: Path) -> Callable[..., Scenario]:
    """Returns a function that writes the scenario into a folder of its own and loads it."""

    def make(**changes: Any) -> Scenario:
        return _write(tmp_path, **changes)

    return make


@pytest.fixture
def make_engine(make_inspection: Callable[..., Scenario]) -> Callable[..., tuple[PlanningSession, Visibility]]:
    """Returns a function that gives the session of such a scenario and its visibility tests."""

    def make(**changes: Any) -> tuple[PlanningSession, Visibility]:
        session = PlanningSession(make_inspection(**changes))
        return session, make_visibility(session)

    return make
