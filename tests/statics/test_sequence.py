"""Motions with friction: capstan, hysteresis, work, independence of how finely a motion is cut."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.energy import stored_energy
from tdcr_planner.statics.sequence import solve_sequence
from tdcr_planner.statics.solver import SolverSettings, solve_statics
from tdcr_planner.statics.tendons import tendon_displacements, tendon_tensions

ANGLES = (90.0, -30.0, 210.0)
LOADS = {"gravity": np.array([4.0, 2.0, -8.0]), "tip_force": np.array([0.02, -0.03, 0.02])}


def rubbing(routed: Callable[..., RobotSpec], friction: float, **changes: object) -> RobotSpec:
    tendons = [{"angle_deg": angle, "radius_m": 0.008, "friction_coefficient": friction} for angle in ANGLES]
    return routed([tendon | changes.pop("tendon", {}) for tendon in tendons], **changes)


@pytest.fixture(scope="module")
def single(routed: Callable[..., RobotSpec]) -> RobotSpec:
    """One massless segment with one tendon along the x axis."""
    tendon = {"angle_deg": 0.0, "radius_m": 0.008, "friction_coefficient": 0.2}
    return routed([tendon], disk_mass=0.0, backbone={"density_kg_m3": 0.0})


def curvature_per_newton(robot: RobotSpec) -> float:
    return 0.008 / robot.stiffness_at(np.array([0.1]))[0, 3]


@pytest.mark.parametrize(("name", "sign"), [("pull", 1.0), ("release", -1.0)])
def test_one_tendon_on_one_segment(single: RobotSpec, name: str, sign: float) -> None:
    """E I kappa = tau r and tau' = -mu tau kappa: tau = tau0 / (1 + mu kappa0 s), and the angle by its logarithm."""
    tension, friction = 3.0, 0.2
    bend = curvature_per_newton(single) * tension
    solution = solve_statics(single, [[tension]], friction=name)
    arc_lengths, along = tendon_tensions(single, solution)
    expected = tension / (1.0 + sign * friction * bend * arc_lengths)
    np.testing.assert_allclose(along[0, :, :, 0], expected, rtol=1e-6)
    angle = np.log(1.0 + sign * friction * bend * single.arc_lengths) / (sign * friction)
    assert angle[-1] > 1.2
    np.testing.assert_allclose(solution.rotations[0, :, 0, 2], np.sin(angle), atol=1e-6)


def test_a_sheath_takes_its_part(single: RobotSpec, routed: Callable[..., RobotSpec]) -> None:
    tendon = {"angle_deg": 0.0, "radius_m": 0.008, "friction_coefficient": 0.2, "sheath_angle_deg": 90.0}
    robot = routed([tendon], disk_mass=0.0, backbone={"density_kg_m3": 0.0})
    a = solve_statics(robot, [[3.0]], friction="pull")
    b = solve_statics(single, [[3.0 * np.exp(-0.2 * np.pi / 2)]], friction="pull")
    np.testing.assert_allclose(a.positions, b.positions, atol=1e-10)


def test_slip_front_of_a_release(single: RobotSpec) -> None:
    """Near the base the tendon slides back, tau = T exp(mu angle); behind the front it has what the pull left."""
    solution = solve_sequence(single, [[3.0], [2.8]])
    _, along = tendon_tensions(single, solution)
    pulled, released = along[0, :, 2, 0], along[1, :, 2, 0]
    stuck = np.isclose(released, pulled, rtol=1e-12)
    assert 0 < stuck.sum() < len(stuck)
    assert stuck[np.argmax(stuck) :].all()
    angle = np.arcsin(np.clip(solution.rotations[1, 1:, 0, 2], -1.0, 1.0))
    front = np.argmax(stuck)
    np.testing.assert_allclose(released[:front], 2.8 * np.exp(0.2 * angle[:front]), rtol=1e-6)


def test_without_friction_it_is_the_frictionless_solver(
    routed: Callable[..., RobotSpec], random: np.random.Generator
) -> None:
    robot = rubbing(routed, 0.0)
    tensions = random.uniform(0.0, 4.0, (6, 3))
    settings = SolverSettings(tolerance=1e-12)
    plain = solve_statics(robot, tensions, **LOADS, settings=settings)
    for solution in (
        solve_sequence(robot, tensions, **LOADS, settings=settings),
        solve_statics(robot, tensions, friction="pull", **LOADS, settings=settings),
    ):
        np.testing.assert_allclose(solution.positions, plain.positions, atol=1e-12)
        np.testing.assert_array_equal(tendon_tensions(robot, solution)[1], tendon_tensions(robot, plain)[1])


def test_a_closed_loop_of_actuation_closes_after_one_turn(routed: Callable[..., RobotSpec]) -> None:
    robot = rubbing(routed, 0.15)
    phase = np.linspace(0.0, 6.0 * np.pi, 61)
    tensions = 2.0 + 1.5 * np.stack([np.cos(phase), np.cos(phase - 2.1), np.cos(phase + 2.1)], axis=1)
    solution = solve_sequence(robot, tensions, **LOADS)
    assert solution.converged.all()
    tips = solution.positions[:, -1]
    np.testing.assert_allclose(tips[40:], tips[20:41], atol=1e-6)
    frictionless = solve_statics(robot, tensions, **LOADS).positions[:, -1]
    assert np.linalg.norm(tips - frictionless, axis=1).max() > 1e-3


@pytest.mark.parametrize("kind", ["tension", "displacement"])
def test_cutting_a_motion_finer_changes_nothing(routed: Callable[..., RobotSpec], kind: str) -> None:
    drive = (
        {"kind": kind}
        if kind == "tension"
        else {"kind": kind, "transmission_stiffness_n_m": 5000.0, "pretension_n": 0.5}
    )
    robot = rubbing(routed, 0.15, drive=drive)
    corners = np.array([[3.0, 0.5, 0.5], [0.5, 3.0, 0.5], [1.0, 1.0, 3.0], [3.0, 0.2, 0.4]])
    if kind == "displacement":
        corners = 0.002 * (corners - 1.2)
    ends = []
    for parts in (1, 2, 5):
        fractions = np.linspace(0.0, len(corners) - 1.0, parts * (len(corners) - 1) + 1)
        path = np.stack([np.interp(fractions, np.arange(len(corners)), column) for column in corners.T], axis=1)
        solution = solve_sequence(robot, path, **LOADS)
        assert solution.converged.all()
        ends.append(solution.positions[::parts])
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)
    np.testing.assert_allclose(ends[2], ends[0], atol=1e-6)


def test_work_is_stored_or_rubbed_off(single: RobotSpec) -> None:
    """Work of the drive, integral of T dq; rubbed off where the tendon slides by the change of length behind it.

    One tendon is pulled from 0 to T. tau' = -mu tau kappa does not change its sign, so the heat is the integral of
    mu tau kappa over the sliding, which is kappa r beyond each place.
    """
    nodes, weights = np.polynomial.legendre.leggauss(16)
    largest = 3.0
    tensions = 0.5 * largest * (1.0 + nodes)
    solution = solve_statics(single, tensions[:, None], friction="pull")
    end = solve_statics(single, [[largest]], friction="pull")
    pulled = tendon_displacements(single, solution)[:, 0]
    work = largest * tendon_displacements(single, end)[0, 0] - 0.5 * largest * weights @ pulled
    # Heat by the closed form: sliding xi(s, T) = r (angle(l) - angle(s)) + axial part, tau' = -mu tau kappa.
    s = 0.1 * (1.0 + nodes)
    k, mu, r, length = curvature_per_newton(single), 0.2, 0.008, 0.2
    axial = 1.0 / single.stiffness_at(np.array([0.1]))[0, 2]

    def sliding_rate(place: np.ndarray, tension: np.ndarray) -> np.ndarray:
        bend = k * tension
        # d/dT of ln((1 + mu bend l) / (1 + mu bend s)) / mu, and of the axial part, alike times EA.
        turn = k * (length / (1.0 + mu * bend * length) - place / (1.0 + mu * bend * place))
        return r * turn + axial * turn / k

    tension, place = np.meshgrid(tensions, s, indexing="ij")
    along = tension / (1.0 + mu * k * tension * place)
    rubbed = mu * along * (k * along) * sliding_rate(place, tension)
    heat = 0.5 * largest * weights @ (rubbed @ weights * 0.5 * length)
    stored = stored_energy(single, end)[0]
    assert heat > 0.05 * stored
    np.testing.assert_allclose(work, stored + heat, rtol=1e-6)


def test_displacement_drive_rubs_too(routed: Callable[..., RobotSpec]) -> None:
    drive = {"kind": "displacement", "transmission_stiffness_n_m": 7000.0, "pretension_n": 0.5}
    robot = rubbing(routed, 0.2, drive=drive)
    up = np.linspace(0.0, 0.004, 9)
    pull = np.concatenate([up, up[-2::-1]])
    displacements = np.stack([pull, -0.5 * pull, -0.5 * pull], axis=1)
    solution = solve_sequence(robot, displacements)
    assert solution.converged.all()
    np.testing.assert_allclose(
        tendon_displacements(robot, solution)[solution.tensions > 0.0],
        displacements[solution.tensions > 0.0],
        atol=1e-9,
    )
    way_up, way_down = solution.positions[:9, -1], solution.positions[8:, -1][::-1]
    # Released, friction holds the bend: the tip is farther out on the way back.
    assert (np.linalg.norm(way_up - way_down, axis=1)[2:7] > 1e-4).all()


def test_play_follows_the_motion(routed: Callable[..., RobotSpec]) -> None:
    drive = {"kind": "displacement", "transmission_stiffness_n_m": 7000.0, "pretension_n": 0.5, "backlash_m": 0.001}
    robot = rubbing(routed, 0.0, drive=drive)
    pull = np.array([0.0, 0.003, 0.0025, 0.002, 0.001])
    solution = solve_sequence(robot, np.stack([pull, 0.0 * pull, 0.0 * pull], axis=1))
    tips = solution.positions[:, -1]
    # Half the play is lost on the way up, all of it on the way back before anything moves.
    np.testing.assert_allclose(tips[2], tips[1], atol=1e-9)
    np.testing.assert_allclose(tips[3], tips[1], atol=1e-9)
    assert np.linalg.norm(tips[4] - tips[1]) > 1e-3


def test_what_is_refused(routed: Callable[..., RobotSpec]) -> None:
    robot = rubbing(routed, 0.1)
    with pytest.raises(InputError, match="kind: expected 'tension', 'displacement' or None"):
        solve_sequence(robot, np.zeros((2, 3)), kind="pressure")
    with pytest.raises(InputError, match=r"tensions: expected shape \(n, 3\)"):
        solve_sequence(robot, np.zeros((2, 4)))
    with pytest.raises(InputError, match="friction: expected 'pull' or 'release', got 'push'"):
        solve_statics(robot, np.zeros((1, 3)), friction="push")
    with pytest.raises(InputError, match="friction: expected one name, or 3, one a tendon, got 2 names"):
        solve_statics(robot, np.zeros((1, 3)), friction=["pull", "release"])
    solution = solve_statics(robot, np.ones((1, 3)), friction=["pull", "release", "pull"])
    with pytest.raises(InputError, match="no initial solution"):
        solve_statics(robot, np.ones((1, 3)), friction="pull", initial=solution)
