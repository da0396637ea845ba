"""Collision-free, reference-verified tendon trajectories for continuum robots in triangle meshes.

The public calls are loaded when they are first used, so that importing the package (and asking a command for its
help) does not import torch, ompl or fcl.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tdcr_planner.errors import TdcrError
    from tdcr_planner.planning.scenario import Scenario, load_scenario
    from tdcr_planner.query.result import PlanResult, PlanStatus
    from tdcr_planner.query.session import PlanningSession, plan, verify
    from tdcr_planner.robot import RobotSpec, load_robot
    from tdcr_planner.shape.learned import load_shape_model
    from tdcr_planner.statics.sequence import solve_sequence
    from tdcr_planner.statics.solver import solve_statics

_HOMES = {
    "PlanResult": "tdcr_planner.query.session",
    "PlanStatus": "tdcr_planner.query.session",
    "PlanningSession": "tdcr_planner.query.session",
    "RobotSpec": "tdcr_planner.robot",
    "Scenario": "tdcr_planner.planning.scenario",
    "TdcrError": "tdcr_planner.errors",
    "load_robot": "tdcr_planner.robot",
    "load_scenario": "tdcr_planner.planning.scenario",
    "load_shape_model": "tdcr_planner.shape.learned",
    "plan": "tdcr_planner.query.session",
    "solve_sequence": "tdcr_planner.statics.sequence",
    "solve_statics": "tdcr_planner.statics.solver",
    "verify": "tdcr_planner.query.session",
}

__all__ = [
    "PlanResult",
    "PlanStatus",
    "PlanningSession",
    "RobotSpec",
    "Scenario",
    "TdcrError",
    "load_robot",
    "load_scenario",
    "load_shape_model",
    "plan",
    "solve_sequence",
    "solve_statics",
    "verify",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'tdcr_planner' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
