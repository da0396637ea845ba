"""Every kind of surface in a scenario is checked, read, hashed and kept off by its own error."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.scene import load_scene_meshes, scene_facts
from tdcr_planner.planning.surfaces import CloudEntry, MeshEntry, VolumeEntry
from tdcr_planner.planning.validity import planning_margins
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

Make = Callable[..., Scenario]
SCENES = Path(__file__).parents[2] / "scenes"
VOLUME = {"file": "ball.nii", "label": 1, "role": "obstacle"}
CLOUD = {"file": "points.xyz", "unit": "mm", "point_radius_m": 0.001}


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with a ball of voxels of 2 mm, a cloud of two points and a solid."""
    index = np.stack(np.meshgrid(*(np.arange(20),) * 3, indexing="ij"), axis=-1)
    labels = (np.linalg.norm(index - 10.0, axis=-1) < 6.0).astype(np.uint8)
    affine = np.diag([2.0, 2.0, 2.0, 1.0])
    affine[:3, 3] = [400.0, 400.0, 400.0]
    image = nibabel.Nifti1Image(labels, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "ball.nii")
    (tmp_path / "points.xyz").write_text("500 0 0\n0 500 0\n")
    shutil.copy(SCENES / "cad" / "housing.step", tmp_path / "housing.step")
    return tmp_path


def test_the_largest_error_of_a_surface_is_added_to_the_clearance(make_scenario: Make, files: Path) -> None:
    scenario = make_scenario(meshes=[], volumes=[VOLUME], clouds=[CLOUD])
    # Half of the diagonal of a voxel of 2 mm, which is more than the radius of the points.
    assert scenario.surface_error == pytest.approx(3.0**0.5 * 1e-3, rel=1e-6)
    margins = planning_margins(scenario, ConstantCurvatureShape(scenario.robot))
    np.testing.assert_allclose(margins, scenario.planner.clearance_m + 3.0**0.5 * 1e-3, rtol=1e-6)
    assert scenario.with_planner(seed=4).surface_error == scenario.surface_error


def test_surfaces_are_read_in_metres_in_the_order_meshes_volumes_clouds(make_scenario: Make, files: Path) -> None:
    scenario = make_scenario(meshes=[{"file": "housing.step", "role": "obstacle"}], volumes=[VOLUME], clouds=[CLOUD])
    solid, ball, points = load_scene_meshes(scenario)
    assert [place for _, _, place in scenario.surfaces] == ["meshes[1]", "volumes[1]", "clouds[1]"]
    np.testing.assert_allclose(solid.bounds, [[0.0, -0.03, -0.03], [0.106, 0.03, 0.03]], atol=1e-7)
    np.testing.assert_allclose(ball.bounds.mean(axis=0), 0.42, atol=1e-9)
    assert len(points.faces) == 2
    assert solid.bounded
    assert ball.bounded
    assert not points.bounded


def test_a_changed_file_is_another_scene(make_scenario: Make, files: Path) -> None:
    scenario = make_scenario(meshes=[], volumes=[VOLUME], clouds=[CLOUD])
    before = scene_facts(scenario)
    (files / "points.xyz").write_text("500 0 0\n0 501 0\n")
    after = scene_facts(scenario)
    assert before["meshes"][0] == after["meshes"][0]
    assert before["meshes"][1]["sha256"] != after["meshes"][1]["sha256"]


FAULTS: list[tuple[dict[str, Any], str]] = [
    ({"meshes": []}, r"meshes: missing; expected one or more of \[\[meshes\]\], \[\[volumes\]\]"),
    ({"volumes": [{**VOLUME, "threshold": 3.0}]}, r"volumes\[1\]: expected exactly one of label and threshold"),
    ({"volumes": [{"file": "ball.nii", "role": "obstacle"}]}, r"volumes\[1\]: expected exactly one of label"),
    ({"volumes": [{"file": "ball.nii", "role": "obstacle", "threshold": [3.0, 1.0]}]}, "low below high"),
    ({"volumes": [{**VOLUME, "unit": "mm"}]}, r"volumes\[1\]\.unit: unknown key"),
    ({"volumes": [{**VOLUME, "file": "none.nii"}]}, r"volumes\[1\]\.file: .*no such file"),
    ({"clouds": [{**CLOUD, "point_radius_m": 0.0}]}, r"clouds\[1\]\.point_radius_m"),
    ({"clouds": [{**CLOUD, "role": "cavity"}]}, r"clouds\[1\]: role: a point cloud has no inside"),
    ({"clouds": [{"file": "points.xyz", "unit": "mm"}]}, r"clouds\[1\]\.point_radius_m: missing"),
    ({"meshes": [{"file": "housing.step", "role": "obstacle", "unit": "mm"}]}, r"meshes\[1\]\.unit: expected none"),
]


@pytest.mark.parametrize(("changes", "message"), FAULTS)
def test_a_surface_that_cannot_be_is_named(
    make_scenario: Make, files: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(FormatError, match=message):
        make_scenario(**changes)


def test_a_volume_without_the_label_is_refused_when_it_is_read(make_scenario: Make, files: Path) -> None:
    scenario = make_scenario(meshes=[], volumes=[{**VOLUME, "label": 5}])
    with pytest.raises(FormatError, match="has no voxel of label 5; it holds the labels 0, 1"):
        load_scene_meshes(scenario)


def test_what_is_drawn_of_a_cloud_stands_around_its_points(files: Path) -> None:
    vertices, faces = CloudEntry(**CLOUD).triangles(files / "points.xyz")
    assert faces.shape == (16, 3)
    corners = vertices[faces].reshape(2, -1, 3)
    np.testing.assert_allclose(np.sort(corners.mean(axis=1)[:, 0]), [0.0, 0.5], atol=1e-9)


def test_each_kind_describes_itself() -> None:
    assert MeshEntry(file="a.stl", unit="mm", role="cavity").describe() == "mesh a.stl in mm as cavity"
    assert VolumeEntry(file="a.nii", label=1, role="cavity").describe() == "volume a.nii as cavity"
    assert CloudEntry(**CLOUD).describe() == "cloud points.xyz in mm, points of 1 mm radius"
