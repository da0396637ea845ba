"""A bent pipe, a ball beside it, and results in them that were made up, so that only the report is under test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tdcr_planner.planning.path import TensionPath
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.query.result import PlanResult, PlanStatus
from tdcr_planner.query.verification_report import VerificationReport
from tdcr_planner.se3 import transform_points
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

ROBOTS = Path(__file__).parents[2] / "models" / "robots"
STATES = 12

SCENARIO = """format = "tdcr-scenario/1"
title = "Pipe & <ball>"
robot = "robot.toml"
[[meshes]]
file = "pipe.stl"
unit = "mm"
role = "cavity"
[[meshes]]
file = "ball.stl"
unit = "mm"
role = "obstacle"
[base]
insertion_m = [-0.15, 0.05]
roll_deg = [-180.0, 180.0]
[start]
bending_n = {start}
insertion_m = -0.15
[goal]
tip_position_m = [0.003, 0.0, 0.15]
view_direction = [1.0, 0.0, 0.0]
[planner]
validity = "constant_curvature"
seed = 7
"""


@pytest.fixture
def make_scenario(tmp_path: Path) -> Callable[[str], Scenario]:
    """Writes a scenario for a shipped robot, with its meshes, and loads it."""

    def make(robot: str = "paper") -> Scenario:
        folder = tmp_path / "scene"
        folder.mkdir(exist_ok=True)
        pipe = trimesh.creation.cylinder(radius=14.0, height=180.0, sections=48)
        pipe.apply_translation([0.0, 0.0, 90.0])
        sides = np.abs(pipe.face_normals[:, 2]) < 0.5
        pipe.update_faces(sides)
        pipe.export(folder / "pipe.stl")
        ball = trimesh.creation.icosphere(subdivisions=2, radius=10.0)
        ball.apply_translation([35.0, 5.0, 120.0])
        ball.export(folder / "ball.stl")
        (folder / "robot.toml").write_text((ROBOTS / f"{robot}.toml").read_text(encoding="utf-8"))
        start = "[[0.0, 0.0], [0.0, 0.0]]" if robot == "two_segment" else "[[0.0, 0.0]]"
        (folder / "scenario_pipe.toml").write_text(SCENARIO.format(start=start))
        return load_scenario(folder / "scenario_pipe.toml")

    return make


@pytest.fixture
def make_result(make_scenario: Callable[[str], Scenario]) -> Callable[..., PlanResult]:
    """Makes a result with a path, or one without (found=False)."""

    def make(robot: str = "paper", *, found: bool = True) -> PlanResult:
        scenario = make_scenario(robot)
        if not found:
            return PlanResult(PlanStatus.NO_PATH, "no path in 10 s", scenario, 7, None, None)
        space = ConfigurationSpace(scenario)
        along = np.linspace(0.0, 1.0, STATES)
        rows = np.zeros((STATES, space.dimension))
        rows[:, 0] = 0.4 * along
        rows[:, -2] = -0.15 + 0.1 * along
        rows[:, -1] = 0.5 * along
        actuation = space.actuate(rows)
        poses = ConstantCurvatureShape(scenario.robot).disk_poses(actuation.tensions)
        positions = transform_points(actuation.base_rotations, actuation.base_positions, poses.positions)
        rotations = actuation.base_rotations[:, None] @ poses.rotations
        model_positions = positions + np.array([0.0, 0.001, 0.0])
        deviation = np.full(STATES, 0.001)
        deviation[3] = np.nan
        path = TensionPath(
            bending=space.bending(rows),
            insertion=space.insertion(rows),
            roll=space.roll(rows),
            tensions=actuation.tensions,
            tendon_displacements=0.01 * actuation.tensions,
            tip_positions=positions[:, -1],
            times=6.0 * along,
        )
        report = VerificationReport(
            verified=True,
            message="",
            converged=np.ones(STATES, dtype=np.bool_),
            residual=np.full(STATES, 1e-12),
            deviation=deviation,
            clearance=0.002 - 0.0012 * np.sin(1.1 * np.pi * along),
            in_limits=np.ones(STATES, dtype=np.bool_),
            positions=positions,
            rotations=rotations,
            model_positions=model_positions,
            worst_state=5,
        )
        return PlanResult(
            PlanStatus.VERIFIED,
            "reached </script> the goal",
            scenario,
            7,
            path,
            report,
            repairs=1,
            timings_s={"load": 0.5, "plan": 1.0, "verify": 0.25, "total": 1.75},
            planner={"name": "RRTConnect", "iterations": 31, "rejected": {"cavity": 4}},
            versions={"numpy": np.__version__},
        )

    return make
