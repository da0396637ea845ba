import numpy as np
import pytest

from tdcr_planner.report.picture import gather_scenario_picture
from tdcr_planner.report.scene_figure import build_figure
from tdcr_planner.report.scene_guides import base_axes, entry_disks, gravity_direction, gravity_label


@pytest.fixture
def picture(make_scenario):
    return gather_scenario_picture(make_scenario("paper"))


def test_entry_plane_is_drawn_about_the_opening(picture):
    (disk,) = entry_disks(picture)
    # the plane goes through the base, across its z axis; the pipe's radius is 14 mm and its mouth is there
    np.testing.assert_allclose(disk.normal, [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(disk.rim[:, 2], 0.0, atol=1e-12)
    assert np.linalg.norm(disk.rim, axis=1) == pytest.approx(1.15 * 0.014, rel=1e-3)


def test_base_frame_is_that_of_the_first_state(picture):
    origin, rotation = base_axes(picture)
    np.testing.assert_allclose(origin, [0.0, 0.0, -0.15])
    np.testing.assert_allclose(rotation, np.eye(3), atol=1e-12)


def test_gravity_is_told_with_its_size(picture):
    assert gravity_label(picture) == "no gravity"
    assert gravity_direction(picture) is None
    file = picture.scenario.file.model_copy(update={"gravity_m_s2": (0.0, -9.81, 0.0)})
    object.__setattr__(picture.scenario, "file", file)
    assert gravity_label(picture) == "gravity 9.81 m/s²"
    np.testing.assert_allclose(gravity_direction(picture), [0.0, -1.0, 0.0])


def test_page_of_a_scenario_has_entry_plane_and_base_frame_within_its_axes(picture):
    figure = build_figure(picture, picture.frame_states(1))
    traces = {trace["name"]: trace for trace in figure["data"]}
    assert {"entry plane", "base frame, x", "base frame, y", "base frame, z"} <= set(traces)
    for trace in figure["data"]:
        for axis in "xyz":
            low, high = figure["layout"]["scene"][f"{axis}axis"]["range"]
            values = np.asarray(trace[axis])
            values = values[np.isfinite(values)]
            assert low <= values.min()
            assert values.max() <= high
