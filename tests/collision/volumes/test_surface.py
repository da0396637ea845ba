"""The surface of a region lies within its stated bound of what the voxels stand for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from tdcr_planner.collision.volumes.formats import read_volume
from tdcr_planner.collision.volumes.image import Volume, VolumeGrid
from tdcr_planner.collision.volumes.surface import Region, region_surface
from tdcr_planner.errors import FormatError

HERE = Path("volume.nii")
GRID = VolumeGrid((12, 13, 14), np.diag([1e-3, 1e-3, 1e-3, 1.0]), "RAS")


def test_a_ball_in_every_format_is_a_closed_ball_in_its_place(ball, ball_file: Path) -> None:
    volume = read_volume(ball_file)
    vertices, faces = region_surface(ball_file, volume, Region(label=3), closed=True)
    centre = 1e-3 * ball.centre * ([1.0, 1.0, 1.0] if volume.grid.frame == "RAS" else [-1.0, -1.0, 1.0])
    offset = np.abs(np.linalg.norm(vertices - centre, axis=1) - 1e-3 * ball.radius)
    assert offset.max() <= volume.grid.surface_error
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    # The voxels inside have the volume 5.2e-7 m^3 to within the layer of the surface; its sign says which way out is.
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * (1e-3 * ball.radius) ** 3, rel=0.05)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_surface_lies_within_the_bound_of_the_voxels_boundary_and_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = (ndimage.gaussian_filter(rng.standard_normal(GRID.shape), 1.2) > 0.0).astype(np.uint8)
    edges = np.diag(rng.uniform(0.3e-3, 1.5e-3, 3)) @ (np.eye(3) + 0.2 * rng.standard_normal((3, 3)))
    affine = np.eye(4)
    affine[:3, :3] = edges
    grid = VolumeGrid(GRID.shape, affine, "RAS")
    vertices, faces = region_surface(HERE, Volume(grid, values), Region(label=1), closed=True)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    # Points of the boundary between voxels inside and outside: the middles of their common faces.
    padded = np.pad(values, 1)
    middles = []
    for axis in range(3):
        inner = np.moveaxis(padded, axis, 0)
        where = np.argwhere(inner[1:] != inner[:-1]).astype(float)
        where[:, 0] += 0.5
        middles.append(np.concatenate([where[:, 1 : axis + 1], where[:, :1], where[:, axis + 1 :]], axis=1) - 1.0)
    boundary = np.concatenate(middles) @ edges.T
    _, to_mesh, _ = trimesh.proximity.closest_point(mesh, boundary[:300])
    assert to_mesh.max() <= grid.surface_error * (1.0 + 1e-9)
    from_mesh = np.min(np.linalg.norm(vertices[:300, None] - boundary[None], axis=2), axis=1)
    assert from_mesh.max() <= grid.surface_error * (1.0 + 1e-9)


def test_pieces_below_the_least_volume_are_left_out_and_said(caplog: pytest.LogCaptureFixture) -> None:
    values = np.zeros(GRID.shape, dtype=np.uint8)
    values[2:8, 2:8, 2:8] = 1
    values[10, 11, 12] = 1
    with caplog.at_level("INFO"):
        vertices, _ = region_surface(HERE, Volume(GRID, values), Region(label=1, least_part=2e-9), closed=True)
    assert vertices.max() <= 7.5e-3
    assert "1 of 2 pieces, of up to 1 mm^3, are left out" in caplog.text


def test_a_region_at_the_border_is_open_there_or_closed() -> None:
    values = np.zeros(GRID.shape, dtype=np.uint8)
    values[:, 4:8, 4:8] = 1
    volume = Volume(GRID, values)
    closed = trimesh.Trimesh(*region_surface(HERE, volume, Region(label=1), closed=True), process=False)
    opened = trimesh.Trimesh(*region_surface(HERE, volume, Region(label=1), closed=False), process=False)
    assert closed.is_watertight
    assert not opened.is_watertight
    rim = opened.vertices[np.unique(opened.edges[trimesh.grouping.group_rows(opened.edges_sorted, require_count=1)])]
    assert set(np.round(rim[:, 0], 9).tolist()) == {0.0, 0.011}


@pytest.mark.parametrize(
    ("region", "reason"),
    [
        (Region(label=7), "has no voxel of label 7; it holds the labels 0, 1"),
        (Region(threshold=(5.0, None)), "has no voxel within the threshold; its values are the labels 0, 1"),
        (Region(threshold=(0.0, None)), "fills the whole volume"),
        (Region(label=1, least_part=1.0), "its largest piece has"),
    ],
)
def test_a_region_without_a_surface_is_refused(region: Region, reason: str) -> None:
    values = np.zeros(GRID.shape, dtype=np.uint8)
    values[2:8, 2:8, 2:8] = 1
    with pytest.raises(FormatError, match=reason):
        region_surface(HERE, Volume(GRID, values), region, closed=False)
