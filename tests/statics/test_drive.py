"""Displacement drive: lengths, transmission, slack."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.sensitivity import statics_jacobian
from tdcr_planner.statics.solver import SolverSettings, SolveStatus, solve_statics
from tdcr_planner.statics.tendons import tendon_displacements, tendon_lengths

ANGLES = (90.0, -30.0, 210.0)
TENDONS = [{"segment": 1, "angle_deg": angle, "radius_m": 0.008} for angle in ANGLES]
TENDONS += [{"segment": 2, "angle_deg": angle + 40.0, "radius_m": 0.006} for angle in ANGLES]
SEGMENTS = [{"length_m": 0.1, "disks": 10}, {"length_m": 0.1, "disks": 10}]
LOADS = {"gravity": np.array([4.0, 2.0, -8.0]), "tip_force": np.array([0.02, -0.03, 0.02])}


@pytest.fixture(scope="module")
def driven(routed: Callable[..., RobotSpec]) -> Callable[..., RobotSpec]:
    def make(stiffness: float | None = 7000.0, pretension: float = 0.5, **changes: float) -> RobotSpec:
        drive = {"kind": "displacement", "pretension_n": pretension, **changes}
        if stiffness is not None:
            drive["transmission_stiffness_n_m"] = stiffness
        return routed(TENDONS, segments=SEGMENTS, drive=drive)

    return make


@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7, None])
def test_tensions_turned_into_displacements_give_the_shape_back(
    driven: Callable[..., RobotSpec], stiffness: float | None, loads_of: Callable, random: np.random.Generator
) -> None:
    robot = driven(stiffness)
    tensions, loads = loads_of(robot, random, 40, share=0.5)
    solution = solve_statics(robot, tensions, **loads)
    back = solve_statics(robot, displacements=tendon_displacements(robot, solution), **loads)
    assert (back.status == SolveStatus.CONVERGED).all()
    np.testing.assert_allclose(back.positions, solution.positions, atol=1e-8)
    # A gap of 2e-11 m at 2.4e5 N/m, the axial stiffness of the backbone, is 5e-6 N.
    np.testing.assert_allclose(back.tensions, tensions, atol=2e-5)


def test_slack_tendons_carry_nothing_and_the_others_balance(
    driven: Callable[..., RobotSpec], extrapolated: Callable
) -> None:
    """Against the minimum of the energy with one-sided springs."""
    robot = driven(3000.0)
    displacements = np.array([0.004, -0.006, -0.006, -0.002, 0.002, -0.005])
    solution = solve_statics(robot, displacements=displacements[None], **LOADS)
    tensions = solution.tensions[0]
    assert (tensions[[1, 2, 5]] == 0.0).all()
    assert (tensions[[0, 4]] > 0.1).all()
    slack = tendon_displacements(robot, solution)[0]
    assert (displacements[tensions == 0.0] < slack[tensions == 0.0]).all()
    np.testing.assert_allclose(displacements[tensions > 0.0], slack[tensions > 0.0], atol=1e-10)
    springs = robot.drive.transmission_stiffness
    positions, _ = extrapolated(robot, LOADS, displacements=displacements, springs=springs)
    # Extrapolated chains: a hundredth of their distance.
    np.testing.assert_allclose(solution.positions[0], positions, atol=1e-6)
    held = solve_statics(robot, tensions[None], **LOADS)
    np.testing.assert_allclose(held.positions, solution.positions, atol=1e-8)


def test_at_zero_displacement_the_robot_is_straight_with_its_pretension(driven: Callable[..., RobotSpec]) -> None:
    robot = driven(7000.0)
    solution = solve_statics(robot, displacements=np.zeros((1, 6)))
    np.testing.assert_allclose(solution.positions[0, :, :2], 0.0, atol=1e-9)
    # The backbone gives way by sum of tensions / (E A): 3 N over 4.7e4 N, times 0.2 m at 7000 N/m.
    np.testing.assert_allclose(solution.tensions, 0.5, atol=0.1)
    assert (solution.tensions < 0.5).all()


def test_a_spring_shares_the_pull(driven: Callable[..., RobotSpec]) -> None:
    displacements = np.array([[0.003, -0.01, -0.01, 0.0, 0.0, 0.0]])
    soft, stiff = (driven(stiffness, 0.0) for stiffness in (1e3, 1e6))
    lengths = []
    for robot in (soft, stiff):
        solution = solve_statics(robot, displacements=displacements)
        shortened = robot.rest_path_lengths[0] - tendon_lengths(robot, solution)[0, 0]
        stretch = solution.tensions[0, 0] / robot.drive.transmission_stiffness[0]
        np.testing.assert_allclose(shortened + stretch, 0.003, atol=1e-10)
        lengths.append(shortened)
    assert lengths[0] < 0.9 * lengths[1]


def test_play_is_a_dead_band_about_zero(driven: Callable[..., RobotSpec]) -> None:
    plain, loose = driven(), driven(backlash_m=0.001)
    pulled = np.array([[0.003, -0.003, -0.001, 0.0004, 0.0, 0.002]])
    expected = np.array([[0.0025, -0.0025, -0.0005, 0.0, 0.0, 0.0015]])
    a = solve_statics(loose, displacements=pulled)
    b = solve_statics(plain, displacements=expected)
    np.testing.assert_allclose(a.positions, b.positions, atol=1e-12)
    np.testing.assert_array_equal(a.displacements, pulled)


def test_a_warm_start_finds_the_same_shape(
    driven: Callable[..., RobotSpec], loads_of: Callable, random: np.random.Generator
) -> None:
    robot = driven()
    tensions, loads = loads_of(robot, random, 20, share=0.5)
    displacements = tendon_displacements(robot, solve_statics(robot, tensions, **loads))
    start = solve_statics(robot, displacements=displacements, **loads)
    cold = solve_statics(robot, displacements=1.02 * displacements, **loads)
    warm = solve_statics(robot, displacements=1.02 * displacements, **loads, initial=start)
    np.testing.assert_allclose(warm.positions, cold.positions, atol=5e-9)
    assert warm.iterations.sum() < cold.iterations.sum()


def test_elastic_tendons_hold_a_column_that_constant_tensions_let_go(driven: Callable[..., RobotSpec]) -> None:
    # The load shortens the backbone; so much pretension keeps the tendons taut.
    robot = driven(1e5, 5.0)
    stiffness = robot.stiffness_at(np.array([0.1]))[0, 3]
    critical = np.pi**2 * stiffness / (4 * 0.2**2)
    force = [0.0, 0.0, -1.5 * critical]
    let_go = solve_statics(robot, np.full((1, 6), 0.5), tip_force=force)
    held = solve_statics(robot, displacements=np.zeros((1, 6)), tip_force=force)
    assert let_go.status[0] == SolveStatus.UNSTABLE
    assert held.status[0] == SolveStatus.CONVERGED
    np.testing.assert_allclose(held.positions[0, :, :2], 0.0, atol=1e-9)


def test_random_cases_converge_or_say_so(
    driven: Callable[..., RobotSpec], random: np.random.Generator, loads_of: Callable
) -> None:
    robot = driven(3e4, 0.2)
    count = 300
    bending = random.normal(size=(count, 2, 2)) * 0.003
    displacements = robot.displacements_from_bending(bending) + random.uniform(-0.001, 0.0001, (count, 6))
    _, loads = loads_of(robot, random, count, force=0.1)
    solution = solve_statics(robot, displacements=displacements, **loads)
    assert solution.converged.mean() > 0.99
    assert np.isfinite(solution.tensions[solution.converged]).all()
    assert np.isnan(solution.tensions[~solution.converged]).all()
    pulled = tendon_displacements(robot, solution)
    taut = solution.tensions > 0.0
    np.testing.assert_allclose(pulled[taut], displacements[taut], atol=1e-10)


def test_derivatives_agree_with_central_differences(driven: Callable[..., RobotSpec]) -> None:
    robot = driven(7000.0)
    settings = SolverSettings(tolerance=1e-12, steps_per_gap=3)
    arguments = {
        "displacements": np.array([[0.004, -0.006, -0.006, -0.002, 0.002, -0.001]]),
        **{name: value[None] for name, value in LOADS.items()},
    }
    solution = solve_statics(robot, **arguments, settings=settings)
    assert (solution.tensions[0] == 0.0).any()
    jacobian = statics_jacobian(robot, solution)
    for kind, step in (("displacements", 1e-6), ("gravity", 1e-3), ("tip_force", 1e-5)):
        exact = getattr(jacobian, kind).positions
        for column in range(exact.shape[-1]):
            shapes = []
            for sign in (1.0, -1.0):
                moved = {key: value.copy() for key, value in arguments.items()}
                moved[kind][:, column] += sign * step
                shapes.append(solve_statics(robot, **moved, settings=settings).positions)
            difference = (shapes[0] - shapes[1]) / (2.0 * step)
            # Shapes and derivatives are of fourth order in the step, each by itself.
            np.testing.assert_allclose(exact[..., column], difference, atol=2e-5 * np.abs(exact).max())


def test_what_is_refused(driven: Callable[..., RobotSpec]) -> None:
    robot = driven()
    with pytest.raises(InputError, match="either tensions or displacements, got both"):
        solve_statics(robot, np.zeros((1, 6)), displacements=np.zeros((1, 6)))
    with pytest.raises(InputError, match="either tensions or displacements, got neither"):
        solve_statics(robot)
    with pytest.raises(InputError, match="are they in mm"):
        solve_statics(robot, displacements=np.full((1, 6), 3.0))
    with pytest.raises(InputError, match="a solution of 1 or 2 cases, got one of 3"):
        solve_statics(robot, displacements=np.zeros((2, 6)), initial=solve_statics(robot, np.ones((3, 6))))
    absurd = solve_statics(robot, displacements=np.full((1, 6), 0.09), tip_force=[1e4, 0.0, -1e4])
    assert absurd.converged[0] == np.isfinite(absurd.positions).all()


def test_settings_of_tolerance_are_kept(driven: Callable[..., RobotSpec]) -> None:
    robot = driven()
    displacements = np.array([[0.003, -0.003, 0.0, 0.0, 0.0, 0.001]])
    loose, tight = (
        solve_statics(robot, displacements=displacements, **LOADS, settings=SolverSettings(tolerance=tolerance))
        for tolerance in (1e-6, 1e-11)
    )
    assert loose.iterations[0] <= tight.iterations[0]
    np.testing.assert_allclose(loose.positions, tight.positions, atol=1e-5)
