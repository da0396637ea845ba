"""Every kind of file is told for what it is."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.collision.volumes.surface import Region
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.survey.survey import centreline_of, describe_place, survey_place

SCENES = Path(__file__).parents[2] / "scenes"
AIR = Region(threshold=(-2000.0, -480.0), least_part=1e-8)


def test_a_mesh_with_a_mouth_gets_its_entry_plane_there() -> None:
    place = survey_place(SCENES / "duct" / "duct.stl", length=0.2, diameter=0.02)
    assert (place.kind, place.unit) == ("mesh", "mm")
    entry = place.opening_entry(0.02)
    assert entry is not None
    np.testing.assert_allclose(entry.normal, [1.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(entry.point, 0.0, atol=1e-6)
    assert any("opening 64 mm across" in line for line in describe_place(place))


def test_a_volume_says_its_frame_and_error_and_leads_to_its_depth() -> None:
    place = survey_place(SCENES / "ct" / "airway.nii.gz", region=AIR)
    assert "axes RAS" in place.unit_reason
    entry = place.opening_entry(0.003)
    assert entry is not None
    np.testing.assert_allclose(entry.normal, [0.0, 0.0, -1.0], atol=1e-3)
    line = centreline_of(place, entry, 0.0015 + place.error)
    assert line is not None
    assert line.depths[-1] > 0.09  # trachea 35, main bronchus 47.6 and more
    assert "threshold = [-2000.0, -480.0]" in place.to_toml("a.nii.gz", entry)


def test_a_volume_needs_a_region() -> None:
    with pytest.raises(InputError, match="--label or --threshold"):
        survey_place(SCENES / "ct" / "airway.nii.gz")


def test_a_cloud_says_its_points_and_a_radius_that_closes_its_gaps() -> None:
    place = survey_place(SCENES / "scan" / "duct.ply")
    assert (place.kind, place.unit, place.report) == ("cloud", "mm", None)
    assert 0.0009 < place.error < 0.005  # cells of 1.8 mm
    assert "25,164 points" in describe_place(place)[0]
    assert place.opening_entry(0.02) is None


def test_a_solid_is_closed(tmp_path: Path) -> None:
    shutil.copy(SCENES / "cad" / "housing.step", tmp_path / "HOUSING.STEP")
    place = survey_place(tmp_path / "HOUSING.STEP")
    assert place.report is not None
    assert (place.report.closed, place.unit) == (1, None)
    assert 'role = "obstacle"' in place.to_toml("HOUSING.STEP", None)


def test_an_empty_mesh_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.obj").write_text("# nothing\n")
    with pytest.raises(FormatError):
        survey_place(tmp_path / "empty.obj")
