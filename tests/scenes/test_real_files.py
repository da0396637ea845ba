"""The files of real places hold what they claim."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.planning.scene import load_scene_meshes

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def load_maker(scene: str):
    spec = importlib.util.spec_from_file_location(f"make_{scene}", SCENES / scene / "make_scene.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_surface_of_the_ct_lies_within_its_stated_error_of_the_tree_it_was_made_from():
    scenario = load_scenario(SCENES / "ct" / "scenario_main.toml")
    (mesh,) = load_scene_meshes(scenario)
    rng = np.random.default_rng(3)
    faces = mesh.faces[rng.integers(0, len(mesh.faces), 10_000)]
    weights = rng.dirichlet(np.ones(3), 10_000)
    points = np.einsum("nk,nkj->nj", weights, mesh.vertices[faces])
    off = np.abs(load_maker("ct").distance(1e3 * points))
    inside_volume = points[:, 2] < 0.0335  # not on the rim of the cut
    assert 1e-3 * off[inside_volume].max() <= scenario.surface_error


def test_the_volume_is_what_its_script_makes():
    maker = load_maker("ct")
    import nibabel

    values, affine = maker.make_volume()
    stored = nibabel.load(SCENES / "ct" / "airway.nii.gz")
    np.testing.assert_array_equal(np.asarray(stored.dataobj.get_unscaled()), values)
    np.testing.assert_allclose(stored.affine, affine, atol=1e-5)  # NIfTI states it in single precision


def test_the_scan_is_what_its_script_makes():
    points = load_maker("scan").make_points()
    data = (SCENES / "scan" / "duct.ply").read_bytes()
    stored = np.frombuffer(data[data.index(b"end_header\n") + 11 :], dtype="<f4").reshape(-1, 3)
    np.testing.assert_allclose(stored, points, atol=4e-5)
