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
    # Extrapolation leaves about a hundredth of the distance of the chains, which is below 0.1 mm. The chord of a gap is
    # known to the fourth power of its bend, here 0.15 rad.
    assert error < (3e-5 if "between" in name else 1e-6)
    assert error < 0.05 * spread or "between" in name


def test_a_helical_tendon_without_load_makes_a_helix(routed: Callable[..., RobotSpec]) -> None:
    """Constant u and v in the frame that turns with the tendon: all cross-sections are alike but for that turn."""
    robot = routed(HELICAL[:1])
    solution = solve_statics(robot, [[4.0]], settings=SolverSettings(tolerance=1e-12, steps_per_gap=2))
    turn = 2.0 * np.pi * 1.2 / 20
    rotate = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    R, p = solution.rotations[0], solution.positions[0]
    # The motion from disk to disk, seen from a frame that turns with the tendon, is the same everywhere.
    first = rotate.T @ np.swapaxes(R[:-1], 1, 2) @ R[1:]
    moved = np.einsum("kji,kj->ki", R[:-1], np.diff(p, axis=0))
    steps = [np.linalg.matrix_power(rotate, k) for k in range(20)]
    for k in range(1, 20):
        np.testing.assert_allclose(steps[k].T @ moved[k], moved[0], atol=1e-9)
        np.testing.assert_allclose(steps[k].T @ (rotate @ first[k]) @ steps[k], rotate @ first[0], atol=1e-7)
    assert np.ptp(p[:, 0]) > 0.01


@pytest.mark.parametrize("kind", ["channel", "straight"])
def test_a_straight_tendon_written_as_points(routed: Callable[..., RobotSpec], kind: str) -> None:
    plain = routed([{"angle_deg": 30.0, "radius_m": 0.008, "between_disks": kind}])
    x, y = 0.008 * np.cos(np.pi / 6), 0.008 * np.sin(np.pi / 6)
    points = [[s, x, y] for s in (0.0, 0.05, 0.13, 0.2)]
    written = routed([{"points_m": points, "between_disks": kind}])
    a, b = (solve_statics(robot, [[3.0]], **LOADS).positions for robot in (plain, written))
    np.testing.assert_allclose(b, a, atol=1e-12)


def test_a_payload_off_the_axis_is_a_rigid_arm(routed: Callable[..., RobotSpec]) -> None:
    """The same as a rigid, massless stretch that carries the payload on its end."""
    tip = {"mass_kg": 0.01, "offset_m": [0.0, 0.0, 0.03]}
    robot = routed(STRAIGHT, tip=tip, segments=[{"length_m": 0.17, "disks": 17}])
    segments = [
        {"length_m": 0.17, "disks": 17},
        {
            "length_m": 0.03,
            "disks": 1,
            "rigid": True,
            "disk_mass_kg": 0.0,
            "backbone": {"youngs_modulus_pa": 60e9, "poisson_ratio": 0.3, "radius_m": 0.0005, "density_kg_m3": 0.0},
        },
    ]
    arm = routed([tendon | {"segment": 1} for tendon in STRAIGHT], segments=segments, tip={"mass_kg": 0.01})
    loads = {"gravity": [9.81, 0.0, 0.0]}
    a = solve_statics(robot, [[2.0, 0.0, 1.0]], **loads)
    b = solve_statics(arm, [[2.0, 0.0, 1.0]], **loads)
    # The steps of the two robots differ; their error is some 1e-8 m.
    np.testing.assert_allclose(b.positions[:, :-1], a.positions, atol=3e-8)
    np.testing.assert_allclose(b.positions[:, -1], a.positions[:, -1] + 0.03 * a.rotations[:, -1, :, 2], atol=5e-8)


@pytest.mark.parametrize("name", ["helical", "rigid", "straight between disks"])
def test_derivatives_agree_with_central_differences(routed: Callable[..., RobotSpec], name: str) -> None:
    robot = robot_named(routed, name)
    settings = SolverSettings(tolerance=1e-12, steps_per_gap=4)
    arguments = {"tensions": np.array([[3.0, 0.5, 1.0]]), **{key: value[None] for key, value in LOADS.items()}}
    jacobian = statics_jacobian(robot, solve_statics(robot, **arguments, settings=settings))
    for kind, step in (("tensions", 1e-3), ("gravity", 1e-3), ("tip_force", 1e-5)):
        exact = getattr(jacobian, kind).positions
        for column in range(3):
            shapes = []
            for sign in (1.0, -1.0):
                moved = {key: value.copy() for key, value in arguments.items()}
                moved[kind][:, column] += sign * step
                shapes.append(solve_statics(robot, **moved, settings=settings).positions)
            difference = (shapes[0] - shapes[1]) / (2.0 * step)
            # Derivatives and shapes are of fourth order in the step, each by itself.
            np.testing.assert_allclose(exact[..., column], difference, atol=1e-5 * np.abs(exact).max())


def test_moments_at_disks(routed: Callable[..., RobotSpec]) -> None:
    robot = routed(STRAIGHT, disk_mass=0.0, backbone={"density_kg_m3": 0.0})
    none, moment = np.zeros((1, 3)), np.array([0.0, 0.004, 0.0])
    moments = np.zeros((1, 21, 3))
    moments[0, 10] = moment
    solution = solve_statics(robot, none, disk_moments=moments)
    curvature = moment[1] / robot.stiffness_at(np.array([0.1]))[0, 4]
    # An arc up to the disk, straight behind it.
    angle = curvature * np.minimum(robot.arc_lengths, 0.1)
    np.testing.assert_allclose(solution.rotations[0, :, 0, 2], np.sin(angle), atol=1e-10)
    at_tip = solve_statics(robot, none, tip_moment=moment)
    moments = np.roll(moments, 10, axis=1)
    np.testing.assert_allclose(solve_statics(robot, none, disk_moments=moments).positions, at_tip.positions, atol=1e-12)
    spread = solve_statics(robot, none, distributed_moment=moment / 0.2)
    # M falls linearly to the tip: half the angle of the same moment at the tip.
    np.testing.assert_allclose(spread.rotations[0, -1, 0, 2], np.sin(0.5 * curvature * 0.2), atol=1e-7)


def test_the_energy_balance_of_a_tapered_helical_robot(routed: Callable[..., RobotSpec]) -> None:
    robot = routed(HELICAL, **ROBOTS["taper"][1])
    settings = SolverSettings(tolerance=1e-12, steps_per_gap=2)
    tensions = np.array([[3.0, 0.5, 1.0]])
    lengths = tendon_lengths(robot, solve_statics(robot, tensions, **LOADS, settings=settings))
    for tendon in range(3):
        step = np.zeros((1, 3))
        step[0, tendon] = 1e-3
        high, low = (
            total_potential(robot, solve_statics(robot, tensions + sign * step, **LOADS, settings=settings))
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose((high - low) / 2e-3, lengths[:, tendon], rtol=1e-7)
    assert stored_energy(robot, solve_statics(robot, tensions, settings=settings))[0] > 1e-3
