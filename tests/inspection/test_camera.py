from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tdcr_planner.errors import InputError
from tdcr_planner.inspection.camera import make_camera, scenario_camera
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.robot import Camera

TABLE = {"field_of_view_deg": 90.0, "range_m": [0.005, 0.06]}


@given(st.integers(0, 2**31), st.booleans())
def test_the_axes_are_at_right_angles_and_the_third_is_the_direction(seed: int, turned: bool) -> None:
    direction, up = np.random.default_rng(seed).normal(size=(2, 3))
    changes = {"up": up.tolist()} if turned else {}
    camera = make_camera(Camera(**TABLE, direction=direction.tolist(), **changes))
    np.testing.assert_allclose(camera.axes.T @ camera.axes, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(camera.axes[:, 2], direction / np.linalg.norm(direction), atol=1e-12)


def test_the_picture_is_as_a_viewer_sees_it() -> None:
    # Right, down and forward are right-handed.
    camera = make_camera(Camera(**TABLE))
    right, up, forward = camera.axes.T
    np.testing.assert_allclose(np.cross(right, -up), forward, atol=1e-12)
    np.testing.assert_allclose(up, [1.0, 0.0, 0.0], atol=1e-12)


def test_the_pose_follows_the_last_disk() -> None:
    camera = make_camera(Camera(**TABLE, position_m=[0.0, 0.0, 0.002], direction=[1.0, 0.0, 0.0]))
    turn = Rotation.from_euler("y", 90.0, degrees=True).as_matrix()
    positions = np.zeros((1, 3, 3))
    positions[0, -1] = [0.1, 0.2, 0.3]
    centres, frames = camera.poses(positions, np.tile(turn, (1, 3, 1, 1)))
    np.testing.assert_allclose(centres[0], [0.102, 0.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(frames[0, :, 2], [0.0, 0.0, -1.0], atol=1e-15)


def test_the_optical_axis_may_be_the_default_up() -> None:
    camera = make_camera(Camera(**TABLE, direction=[2.0, 0.0, 0.0]))
    # Right, up and forward are left-handed.
    assert np.linalg.det(camera.axes) == pytest.approx(-1.0)


def test_the_outermost_line_of_sight_of_a_rectangle_is_its_corner() -> None:
    table = Camera(field_of_view_deg=(90.0, 60.0), range_m=[0.005, 0.06])
    assert make_camera(table).farthest_tangent == pytest.approx(np.hypot(1.0, 1.0 / np.sqrt(3.0)))


def test_a_pixel_covers_more_when_it_is_far_and_steep() -> None:
    camera = make_camera(Camera(**TABLE, pixels=(100, 100)))
    sizes = camera.pixel_size(np.array([0.05, 0.1]), np.array([1.0, 0.5]))
    # 90 degrees over 100 pixels: 2 x distance / 100 straight on, twice that under 60 degrees.
    np.testing.assert_allclose(sizes, [0.001, 0.004])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"range_m": [0.06, 0.06]}, "nearest below farthest"),
        ({"range_m": [0.06, 0.005]}, "nearest below farthest"),
        ({"field_of_view_deg": 0.0}, "greater than 0"),
        ({"field_of_view_deg": 180.0}, "less than 180"),
        ({"field_of_view_deg": [90.0, 0.0]}, "greater than 0"),
        ({"max_incidence_deg": 0.0}, "greater than 0"),
        ({"direction": [0.0, 0.0, 0.0]}, "points somewhere"),
        ({"pixels": [0, 480]}, "greater than 0"),
    ],
)
def test_a_camera_that_sees_nothing_is_refused(
    make_inspection: Callable[..., Scenario], change: dict[str, object], words: str
) -> None:
    with pytest.raises(Exception, match=words) as caught:
        make_inspection(camera=change)
    assert "inspect.camera" in str(caught.value)


def test_up_along_the_optical_axis_is_refused() -> None:
    with pytest.raises(InputError, match=r"camera\.up"):
        make_camera(Camera(**TABLE, up=[0.0, 0.0, 3.0]))


def test_a_scenario_without_a_camera_is_refused(make_inspection: Callable[..., Scenario]) -> None:
    with pytest.raises(InputError, match="camera"):
        scenario_camera(make_inspection(camera=None))
