from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace

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
