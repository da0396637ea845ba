"""The shipped scenes: generators, meshes as trimesh reads them, scenarios with the reference's shapes."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.body import RobotBody, Shaft
from tdcr_planner.collision.scene import CollisionScene
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.planning.scene import load_scene_meshes
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import ValidityChecker
from tdcr_planner.shape.reference import ReferenceShape


@pytest.fixture(scope="session")
def scenes(root: Path) -> Path:
    return root / "scenes"


@pytest.fixture(scope="session")
def generator(scenes: Path) -> Callable[[str], ModuleType]:
    """Returns a function that gives the generator of a scene as a module."""

    @cache
    def load(scene: str) -> ModuleType:
        spec = importlib.util.spec_from_file_location(f"make_{scene}", scenes / scene / "make_scene.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # dataclasses look their module up there
        spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture(scope="session")
def shipped(scenes: Path) -> Callable[[str], trimesh.Trimesh]:
    """Returns a function that gives a shipped mesh, "duct/duct.stl", in mm."""
    return cache(lambda name: trimesh.load_mesh(scenes / name))


@pytest.fixture(scope="session")
def reference_setup(scenes: Path) -> Callable[[str], SimpleNamespace]:
    """Returns a function that gives a scenario with a checker that asks the reference and keeps the clearance asked.

    Meshes are shared by the scenarios of a scene that name the same ones.
    """
    loaded = {}

    def meshes(scenario: Scenario):
        named = (scenario.path.parent, *map(repr, scenario.file.meshes))
        if named not in loaded:
            loaded[named] = load_scene_meshes(scenario)
        return loaded[named]

    @cache
    def setup(name: str) -> SimpleNamespace:
        scenario: Scenario = load_scenario(scenes / name)
        base = scenario.file.base
        shaft = None if base.shaft_radius_m is None else Shaft(base.shaft_radius_m, scenario.base_position)
        margins = np.full(scenario.robot.disk_count, scenario.planner.clearance_m)
        space = ConfigurationSpace(scenario)
        scene = CollisionScene(meshes(scenario), RobotBody(scenario.robot, margins, shaft))
        checker = ValidityChecker(space, ReferenceShape(scenario.robot), scene)
        return SimpleNamespace(scenario=scenario, space=space, scene=scene, checker=checker)

    return setup
