"""STEP files are tessellated within the stated distance, in metres, and refused where they hold no solid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.mesh_files.cad import CHORD_M, STEP, SURFACE_ERROR_M
from tdcr_planner.collision.mesh_files.registry import find_format, read_mesh_file
from tdcr_planner.collision.meshes import load_scene_mesh
from tdcr_planner.errors import FormatError, InputError

HOUSING = Path(__file__).parents[3] / "scenes" / "cad" / "housing.step"
PORT_RADIUS, CHAMBER_RADIUS, ROD_RADIUS = 2.5e-3, 24e-3, 4e-3


def test_the_triangles_lie_within_the_stated_distance_of_the_cylinders() -> None:
    raw = read_mesh_file(HOUSING)
    corners = raw.vertices[raw.faces]
    # The middles of edges and triangles are farthest from a curved surface that runs through the corners.
    points = np.concatenate([corners.reshape(-1, 3), corners.mean(axis=1), (corners[:, 0] + corners[:, 1]) / 2])
    across = np.hypot(points[:, 1], points[:, 2])
    in_port = (points[:, 0] < 0.0295) & (across < 4e-3)
    assert in_port.sum() > 20
    assert np.abs(across[in_port] - PORT_RADIUS).max() <= SURFACE_ERROR_M
    on_rod = np.hypot(points[:, 0] - 0.065, points[:, 2])
    near = np.abs(on_rod - ROD_RADIUS) < 2e-4
    assert near.sum() > 20
    assert np.abs(on_rod[near] - ROD_RADIUS).max() <= SURFACE_ERROR_M
    assert 2.0 * CHORD_M == SURFACE_ERROR_M


def test_a_solid_is_closed_and_has_its_volume() -> None:
    mesh = load_scene_mesh(HOUSING, None, "obstacle")
    found = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert found.is_watertight
    chamber = np.pi * CHAMBER_RADIUS**2 * 0.07 - np.pi * ROD_RADIUS**2 * 2.0 * CHAMBER_RADIUS
    expected = 0.06 * 0.06 * 0.106 - np.pi * PORT_RADIUS**2 * 0.03 - chamber
    # The rod ends on a cylinder, not on a plane: about 0.4 % of its volume.
    assert abs(found.volume) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("fraction", [0.0, 0.01, 0.5, 0.95])
def test_a_file_that_is_cut_off_is_refused_without_a_word_on_the_terminal(
    fraction: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    data = HOUSING.read_bytes()
    (tmp_path / "cut.step").write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(FormatError, match=r"cut\.step: cannot be read as STEP"):
        read_mesh_file(tmp_path / "cut.step")
    assert capfd.readouterr() == ("", "")


def test_the_unit_is_the_files_own() -> None:
    assert find_format(HOUSING) is STEP
    with pytest.raises(InputError, match="None for a file that states its own unit"):
        load_scene_mesh(HOUSING, "mm", "obstacle")
