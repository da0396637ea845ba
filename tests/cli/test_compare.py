from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.planning.scenario import Scenario


def test_compares_and_prints_rates(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, out = root / "scenes/duct/scenario_sag.toml", tmp_path / "out"
    assert run(["compare", str(scenario), "--out", str(out), "--samples", "60", "--paths", "0", "--jobs", "1"]) == 0
    printed = capsys.readouterr().out
    assert "states:    60" in printed
    assert "constant_curvature:" in printed
    assert json.loads((out / "compare.json").read_text(encoding="utf-8"))["samples"] == 60


def test_without_a_shape_model_exits_with_2(
    make_scenario: Callable[..., Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["compare", str(make_scenario().path), "--out", str(tmp_path / "out")]) == 2
    assert "shape_model" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_no_samples_exits_with_2(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = root / "scenes/duct/scenario_sag.toml"
    assert run(["compare", str(scenario), "--out", str(tmp_path / "out"), "--samples", "0"]) == 2
    assert "samples" in capsys.readouterr().err
