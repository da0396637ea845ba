"""Tendons that wind, converge, follow points or run straight between disks; tapers, rigid stretches, payloads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.energy import stored_energy, total_potential
from tdcr_planner.statics.sensitivity import statics_jacobian
from tdcr_planner.statics.solver import SolverSettings, solve_statics
from tdcr_planner.statics.tendons import tendon_lengths

STRAIGHT = [{"angle_deg": angle, "radius_m": 0.008} for angle in (90.0, -30.0, 210.0)]
HELICAL = [{"angle_deg": angle, "radius_m": 0.008, "turns": 1.2} for angle in (90.0, -30.0, 210.0)]
CONVERGING = [{"angle_deg": angle, "radius_m": 0.009, "end_radius_m": 0.003} for angle in (90.0, -30.0, 210.0)]
CURVED = [
    {"points_m": [[0.0, 0.008, 0.0], [0.1, 0.004, 0.005], [0.2, -0.002, 0.007]]},
    {"angle_deg": 200.0, "radius_m": 0.007},
]
BETWEEN = [tendon | {"between_disks": "straight"} for tendon in STRAIGHT]
ROBOTS: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]] = {
    "helical": (HELICAL, {}),
    "converging": (CONVERGING, {}),
    "points": (CURVED, {}),
    "taper": (STRAIGHT, {"backbone": {"radius_points_m": [[0.0, 0.0007], [0.2, 0.0004]]}}),
    "rigid": (
        HELICAL,
        {
            "segments": [
                {"length_m": 0.1, "disks": 10},
                {"length_m": 0.03, "disks": 3, "rigid": True},
                {"length_m": 0.07, "disks": 7},
            ],
            "tip": {"mass_kg": 0.004, "offset_m": [0.006, -0.004, 0.01]},
        },
    ),
    "straight between disks": (BETWEEN, {"disks": 10}),
}
LOADS = {"gravity": np.array([4.0, 2.0, -8.0]), "tip_force": np.array([0.03, -0.04, 0.02])}


def robot_named(routed: Callable[..., RobotSpec], name: str) -> RobotSpec:
    tendons, changes = ROBOTS[name]
    return routed(tendons, **changes)


@pytest.mark.parametrize("name", ROBOTS)
def test_energy_minimisation_finds_the_same_shapes(
    routed: Callable[..., RobotSpec], extrapolated: Callable, name: str
) -> None:
    robot = robot_named(routed, name)
    tensions = np.array([3.0, 0.5, 1.0])[: robot.tendon_count]
    elements = 3 if "between" in name else 1
    positions, spread = extrapolated(robot, LOADS, elements, tensions=tensions)
    solution = solve_statics(robot, tensions[None], **LOADS)
    error = np.abs(solution.positions[0] - positions).max()
    # Extrapolation leaves about a hundredth of the distance of the chains, which is below 0.1 mm.
    assert error < 1e-6
    assert error < 0.05 * spread
