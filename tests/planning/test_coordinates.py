"""Drive coordinates: their limits, samples, and what they make each tendon do."""

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.planning.coordinates import drive_coordinates, drive_key, drive_limits
from tdcr_planner.robot import load_robot

ROBOTS = {"two_segment": "bending_n", "bench": "bending_m", "helical": "tendon_n"}


@pytest.fixture(params=sorted(ROBOTS))
def robot(request, root):
    return load_robot(root / "models" / "robots" / f"{request.param}.toml")


def test_the_robot_decides_what_drives_it(robot):
    assert drive_key(robot) == ROBOTS[robot.name.replace("-", "_")]


def test_samples_lie_within_bounds_and_limits_and_differ(robot):
    coordinates = drive_coordinates(robot)
    values = coordinates.sample(200, np.random.default_rng(1))
    assert values.shape == (200, coordinates.width)
    assert (values >= coordinates.lower - 1e-12).all()
    assert (values <= coordinates.upper + 1e-12).all()
    low, high = drive_limits(robot)
    driven = coordinates.driven(values)
    assert (driven >= low - 1e-12).all()
    assert (driven <= high + 1e-9).all()
    assert (coordinates.within(driven) <= 1.0 + 1e-9).all()
    assert np.ptp(values, axis=0).min() > 0.3 * (coordinates.upper - coordinates.lower).min()


def test_what_is_confined_stays_as_it_is_where_it_fits(robot):
    coordinates = drive_coordinates(robot)
    values = coordinates.sample(50, np.random.default_rng(2))
    np.testing.assert_allclose(coordinates.confined(values), values, rtol=1e-12, atol=1e-15)
    far = coordinates.confined(100.0 * values)
    assert (coordinates.within(coordinates.driven(far)) <= 1.0 + 1e-9).all()


def test_a_bending_vector_of_displacement_releases_the_tendons_on_its_far_side(root):
    robot = load_robot(root / "models" / "robots" / "bench.toml")
    values = np.zeros((1, 6))
    values[0, :2] = 0.003, 0.004
    driven = drive_coordinates(robot).driven(values)[0]
    # q_i = b . (cos a_i, sin a_i) for tendons at 90, 210 and 330 degrees.
    angles = np.deg2rad([90.0, 210.0, 330.0])
    np.testing.assert_allclose(driven[:3], 0.003 * np.cos(angles) + 0.004 * np.sin(angles), atol=1e-15)
    np.testing.assert_array_equal(driven[3:], 0.0)
    assert driven.min() < 0.0


def test_a_drive_without_limits_has_no_space_to_search(root):
    robot = load_robot(root / "models" / "robots" / "bench.toml")
    open_ended = robot.model_copy(update={"drive": {"kind": "displacement"}})
    with pytest.raises(InputError, match="max_displacement_m"):
        drive_coordinates(open_ended)
