"""tdcr scene writes a scenario that plans, or says why there is none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.planning.scenario import load_scenario

ROOT = Path(__file__).parents[2]


def test_a_mesh_and_a_robot_make_a_verified_scenario(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, model = ROOT / "models/robots/paper.toml", ROOT / "models/shape/paper/model.pt"
    arguments = ["scene", str(ROOT / "scenes/duct/duct.stl"), "--robot", str(robot), "--shape-model", str(model)]
    assert run([*arguments, "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "unit mm" in told
    assert "a robot of 20 mm fits in" in told
    scenario = load_scenario(tmp_path / "out" / "scenario.toml")
    assert scenario.file.meshes[0].role == "cavity"
    assert json.loads((tmp_path / "out/plan/result.json").read_text(encoding="utf-8"))["status"] == "verified"


def test_a_place_without_an_opening_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["scene", str(ROOT / "scenes/cad/housing.step"), "--out", str(tmp_path / "out")]) == 1
    assert "none of the files has an opening" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()


def test_a_volume_without_a_region_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["scene", str(ROOT / "scenes/ct/airway.nii.gz"), "--out", str(tmp_path / "out")]) == 2
    assert "--label or --threshold" in capsys.readouterr().err
