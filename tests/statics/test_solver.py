"""The public solver: its answers against closed forms and published shapes, its symmetries, statuses and refusals."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.se3 import rotation_about_z, rotation_distance
from tdcr_planner.statics.solver import SolverSettings, SolveStatus, solve_statics

DATA = Path(__file__).parent / "data" / "published_model.npz"
ROBOTS = Path(__file__).resolve().parents[2] / "models" / "robots"

# Bisshopp and Drucker 1945; digits of the inextensible cantilever under a transverse dead tip load after Mattiasson
# 1981, table 1: P L^2 / (E I), tip deflection w / L, shortening u / L, tip angle.
ELASTICA = [
    (1.0, 0.30172, 0.05643, 0.46135),
    (2.0, 0.49346, 0.16064, 0.78175),
    (5.0, 0.71379, 0.38763, 1.21537),
    (10.0, 0.81061, 0.55500, 1.43029),
]


@pytest.fixture
def published(robot_of: Callable[..., RobotSpec]) -> Callable[[str], tuple[RobotSpec, dict[str, np.ndarray]]]:
    def load(name: str) -> tuple[RobotSpec, dict[str, np.ndarray]]:
        with np.load(DATA) as data:
            part = {key.split("__")[1]: data[key] for key in data.files if key.startswith(f"{name}__")}
        return robot_of(circles=part["tendon_circle_radius_m"].tolist()), part

    return load


@pytest.mark.parametrize("name", ["one_segment", "two_segments"])
def test_published_shapes_without_outside_loads(published: Callable, name: str) -> None:
    robot, data = published(name)
    solution = solve_statics(robot, data["tensions_n"])
    assert solution.converged.all()
    # The reference data are stated to 1e-8 m.
    np.testing.assert_allclose(solution.positions, data["positions_m"], rtol=0.0, atol=1e-8)
    assert rotation_distance(solution.rotations, data["rotations"]).max() < 1e-6


def test_published_tip_force_differs_by_the_kink_of_the_passing_tendons(published: Callable) -> None:
    robot, data = published("two_segments_tip_force")
    solution = solve_statics(robot, data["tensions_n"], tip_force=data["tip_force_n"])
    assert solution.converged.all()
    largest = np.linalg.norm(solution.positions - data["positions_m"], axis=2).max(axis=1)
    # The published equations leave the kink force at the junction out; what that changes is known: 0.03 to 0.05 mm in
    # the median, up to 1 mm.
    assert 1e-5 < np.median(largest) < 6e-5
    assert largest.max() < 1.05e-3


def test_arc_without_outside_loads(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of()
    tension, circle = 3.0, 0.008
    solution = solve_statics(robot, [[tension, 0.0, 0.0]])
    curvature = rotation_distance(solution.rotations[0, :-1], solution.rotations[0, 1:]) / 0.01
    np.testing.assert_allclose(curvature, curvature[0], rtol=1e-9)
    # kappa = M / (E I). Pulling on the outside of its circle the tendon shortens the axis by tau / (E A): 6e-5.
    backbone = robot.backbone
    np.testing.assert_allclose(
        curvature[0],
        tension * circle / backbone.stiffness_bending_torsion[0],
        rtol=2 * tension / (60e9 * backbone.area),
    )
    axial = 1.0 - tension / (60e9 * backbone.area)
    radius = axial / curvature[0]
    angle = curvature[0] * robot.arc_lengths
    np.testing.assert_allclose(solution.positions[0, :, 1], radius * (1.0 - np.cos(angle)), atol=1e-12)
    np.testing.assert_allclose(solution.positions[0, :, 2], radius * np.sin(angle), atol=1e-12)


@pytest.mark.parametrize(("load", "deflection", "shortening", "angle"), ELASTICA)
def test_elastica_of_the_literature(
    robot_of: Callable[..., RobotSpec], load: float, deflection: float, shortening: float, angle: float
) -> None:
    # So thin that shear and extension (of relative size (radius / length)^2 = 6e-8 times the load) do not show.
    robot = robot_of(radius=5e-5)
    force = load * robot.backbone.stiffness_bending_torsion[0] / 0.2**2
    solution = solve_statics(robot, np.zeros((1, 3)), tip_force=[force, 0.0, 0.0])
    assert solution.status[0] == SolveStatus.CONVERGED
    tip, rotation = solution.positions[0, -1] / 0.2, solution.rotations[0, -1]
    # Half a digit of the table.
    np.testing.assert_allclose([tip[0], 1.0 - tip[2]], [deflection, shortening], atol=6e-6)
    np.testing.assert_allclose(np.arctan2(rotation[0, 2], rotation[2, 2]), angle, atol=6e-6)


def test_pure_torsion(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of()
    moment = 0.01
    solution = solve_statics(robot, np.zeros((1, 3)), tip_moment=[0.0, 0.0, moment])
    twist = moment / robot.backbone.stiffness_bending_torsion[2] * robot.arc_lengths
    np.testing.assert_allclose(solution.rotations[0], rotation_about_z(twist), atol=1e-12)
    np.testing.assert_allclose(solution.positions[0, :, 2], robot.arc_lengths, atol=1e-14)


def test_small_loads_superpose(general_robot: RobotSpec, loads_of: Callable, random: np.random.Generator) -> None:
    tensions = random.uniform(0.0, 2.0, (1, general_robot.tendon_count))
    _, loads = loads_of(general_robot, random, 1, everything=True)
    settings = SolverSettings(tolerance=1e-12)
    rest = solve_statics(general_robot, tensions, settings=settings).positions

    def moved(scale: float, names: list[str]) -> np.ndarray:
        chosen = {name: scale * loads[name] for name in names}
        return solve_statics(general_robot, tensions, **chosen, settings=settings).positions - rest

    scale = 1e-4
    together, apart = moved(scale, list(loads)), sum(moved(scale, [name]) for name in loads)
    # What is left over is of second order: a quarter of it at half the load.
    left = np.abs(together - apart).max()
    halved = np.abs(moved(scale / 2, list(loads)) - sum(moved(scale / 2, [name]) for name in loads)).max()
    assert left < 1e-3 * np.abs(together).max()
    assert 3.5 < left / halved < 4.5


@settings(max_examples=15, deadline=None)
@given(angle=st.floats(-np.pi, np.pi), seed=st.integers(0, 10_000))
def test_turning_tendons_and_loads_turns_the_shape(angle: float, seed: int) -> None:
    robot = load_robot(ROBOTS / "two_segment.toml")
    turned = robot.model_copy(
        update={
            "segments": tuple(
                segment.model_copy(
                    update={"tendon_angles_deg": tuple(a + np.rad2deg(angle) for a in segment.tendon_angles_deg)}
                )
                for segment in robot.segments
            )
        }
    )
    random = np.random.default_rng(seed)
    tensions = random.uniform(0.0, 4.0, (1, 6))
    gravity, force, moment = random.normal(size=(3, 3)) * np.array([[4.0], [0.03], [0.001]])
    rotation = rotation_about_z(np.array(angle))
    plain = solve_statics(robot, tensions, gravity=gravity, tip_force=force, tip_moment=moment)
    other = solve_statics(
        turned, tensions, gravity=rotation @ gravity, tip_force=rotation @ force, tip_moment=rotation @ moment
    )
    # Both stop at relative residuals of 1e-9.
    np.testing.assert_allclose(other.positions, plain.positions @ rotation.T, atol=5e-9)
    np.testing.assert_allclose(other.rotations, rotation @ plain.rotations @ rotation.T, atol=5e-8)


def test_a_load_path_walked_back_gives_the_same_shapes(
    general_robot: RobotSpec, loads_of: Callable, random: np.random.Generator
) -> None:
    tensions, loads = loads_of(general_robot, random, 2, share=0.4, everything=True)
    path = np.linspace(0.0, 1.0, 15)
    forward, solution = [], None

    def at(fraction: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        mixed = {name: (1 - fraction) * value[:1] + fraction * value[1:] for name, value in loads.items()}
        return (1 - fraction) * tensions[:1] + fraction * tensions[1:], mixed

    for fraction in path:
        tension, load = at(fraction)
        solution = solve_statics(general_robot, tension, **load, initial=solution)
        assert solution.status[0] == SolveStatus.CONVERGED
        forward.append(solution.positions)
    for fraction, expected in zip(path[::-1], forward[::-1], strict=True):
        tension, load = at(fraction)
        solution = solve_statics(general_robot, tension, **load, initial=solution)
        np.testing.assert_allclose(solution.positions, expected, atol=5e-9)
        cold = solve_statics(general_robot, tension, **load)
        np.testing.assert_allclose(cold.positions, expected, atol=5e-9)


def test_fourth_order(general_robot: RobotSpec, loads_of: Callable, random: np.random.Generator) -> None:
    tensions, loads = loads_of(general_robot, random, 6, share=0.5, everything=True)
    shapes = [
        solve_statics(
            general_robot, tensions, **loads, settings=SolverSettings(tolerance=1e-12, steps_per_gap=steps)
        ).positions
        for steps in (1, 2, 4, 8)
    ]
    errors = [np.abs(a - b).max() for a, b in pairwise(shapes)]
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert ((slopes > 3.7) & (slopes < 4.4)).all()


def test_rotations_stay_orthonormal(any_robot: RobotSpec, loads_of: Callable, random: np.random.Generator) -> None:
    tensions, loads = loads_of(any_robot, random, 50)
    rotations = solve_statics(any_robot, tensions, **loads).rotations
    product = rotations @ np.swapaxes(rotations, -1, -2)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-13)


def test_random_cases_converge_to_the_branch_followed_in_small_steps(
    any_robot: RobotSpec, loads_of: Callable, random: np.random.Generator
) -> None:
    tensions, loads = loads_of(any_robot, random, 150, force=0.4)
    fast = solve_statics(any_robot, tensions, **loads)
    slow = solve_statics(any_robot, tensions, **loads, settings=SolverSettings(first_load_step=0.02))
    both = fast.converged & slow.converged
    assert both.mean() > 0.99
    # 0.4 N is beyond the buckling load of the straight rod (0.18 N): the tip moves by up to twice the length.
    np.testing.assert_allclose(fast.positions[both], slow.positions[both], atol=1e-7)


def test_results_do_not_depend_on_batch_or_threads(
    two_segment_robot: RobotSpec, loads_of: Callable, random: np.random.Generator
) -> None:
    tensions, loads = loads_of(two_segment_robot, random, 7)
    batch = solve_statics(two_segment_robot, tensions, **loads)
    threaded = solve_statics(two_segment_robot, tensions, **loads, settings=SolverSettings(threads=3))
    np.testing.assert_array_equal(threaded.positions, batch.positions)
    np.testing.assert_array_equal(threaded.iterations, batch.iterations)
    for row in range(7):
        single = solve_statics(
            two_segment_robot, tensions[row : row + 1], **{name: value[row] for name, value in loads.items()}
        )
        np.testing.assert_array_equal(single.positions[0], batch.positions[row])
        np.testing.assert_array_equal(single.rotations[0], batch.rotations[row])


def test_warm_start_takes_fewer_sweeps_and_finds_the_same_shape(
    inspection_robot: RobotSpec, loads_of: Callable, random: np.random.Generator
) -> None:
    tensions, loads = loads_of(inspection_robot, random, 40)
    start = solve_statics(inspection_robot, tensions, **loads)
    cold = solve_statics(inspection_robot, 1.01 * tensions, **loads)
    warm = solve_statics(inspection_robot, 1.01 * tensions, **loads, initial=start)
    np.testing.assert_allclose(warm.positions, cold.positions, atol=5e-9)
    assert warm.iterations.sum() < 0.9 * cold.iterations.sum()


def test_a_useless_start_is_replaced_by_the_unloaded_shape(
    inspection_robot: RobotSpec, loads_of: Callable, random: np.random.Generator
) -> None:
    tensions, loads = loads_of(inspection_robot, random, 3)
    far = solve_statics(inspection_robot, tensions, tip_moment=[0.0, 0.05, 0.0])
    failed = solve_statics(inspection_robot, tensions, tip_force=[0.0, 0.0, -1e6])
    assert not failed.converged.any()
    expected = solve_statics(inspection_robot, tensions, **loads).positions
    for start in (far, failed):
        found = solve_statics(inspection_robot, tensions, **loads, initial=start)
        np.testing.assert_allclose(found.positions, expected, atol=5e-9)


def test_eulers_column_loses_stability_at_the_critical_load(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of(radius=5e-5)
    critical = np.pi**2 * robot.backbone.stiffness_bending_torsion[0] / (4 * 0.2**2)
    for share, stable in ((0.99, True), (1.01, False), (3.0, False), (30.0, False)):
        solution = solve_statics(robot, np.zeros((1, 3)), tip_force=[0.0, 0.0, -share * critical])
        assert solution.converged[0]
        assert bool(solution.stable[0]) is stable
        assert solution.status[0] == (SolveStatus.CONVERGED if stable else SolveStatus.UNSTABLE)
        np.testing.assert_allclose(solution.positions[0, :, :2], 0.0, atol=1e-12)


def test_self_buckling_under_own_weight(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of(radius=1e-4, density=8000.0)
    # Greenhill 1881: w l^3 / (E I) = 7.837 (the first zero of a Bessel function).
    critical = 7.83735 * robot.backbone.stiffness_bending_torsion[0] / 0.2**3 / robot.backbone.weight_per_length_kg_m
    below, above = (solve_statics(robot, np.zeros((1, 3)), gravity=[0, 0, -share * critical]) for share in (0.99, 1.01))
    assert below.stable[0]
    assert not above.stable[0]


def test_a_slightly_crooked_column_buckles_sideways(robot_of: Callable[..., RobotSpec]) -> None:
    robot = robot_of(radius=5e-5)
    critical = np.pi**2 * robot.backbone.stiffness_bending_torsion[0] / (4 * 0.2**2)
    force = np.array([1e-4, 0.0, -1.293]) * critical
    solution = solve_statics(robot, np.zeros((1, 3)), tip_force=force)
    assert solution.status[0] == SolveStatus.CONVERGED
    # The elastica in elliptic integrals of k = sin(tip angle / 2) (Timoshenko and Gere, Theory of Elastic Stability,
    # section 2.7): P / Pcr = (2 K / pi)^2, x / l = 2 E / K - 1, y / l = 2 k / K. A tip angle of 80 degrees belongs to
    # P / Pcr = 1.2939. The side force and the rounding of P add to it, by less than 1.5e-3.
    modulus = np.sin(np.deg2rad(40.0))
    first, second = ellipk(modulus**2), ellipe(modulus**2)
    assert (2.0 * first / np.pi) ** 2 == pytest.approx(1.2939, abs=1e-4)
    np.testing.assert_allclose(solution.positions[0, -1, 2] / 0.2, 2.0 * second / first - 1.0, atol=1.5e-3)
    np.testing.assert_allclose(solution.positions[0, -1, 0] / 0.2, 2.0 * modulus / first, atol=1.5e-3)


def test_a_branch_that_ends_says_so(robot_of: Callable[..., RobotSpec]) -> None:
    # A coil of one turn pressed sideways snaps through on the way to this load.
    robot = robot_of(backbone={"rest_curvature_1_m": [0.0, 30.0, 20.0]})
    force = np.array([0.228569, -1.190231, -0.806784])
    ended = solve_statics(robot, np.zeros((1, 3)), tip_force=force)
    assert ended.status[0] == SolveStatus.LIMIT_POINT
    assert not ended.converged[0]
    assert np.isnan(ended.positions).all()
    fraction = ended.load_fraction[0]
    before = solve_statics(robot, np.zeros((1, 3)), tip_force=0.999 * fraction * force)
    assert before.status[0] == SolveStatus.CONVERGED
    after = solve_statics(robot, np.zeros((1, 3)), tip_force=1.01 * fraction * force)
    assert after.status[0] == SolveStatus.LIMIT_POINT
    np.testing.assert_allclose(1.01 * after.load_fraction, 1.0, atol=1e-3)


@pytest.mark.parametrize("force", [1e2, 1e4, 1e12, 1e200])
def test_absurd_loads_have_a_status(two_segment_robot: RobotSpec, force: float) -> None:
    solution = solve_statics(two_segment_robot, np.full((1, 6), 1.0), tip_force=[force, 0.3 * force, -force])
    assert solution.converged[0] == np.isfinite(solution.positions).all()
    assert solution.converged[0] == (solution.status[0] in (SolveStatus.CONVERGED, SolveStatus.UNSTABLE))
    if not solution.converged[0]:
        assert np.isnan(solution.positions).all()
        assert np.isnan(solution.base_moment).all()
        assert not solution.stable[0]


def test_a_soft_rod_with_hard_pull(robot_of: Callable[..., RobotSpec]) -> None:
    # Silicone: 5 % axial compression, curvatures beyond 1 / tendon radius of the small-strain world are not reached.
    robot = robot_of(modulus=1e6, radius=0.005, density=1100.0, circles=(0.006, 0.006))
    tensions = np.array([[4.0, 0.0, 1.0, 0.0, 2.0, 0.0]])
    solution = solve_statics(robot, tensions, gravity=[0.0, 0.0, 9.81])
    fine = solve_statics(robot, tensions, gravity=[0.0, 0.0, 9.81], settings=SolverSettings(steps_per_gap=4))
    assert solution.status[0] == SolveStatus.CONVERGED
    np.testing.assert_allclose(solution.positions, fine.positions, atol=1e-6)


def test_an_empty_batch(two_segment_robot: RobotSpec) -> None:
    solution = solve_statics(two_segment_robot, np.zeros((0, 6)), gravity=[0, 0, -9.81])
    assert solution.positions.shape == (0, 21, 3)
    assert solution.status.shape == (0,)


def test_what_is_refused(two_segment_robot: RobotSpec) -> None:
    good = np.ones((2, 6))
    for tensions, text in (
        (np.ones((2, 5)), r"tensions: expected shape \(n, 6\), got shape \(2, 5\)"),
        (np.ones(6), r"tensions: expected shape \(n, 6\), got shape \(6,\)"),
        (good * np.nan, r"tensions: expected finite numbers, got nan at index \(0, 0\)"),
        (-good, r"tensions: .*only pull.*-1 in row 0, tendon 0"),
    ):
        with pytest.raises(InputError, match=text):
            solve_statics(two_segment_robot, tensions)
    for name, value, text in (
        ("gravity", [0.0, 9.81], r"gravity: expected shape \(3\)"),
        ("tip_force", [[0.0, 0.0, np.inf]] * 2, r"tip_force: expected finite numbers, got inf"),
        ("tip_moment", np.zeros((3, 3)), r"tip_moment: expected shape \(2, 3\), got shape \(3, 3\)"),
        ("distributed_force", "heavy", r"distributed_force: expected numbers"),
        ("disk_forces", np.zeros((2, 20, 3)), r"disk_forces: expected shape \(2, 21, 3\), got shape \(2, 20, 3\)"),
    ):
        with pytest.raises(InputError, match=text):
            solve_statics(two_segment_robot, good, **{name: value})
    with pytest.raises(InputError, match="a solution of 1 or 2 cases, got one of 3"):
        solve_statics(two_segment_robot, good, initial=solve_statics(two_segment_robot, np.ones((3, 6))))


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"tolerance": 0.0}, "tolerance: expected a number from"),
        ({"tolerance": float("nan")}, "tolerance: expected a number from"),
        ({"threads": 0}, "threads: expected a whole number of 1 or more, got 0"),
        ({"steps_per_gap": 0}, "steps_per_gap: expected a whole number of 1 or more, or None, got 0"),
        ({"first_load_step": 2.0}, "first_load_step: expected a number from"),
    ],
)
def test_settings_that_are_refused(two_segment_robot: RobotSpec, values: dict[str, float], text: str) -> None:
    with pytest.raises(InputError, match=text):
        solve_statics(two_segment_robot, np.ones((1, 6)), settings=SolverSettings(**values))
