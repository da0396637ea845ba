"""A cloud keeps the body off each point by its radius."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.collision.clouds.obstacle import cloud_error, load_cloud
from tdcr_planner.errors import FormatError, UnknownNameError


def write(path: Path, points: np.ndarray) -> Path:
    path.write_text("\n".join(" ".join(f"{value:.9f}" for value in point) for point in points))
    return path


def test_the_triangles_stand_for_the_points_within_the_stated_error(tmp_path: Path) -> None:
    points = np.random.default_rng(5).uniform(-50.0, 50.0, (200, 3))
    mesh = load_cloud(write(tmp_path / "a.xyz", points), "mm", 5e-4)
    corners = mesh.vertices[mesh.faces]
    nearest = np.linalg.norm(corners.mean(axis=1)[:, None] - 1e-3 * points[None], axis=2)
    assert nearest.min(axis=1).max() < 1e-11
    assert set(nearest.argmin(axis=1).tolist()) == set(range(200))
    size = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max()
    assert 5e-4 + size <= cloud_error(5e-4) * (1.0 + 1e-9)
    assert not mesh.bounded


def test_points_that_stand_twice_count_once(tmp_path: Path) -> None:
    mesh = load_cloud(write(tmp_path / "a.xyz", np.repeat([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 3, axis=0)), "m", 1e-3)
    assert len(mesh.faces) == 2


def test_places_beyond_the_earth_and_unknown_units_are_refused(tmp_path: Path) -> None:
    file = write(tmp_path / "a.xyz", np.array([[0.0, 0.0, 0.0], [1e10, 0.0, 0.0]]))
    with pytest.raises(FormatError, match="point 2"):
        load_cloud(file, "m", 1e-3)
    with pytest.raises(UnknownNameError):
        load_cloud(file, "km", 1e-3)
