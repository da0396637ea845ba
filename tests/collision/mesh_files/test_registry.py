"""The same geometry in every format, damaged files of every binary format, and what counts as a mesh file."""

from __future__ import annotations

import os

import numpy as np
import pytest

from tdcr_planner.collision.mesh_files.registry import mesh_sha256, read_mesh_file
from tdcr_planner.collision.meshes import load_scene_mesh
from tdcr_planner.errors import FormatError, TdcrError

KINDS = ("stl", "ascii.stl", "obj", "ply", "big.ply", "ascii.ply", "off", "glb", "gltf", "3mf")
BINARY = ("stl", "ply", "big.ply", "glb", "gltf", "3mf")


def _judge(path, role):
    """Returns what a mesh file amounts to in a role: its faces, extent and inside, or how it is refused."""
    try:
        mesh = load_scene_mesh(path, "m", role)
    except FormatError as error:
        return error.place, error.problem
    return len(mesh.faces), len(mesh.caps), mesh.bounds.tolist(), mesh.bounded


@pytest.mark.parametrize("kind", KINDS)
def test_a_mesh_with_defects_is_the_same_in_every_format(writers, defect, tmp_path, kind):
    plain = writers.write(tmp_path / "plain.stl", "stl", *defect)
    other = writers.write(tmp_path / f"other.{kind}", kind, *defect)
    for role in ("obstacle", "cavity"):
        assert _judge(other, role) == _judge(plain, role)


@pytest.mark.parametrize("kind", KINDS)
def test_corners_and_order_of_faces_are_those_of_the_file(writers, box, tmp_path, kind):
    raw = read_mesh_file(writers.write(tmp_path / f"box.{kind}", kind, *box))
    np.testing.assert_array_equal(raw.vertices[raw.faces], box[0][box[1]])


def _geometry(path):
    raw = read_mesh_file(path)
    return raw.vertices[raw.faces].tobytes()


@pytest.mark.parametrize("kind", BINARY)
def test_a_cut_binary_file_is_refused(writers, box, tmp_path, kind):
    path = writers.write(tmp_path / f"box.{kind}", kind, *box)
    target = path.with_suffix(".bin") if kind == "gltf" else path
    whole = target.read_bytes()
    lengths = np.unique(np.random.default_rng(1).integers(0, len(whole), 300))
    for length in lengths.tolist():
        target.write_bytes(whole[:length])
        with pytest.raises(FormatError):
            _geometry(path)


@pytest.mark.parametrize("kind", BINARY)
def test_a_flipped_bit_is_refused_or_shows_in_the_hash(writers, box, tmp_path, kind):
    """Formats without a checksum cannot tell all damage: what they accept then differs in hash, or in nothing."""
    path = writers.write(tmp_path / f"box.{kind}", kind, *box)
    target = path.with_suffix(".bin") if kind == "gltf" else path
    whole, geometry, digest = target.read_bytes(), _geometry(path), mesh_sha256(path)
    rng = np.random.default_rng(2)
    changed = 0
    for _ in range(300):
        damaged = bytearray(whole)
        damaged[rng.integers(len(damaged))] ^= 1 << rng.integers(8)
        target.write_bytes(bytes(damaged))
        try:
            changed += _geometry(path) != geometry
            assert mesh_sha256(path) != digest
        except TdcrError:
            continue
    # 3MF has a checksum; the others pass on what is well formed.
    assert changed == 0 if kind == "3mf" else changed > 0


def test_only_regular_files_of_known_endings_are_read(tmp_path):
    (tmp_path / "mesh.dae").write_text("<COLLADA/>")
    with pytest.raises(FormatError, match=r"unknown ending '.dae'; valid: .stl, .obj, .ply, .off, .gltf, .glb, .3mf"):
        read_mesh_file(tmp_path / "mesh.dae")
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(FormatError, match="is a pipe, expected a file"):
        read_mesh_file(tmp_path / "pipe.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(FormatError, match="is a folder"):
        mesh_sha256(tmp_path / "folder.stl")
    (tmp_path / "loop.stl").symlink_to(tmp_path / "loop.stl")
    with pytest.raises(FormatError, match="cannot be read"):
        read_mesh_file(tmp_path / "loop.stl")


def test_endings_count_in_any_case_and_names_with_odd_characters_are_named(writers, box, tmp_path):
    assert len(read_mesh_file(writers.write(tmp_path / "BOX.STL", "stl", *box)).faces) == 12
    with pytest.raises(FormatError, match="null byte"):
        read_mesh_file(tmp_path / "null\0byte.stl")


def test_the_hash_of_a_single_file_is_that_of_its_bytes_and_covers_a_buffer_beside_it(writers, box, tmp_path):
    path = writers.write(tmp_path / "box.stl", "stl", *box)
    assert len(mesh_sha256(path)) == 64
    gltf = writers.write(tmp_path / "other.gltf", "gltf", *box)
    before = mesh_sha256(gltf)
    data = bytearray(gltf.with_suffix(".bin").read_bytes())
    data[-1] ^= 1
    gltf.with_suffix(".bin").write_bytes(data)
    assert mesh_sha256(gltf) != before


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30, -1e300])
@pytest.mark.filterwarnings("ignore:overflow encountered in cast:RuntimeWarning")
def test_vertices_that_are_not_finite_or_absurd_are_refused(writers, box, tmp_path, kind, value):
    vertices = box[0].copy()
    vertices[3, 1] = value
    path = writers.write(tmp_path / f"box.{kind}", kind, vertices, box[1])
    with pytest.raises(
        FormatError, match="not finite|coordinates of up to 1e.09 m|is no number of JSON|expected a num"
    ):
        load_scene_mesh(path, "m", "obstacle")
