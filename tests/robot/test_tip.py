"""Payload and camera."""

from __future__ import annotations

import re

import pytest

from tdcr_planner.errors import FormatError


def test_camera_and_payload_stand_as_the_file_says(table, read):
    robot = read(table("bench"))
    assert robot.camera is not None
    assert (robot.camera.position_m, robot.camera.range_m) == ((0.0, 0.0, 0.008), (0.005, 0.06))
    assert (robot.tip.mass_kg, robot.tip.offset_m) == (0.002, (0.0, 0.0, 0.004))
    assert read(table("helical")).camera is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"field_of_view_deg": 0.0}, "camera.field_of_view_deg: input should be greater than 0, got 0"),
        ({"field_of_view_deg": 180.0}, "input should be less than 180, got 180"),
        ({"range_m": [0.06, 0.005]}, "range_m must be [nearest, farthest] with nearest below farthest, got [0.06, 0.0"),
        ({"range_m": [0.06, 0.06]}, "with nearest below farthest"),
        ({"range_m": [0.06]}, "camera.range_m[2]: missing"),
        (
            {"direction": [0.0, 0.0, 0.0]},
            "camera.direction: expected a vector that points somewhere, got [0.0, 0.0, 0.",
        ),
        ({"max_incidence_deg": 120.0}, "camera.max_incidence_deg: input should be less than or equal to 90, got 120"),
        ({"zoom": 2.0}, "camera.zoom: unknown key"),
    ],
)
def test_cameras_that_cannot_be_are_refused(table, read, change, message):
    content = table("bench")
    content["camera"] |= change
    with pytest.raises(FormatError, match=re.escape(message)):
        read(content)
