"""What the survey says of a surface is what was built into it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tdcr_planner.survey.surface import guess_unit, survey_surface

BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.01)


def test_a_closed_surface_has_one_piece_and_no_openings() -> None:
    report = survey_surface(BALL.vertices, BALL.faces)
    assert (report.pieces, report.closed, report.tangled, report.flipped, report.inward) == (1, 1, 0, 0, 0)
    assert report.loops == ()
    np.testing.assert_allclose(report.extent, 0.02, rtol=1e-3)


def test_openings_are_sorted_by_size_and_small_ones_are_no_mouths() -> None:
    height = BALL.triangles_center[:, 2]
    faces = BALL.faces[(height < 0.008) & (height > -0.0095)]
    report = survey_surface(BALL.vertices, faces)
    assert report.closed == 0
    assert len(report.loops) == 2
    assert report.loops[0].centre[2] > 0.0
    assert report.loops[0].diameter > report.loops[1].diameter
    between = 2.0 * 0.5 * (report.loops[0].diameter + report.loops[1].diameter)
    assert report.openings(between) == report.loops[:1]


def test_flipped_triangles_are_counted_and_a_piece_turned_inside_out_is_not_one_of_them() -> None:
    faces = BALL.faces.copy()
    faces[[3, 30, 100]] = faces[[3, 30, 100], ::-1]
    assert survey_surface(BALL.vertices, faces).flipped == 3
    turned = survey_surface(BALL.vertices, BALL.faces[:, ::-1])
    assert (turned.flipped, turned.inward) == (0, 1)


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e3), ("m", 1.0)])
def test_the_unit_is_guessed_from_the_robot(unit: str, factor: float) -> None:
    found, reason = guess_unit(0.3 * factor, 0.02 * factor, 0.1, 0.003)
    assert found == unit
    assert "300 mm" in reason


def test_an_opening_that_is_too_small_in_a_unit_rules_it_out() -> None:
    # 0.2 m long with a mouth of 2 mm in mm; in cm ten times both.
    assert guess_unit(200.0, 2.0, 0.1, 0.003)[0] == "cm"


def test_a_place_of_no_sensible_size_is_said() -> None:
    unit, reason = guess_unit(1e9, 0.0, 0.1, 0.003)
    assert unit == "mm"
    assert reason.startswith("no unit makes the place")
