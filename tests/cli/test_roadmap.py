from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.roadmap import Roadmap


@pytest.fixture
def scenario(write_scenario: Callable[[dict[str, Any]], Path], root: Path) -> Path:
    return write_scenario(
        {
            "format": "tdcr-scenario/1",
            "robot": str(root / "models/robots/paper.toml"),
            "meshes": [{"file": "box.stl", "unit": "mm", "role": "obstacle"}],
            "start": {"bending_n": [[0.0, 0.0]]},
            "goal": {"bending_n": [[1.0, 0.0]]},
            "planner": {"validity": "constant_curvature", "step_m": 0.004},
        }
    )


def test_a_roadmap_is_built_and_answers_a_plan(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "out" / "scene.npz"
    assert run(["roadmap", str(scenario), "--out", str(file), "--vertices", "40", "--seconds", "120"]) == 0
    said = capsys.readouterr().out
    assert "roadmap:   40 configurations, " in said
    assert "holds for: constant_curvature shapes, clearance 0.5 mm and less, step 4 mm and more" in said
    assert run(["info", str(file)]) == 0
    assert capsys.readouterr().out.strip() in said
    again = tmp_path / "again.npz"
    assert run(["roadmap", str(scenario), "--out", str(again), "--vertices", "40", "--seconds", "120"]) == 0
    np.testing.assert_array_equal(Roadmap.load(again).rows, Roadmap.load(file).rows)
    capsys.readouterr()
    assert run(["plan", str(scenario), "--out", str(tmp_path / "plan"), "--roadmap", str(file)]) == 0
    assert "roadmap:   had the way (40 configurations, " in capsys.readouterr().out
    planner = json.loads((tmp_path / "plan" / "result.json").read_text(encoding="utf-8"))["planner"]
    assert planner["name"] == "RRTConnect"
    assert planner["iterations"] == 0
    assert planner["roadmap"] == {**Roadmap.load(file).size, "answered": True}
    assert run(["verify", str(tmp_path / "plan" / "result.json")]) == 0


def test_ctrl_c_keeps_what_has_been_built(
    scenario: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    check_edge = EdgeChecker.check_edge

    def interrupted(edges: EdgeChecker, row_a: np.ndarray, row_b: np.ndarray) -> bool:
        if edges.edges_checked >= 300:
            raise KeyboardInterrupt
        return check_edge(edges, row_a, row_b)

    monkeypatch.setattr(EdgeChecker, "check_edge", interrupted)
    assert run(["roadmap", str(scenario), "--out", str(tmp_path / "a.npz"), "--seconds", "600"]) == 1
    assert capsys.readouterr().out.startswith("interrupted: what has been built by then is kept\n")
    assert 0 < len(Roadmap.load(tmp_path / "a.npz").edges) <= 300


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["roadmap", "{scenario}", "--out", "{tmp}/a.json"], "--out: expected a file ending in .npz, got "),
        (["roadmap", "{scenario}", "--out", "{tmp}/a.npz", "--seconds", "0"], "--seconds: expected 0.001 to 604800"),
        (["roadmap", "{scenario}", "--out", "{tmp}/a.npz", "--seconds", "nan"], "--seconds: expected 0.001 to 604800"),
        (["roadmap", "{scenario}", "--out", "{tmp}/a.npz", "--vertices", "0"], "--vertices: expected 1 to 10000000"),
        (["roadmap", "{scenario}", "--out", "{tmp}/a.npz", "--seed", "0"], "--seed: expected 1 to 2147483647"),
        (["roadmap", "{scenario}", "--out", "{scenario}/a.npz"], "scenario.toml: cannot be written: "),
        (
            ["plan", "{scenario}", "--out", "{tmp}/b", "--seed", "0"],
            "planner.seed: expected 1 to 2147483647",
        ),
        (
            ["plan", "{scenario}", "--out", "{tmp}/b", "--time-limit-s", "nan"],
            "planner.time_limit_s: expected a fini",
        ),
        (["plan", "{scenario}", "--out", "{scenario}/b"], "scenario.toml is no folder"),
        (["compare", "{scenario}", "--out", "{scenario}/b"], "scenario.toml is no folder"),
        (["roadmap", "none.toml", "--out", "{tmp}/a.npz"], "none.toml: no such file"),
        (["plan", "{scenario}", "--out", "{tmp}/b", "--roadmap", "none.npz"], "none.npz: no such file"),
        (["plan", "{scenario}", "--out", "{tmp}/b", "--roadmap", "{scenario}"], "is damaged or no roadmap"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], message: str, scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"scenario": scenario, "tmp": tmp_path}
    before = sorted(tmp_path.iterdir())
    assert run([argument.format(**places) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert "Traceback" not in error
    assert sorted(tmp_path.iterdir()) == before


def test_a_roadmap_of_another_scene_is_refused_by_name(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.npz"
    assert run(["roadmap", str(scenario), "--out", str(file), "--vertices", "5", "--seconds", "120"]) == 0
    capsys.readouterr()
    for old, new, problem in (
        ('unit = "mm"', 'unit = "in"', "meshes[1].unit: mm, not in"),
        ("step_m = 0.004", "step_m = 0.003", "step_m: 0.004, more than 0.003"),
        ("step_m = 0.004", "step_m = 0.004, clearance_m = 0.001", "clearance_m: 0.0005, less than 0.001"),
        ('"constant_curvature"', '"reference"', "model.name: constant_curvature, not reference"),
    ):
        text = scenario.read_text(encoding="utf-8")
        assert old in text
        other = tmp_path / "other.toml"
        other.write_text(text.replace(old, new))
        assert run(["plan", str(other), "--out", str(tmp_path / "b"), "--roadmap", str(file)]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"error: {file}: expected a roadmap that serves the scenario")
        assert f"one made for {problem}" in error
        assert not (tmp_path / "b").exists()
