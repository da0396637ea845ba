from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import ks_2samp

from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.robot import RobotSpec

Make = Callable[..., Scenario]


def test_columns_are_bending_then_insertion_then_roll(make_scenario: Make) -> None:
    base = {"insertion_m": [0.0, 0.15], "roll_deg": [-90.0, 90.0]}
    space = ConfigurationSpace(make_scenario("two_segment", base=base))
    row = space.row(((1.0, 2.0), (3.0, 4.0)), insertion_m=0.1, roll_deg=45.0)
    np.testing.assert_allclose(row, [1, 2, 3, 4, 0.1, np.pi / 4])
    assert space.dimension == 6
    np.testing.assert_array_equal(space.bending(row[None]), [[[1, 2], [3, 4]]])
    np.testing.assert_array_equal(space.insertion(row[None]), [0.1])
    np.testing.assert_allclose(space.roll(row[None]), [np.pi / 4])


def test_a_fixed_base_has_neither(make_scenario: Make) -> None:
    space = ConfigurationSpace(make_scenario())
    assert space.dimension == 2
    np.testing.assert_array_equal(space.insertion(np.zeros((3, 2))), np.zeros(3))
    np.testing.assert_array_equal(space.roll(np.zeros((3, 2))), np.zeros(3))


def test_roll_turns_gravity_in_the_base_frame_and_insertion_moves_along_z(make_scenario: Make) -> None:
    half = float(np.sqrt(0.5))
    scenario = make_scenario(
        gravity_m_s2=[0.0, 0.0, -9.81],
        tip_force_n=[0.0, 0.0, 0.02],
        base={"quaternion_wxyz": [half, 0.0, half, 0.0], "insertion_m": [0.0, 1.0], "roll_deg": [-180.0, 180.0]},
    )
    actuation = ConfigurationSpace(scenario).actuate(np.array([[0, 0, 0.5, 0.0], [0, 0, 0.5, np.pi / 2]]))
    # The base z axis is the world's x axis, and its x axis points down.
    np.testing.assert_allclose(actuation.base_positions, [[0.5, 0, 0]] * 2, atol=1e-15)
    np.testing.assert_allclose(actuation.gravity, [[9.81, 0, 0], [0, -9.81, 0]], atol=1e-14)
    np.testing.assert_allclose(actuation.tip_force, [[-0.02, 0, 0], [0, 0.02, 0]], atol=1e-16)
    world = np.einsum("nij,nj->ni", actuation.base_rotations, actuation.gravity)
    np.testing.assert_allclose(world, [[0, 0, -9.81]] * 2, atol=1e-14)


@pytest.mark.parametrize("angles", [[90.0, -30.0, 210.0], [0.0, 90.0, 180.0, 270.0], [0.0, 50.0, 180.0, 270.0]])
def test_bounds_hold_every_bending_vector_within_the_tension_limits(
    make_scenario: Make, random: np.random.Generator, angles: list[float]
) -> None:
    scenario = make_scenario()
    segment = scenario.robot.segments[0].model_copy(update={"tendon_angles_deg": tuple(angles), "pretension_n": 0.5})
    robot = scenario.robot.model_copy(update={"segments": (segment,)})
    space = ConfigurationSpace(Scenario(scenario.path, scenario.sha256, scenario.file, robot))
    bending = random.uniform(-8.0, 8.0, (20000, 1, 2))
    allowed = (robot.tensions_from_bending(bending) <= 3.5).all(axis=1)
    reach = np.linalg.norm(bending[allowed, 0], axis=1).max()
    assert reach <= space.upper[0] <= 1.1 * reach


@pytest.mark.parametrize("robot", ["paper", "two_segment", "inspection"])
def test_samples_are_uniform_within_the_tension_limits(make_scenario: Make, robot: str) -> None:
    space = ConfigurationSpace(make_scenario(robot))
    random = np.random.default_rng(4)
    rows = space.sample(4000, random)
    assert (space.actuate(rows).tensions <= space.robot.max_tensions + 1e-12).all()
    box = random.uniform(space.lower, space.upper, (60000, space.dimension))
    expected = box[(space.actuate(box).tensions <= space.robot.max_tensions).all(axis=1)]
    for index in range(space.robot.segment_count):
        ours, theirs = (space.bending(r)[:, index] for r in (rows, expected))
        # Kolmogorov-Smirnov: the same distribution of sizes and directions at a level of one in a thousand.
        for measure in (lambda v: np.hypot(*v.T), lambda v: np.arctan2(v[:, 1], v[:, 0])):
            assert ks_2samp(measure(ours), measure(theirs)).pvalue > 1e-3


@pytest.mark.parametrize("tendons", [3, 4, 6, 9])
def test_samples_of_many_segments_take_no_longer(make_scenario: Make, paper_robot: RobotSpec, tendons: int) -> None:
    angles = tuple(360.0 * k / tendons for k in range(tendons))
    segment = paper_robot.segments[0].model_copy(update={"tendon_angles_deg": angles})
    scenario = make_scenario("paper")
    robot = paper_robot.model_copy(update={"segments": (segment,) * 16})
    space = ConfigurationSpace(Scenario(scenario.path, scenario.sha256, scenario.file, robot))
    rows = space.sample(200, np.random.default_rng(1))
    assert rows.shape == (200, 32)
    assert (space.actuate(rows).tensions <= robot.max_tensions + 1e-12).all()
    # Corners, where both tendons of a pair pull fully, come near.
    assert space.actuate(rows).tensions.max() > 0.99 * robot.max_tensions[0]
