"""Constant curvature along a path is off by what gravity bends the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.compare.along_path import arcs_along_path
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

SCENES = Path(__file__).parents[2] / "scenes"


@pytest.fixture(scope="module")
def session() -> PlanningSession:
    return PlanningSession(load_scenario(SCENES / "duct" / "scenario_mouth.toml"))


def test_a_robot_that_sags_is_off_by_the_distance_of_its_tips(session: PlanningSession) -> None:
    result = session.plan()
    assert result.path is not None
    found = arcs_along_path(session, result)
    assert found is not None
    arcs = ConstantCurvatureShape(result.scenario.robot).disk_poses(result.path.tensions)
    tips = np.array(result.path.tip_positions)
    base = (
        result.scenario.base_position + np.array(result.path.insertion)[:, None] * result.scenario.base_rotation[:, 2]
    )
    rolled = [np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in result.path.roll]
    frames = np.array([result.scenario.base_rotation @ turn for turn in rolled])
    placed = base + np.einsum("nij,nj->ni", frames, arcs.positions[:, -1])
    assert found.tip_error == pytest.approx(np.linalg.norm(placed - tips, axis=1).max(), abs=1e-9)
    assert found.tip_error > 0.01  # inspection sags by 54 mm where nothing holds it
    assert 0 < found.refused <= found.states == len(result.path)
    assert "mm off at the tip" in str(found)
