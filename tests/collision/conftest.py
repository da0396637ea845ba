"""Meshes made from formulas and robot poses drawn at random."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tdcr_planner.cache_folder import cache_folder
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.robot import load_robot
from tdcr_planner.se3 import rotation_from_vector
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

ROBOTS = Path(__file__).parents[2] / "models" / "robots"


class Shapes:
    """Meshes as (vertices, faces), m."""

    @staticmethod
    def pipe(radius=0.016, bend=0.12, straight=0.1, angle=np.pi / 2, around=32, along=40):
        """A tube, open at both ends, up from the origin and then bent towards positive x."""
        s = np.linspace(0.0, straight + bend * angle, along)
        turn = np.maximum(s - straight, 0.0) / bend
        middle = np.stack([bend * (1 - np.cos(turn)), 0 * s, np.minimum(s, straight) + bend * np.sin(turn)], axis=1)
        side = np.stack([np.cos(turn), 0 * s, -np.sin(turn)], axis=1)
        u = 2 * np.pi * np.arange(around) / around
        ring = np.cos(u)[:, None] * side[:, None, :] + np.sin(u)[:, None] * np.array([0.0, 1.0, 0.0])
        vertices = (middle[:, None, :] + radius * ring).reshape(-1, 3)
        i, j = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
        a, b = (i * around + j).ravel(), (i * around + (j + 1) % around).ravel()
        faces = np.concatenate([np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)])
        return vertices, faces

    @staticmethod
    def box(extents, centre=(0.0, 0.0, 0.0), fine=0):
        mesh = trimesh.creation.box(extents=extents)
        for _ in range(fine):
            mesh = mesh.subdivide()
        return np.asarray(mesh.vertices) + np.asarray(centre), np.asarray(mesh.faces)

    @staticmethod
    def sphere(radius, centre=(0.0, 0.0, 0.0), subdivisions=3):
        mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
        return np.asarray(mesh.vertices) + np.asarray(centre), np.asarray(mesh.faces)

    @staticmethod
    def sheet(size, cells=8, height=0.0):
        """A square in the plane z = height, centred on the z axis, open."""
        x = np.linspace(-size / 2, size / 2, cells + 1)
        grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
        vertices = np.column_stack([grid, np.full(len(grid), height)])
        i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
        a = (i * (cells + 1) + j).ravel()
        b, c, d = a + 1, a + cells + 1, a + cells + 2
        return vertices, np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, b], 1)])


@pytest.fixture(scope="session")
def shapes():
    return Shapes


@pytest.fixture(scope="session")
def pipe_mesh():
    return SceneMesh.from_arrays("pipe", *Shapes.pipe(), "cavity", [0, 0, 0], [0, 0, 1])


@pytest.fixture(scope="session")
def paper():
    return load_robot(ROBOTS / "paper.toml")


@pytest.fixture(scope="session")
def two_segment():
    return load_robot(ROBOTS / "two_segment.toml")


@pytest.fixture(scope="session")
def draw_poses():
    """Returns a function that draws poses: smooth shapes of random bending, moved at random or along the z axis."""

    def draw(robot, rng, count, spread=None, bending=1.0, along=None):
        size = (count, robot.segment_count, 2)
        shape = ConstantCurvatureShape(robot).disk_poses(
            robot.tensions_from_bending(rng.uniform(-bending, bending, size) * robot.max_tensions[0])
        )
        positions, rotations = shape.positions, shape.rotations
        if spread is not None:
            turn = rotation_from_vector(rng.normal(size=(count, 3)) * 2.0)
            positions = positions @ np.swapaxes(turn, 1, 2) + rng.uniform(-spread, spread, (count, 1, 3))
            rotations = turn[:, None] @ rotations
        if along is not None:
            positions = positions + rng.uniform(*along, (count, 1, 1)) * np.array([0.0, 0.0, 1.0])
        return np.ascontiguousarray(positions), np.ascontiguousarray(rotations)

    return draw


@pytest.fixture(autouse=True, scope="session")
def field_cache(tmp_path_factory):
    """Keeps the fields of a test run in a folder of its own."""
    folder = tmp_path_factory.mktemp("fields")
    with pytest.MonkeyPatch.context() as patch:
        # Processes that tests start read compiled code where this one does.
        compiled = cache_folder()
        if compiled is not None and "NUMBA_CACHE_DIR" not in os.environ:
            patch.setenv("NUMBA_CACHE_DIR", str(compiled))
        patch.setenv("TDCR_CACHE_DIR", str(folder))
        yield folder
