"""A scene's meshes, their names and hashes, and what is told of a cavity when it is loaded."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tdcr_planner.errors import FormatError
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.planning.scene import (
    differences,
    geometry_sha256,
    load_scene_meshes,
    mesh_names,
    scene_facts,
    scene_files,
)
from tdcr_planner.sweep.suite import load_suite

ROOT = Path(__file__).resolve().parents[2]


def _tube(path, closed=False):
    """Writes a tube of radius 50 mm along z from 0 to 400 mm, open at both ends or at none."""
    angle = 2 * np.pi * np.arange(24) / 24
    ring = np.column_stack([50 * np.cos(angle), 50 * np.sin(angle)])
    levels = np.linspace(0.0, 400.0, 9)
    vertices = np.concatenate([*(np.column_stack([ring, np.full(24, z)]) for z in levels), [[0, 0, 0], [0, 0, 400]]])
    i, j = np.meshgrid(np.arange(8), np.arange(24), indexing="ij")
    a, b = (24 * i + j).ravel(), (24 * i + (j + 1) % 24).ravel()
    faces = np.concatenate([np.stack([a, b, b + 24], 1), np.stack([a, b + 24, a + 24], 1)])
    if closed:
        k, n = np.arange(24), (np.arange(24) + 1) % 24
        caps = [np.stack([k, n, np.full(24, 216)], 1), np.stack([192 + k, 192 + n, np.full(24, 217)], 1)]
        faces = np.concatenate([faces, *caps])
    trimesh.Trimesh(vertices, faces, process=False).export(path)


@pytest.fixture
def make_tube(make_scenario, tmp_path):
    """Returns a function that gives a scenario whose only mesh is a tube as a cavity, entered at z = 0."""

    def make(closed=False, base=(0.0, 0.0, -0.3), **changes):
        _tube(tmp_path / "tube.stl", closed)
        entry = {"point_m": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
        meshes = [{"file": "tube.stl", "unit": "mm", "role": "cavity", "entry": entry}]
        return make_scenario(meshes=meshes, base={"position_m": list(base)}, **changes)

    return make


def test_a_closed_cavity_is_refused_where_the_base_is_outside_and_taken_where_it_is_inside(make_tube):
    with pytest.raises(FormatError, match=r"meshes\[1\].file: tube.stl as a cavity: is closed and the base, at "):
        load_scene_meshes(make_tube(closed=True))
    assert load_scene_meshes(make_tube(closed=True, base=(0.0, 0.0, 0.1)))[0].bounded
    assert len(load_scene_meshes(make_tube())[0].entrances) == 1


def test_the_base_counts_where_it_stands_at_the_start(make_tube, make_scenario):
    start = {"bending_n": [[0.0, 0.0]], "insertion_m": 0.35}
    scenario = make_tube(closed=True)
    moved = make_scenario(
        meshes=[mesh.model_dump(exclude_none=True) for mesh in scenario.file.meshes],
        base={"position_m": [0.0, 0.0, -0.3], "insertion_m": [0.0, 0.4]},
        start=start,
    )
    assert load_scene_meshes(moved)[0].bounded


def test_a_base_beside_the_opening_is_warned_of(make_tube, caplog):
    with caplog.at_level(logging.WARNING):
        load_scene_meshes(make_tube())
        assert not caplog.records
        load_scene_meshes(make_tube(base=(0.08, 0.0, -0.3)))
    assert (
        "tube.stl: the base's z axis meets the entry plane at (0.08, 0, 0) m, 0.03 m beside the opening" in caplog.text
    )


def test_equal_file_names_are_told_apart_by_their_folders():
    paths = [Path("/s/a/wall.stl"), Path("/s/b/wall.stl"), Path("/s/duct.stl"), Path("/s/x/a/wall.stl")]
    assert mesh_names(paths) == ["s/a/wall.stl", "b/wall.stl", "duct.stl", "x/a/wall.stl"]
    assert mesh_names([Path("/s/wall.stl"), Path("/s/wall.stl")]) == ["wall.stl", "wall.stl (2)"]
    assert mesh_names([]) == []


def test_meshes_of_one_file_name_are_named_with_their_folders(make_scenario, tmp_path):
    meshes = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        trimesh.creation.box((10.0, 10.0, 10.0)).export(tmp_path / folder / "wall.stl")
        meshes.append({"file": f"{folder}/wall.stl", "unit": "mm", "role": "obstacle"})
    assert [mesh.name for mesh in load_scene_meshes(make_scenario(meshes=meshes))] == ["a/wall.stl", "b/wall.stl"]


@pytest.fixture
def gltf_scenario(make_scenario, tmp_path):
    """A scenario whose mesh is a glTF file with its vertices in a file beside it."""
    box = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    points, faces = np.asarray(box.vertices, dtype="<f4"), np.asarray(box.faces, dtype="<u4")
    data = points.tobytes() + faces.tobytes()
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [0.3, 0.0, 0.0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": points.nbytes},
            {"buffer": 0, "byteOffset": points.nbytes, "byteLength": faces.nbytes},
        ],
        "buffers": [{"uri": "walls.bin", "byteLength": len(data)}],
    }
    (tmp_path / "walls.bin").write_bytes(data)
    (tmp_path / "walls.gltf").write_text(json.dumps(document))
    return make_scenario(meshes=[{"file": "walls.gltf", "unit": "m", "role": "obstacle"}])


def test_a_changed_buffer_is_another_scene_for_facts_files_geometry_and_suites(gltf_scenario, tmp_path):
    suite = tmp_path / "suite.toml"
    suite.write_text(
        f'format = "tdcr-suite/1"\nplanners = ["RRTConnect"]\nmodels = ["constant_curvature"]\nseeds = [1]\n'
        f'[[scenarios]]\nfile = "{gltf_scenario.path.name}"\ndifficulty = "easy"\n'
    )

    def hashes():
        return (
            scene_files(gltf_scenario),
            scene_facts(gltf_scenario),
            geometry_sha256(load_scene_meshes(gltf_scenario)),
            load_suite(suite).sha256,
        )

    before = hashes()
    assert hashes() == before
    buffer = tmp_path / "walls.bin"
    points = np.frombuffer(buffer.read_bytes(), dtype="<f4", count=3 * 42).copy()
    points[0] *= 1.01
    buffer.write_bytes(points.tobytes() + buffer.read_bytes()[points.nbytes :])
    after = hashes()
    assert all(old != new for old, new in zip(before, after, strict=True))
    assert [line.split(":")[0] for line in differences(before[1], after[1])] == ["meshes[1].sha256"]


def test_known_hashes_stand_for_files_that_are_not_read_again(gltf_scenario):
    files = scene_files(gltf_scenario)
    facts = scene_facts(gltf_scenario)
    for path in files:
        path.unlink()
    assert scene_facts(gltf_scenario, files) == facts


@pytest.mark.parametrize("scene", ["duct", "blades", "airway"])
def test_nothing_is_said_against_the_shipped_scenes(scene, caplog):
    with caplog.at_level(logging.WARNING):
        for file in sorted((ROOT / "scenes" / scene).glob("scenario_*.toml"))[:3]:
            load_scene_meshes(load_scenario(file))
    assert not caplog.records
