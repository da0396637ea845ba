from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.planning.scenario import Scenario

EMPTY = "(no path: trajectory.csv and shapes.npz are empty)"


def test_a_plan_without_a_path_says_which_files_are_empty(
    make_scenario: Callable[..., Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    scenario = make_scenario(goal={"tip_position_m": [0.0, 0.0, 5.0]}).path
    assert run(["plan", str(scenario), "--out", str(out), "--time-limit-s", "1"]) == 1
    assert capsys.readouterr().out.splitlines()[-1].strip() == EMPTY
    assert json.loads((out / "result.json").read_text())["status"] == "invalid_goal"
    with (out / "trajectory.csv").open() as stream:
        assert len(list(csv.reader(stream))) == 1
    with np.load(out / "shapes.npz") as shapes:
        assert len(shapes["positions_m"]) == 0


def test_a_plan_with_a_path_has_no_empty_files(
    make_scenario: Callable[..., Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plan", str(make_scenario().path), "--out", str(tmp_path / "out")]) == 0
    assert EMPTY not in capsys.readouterr().out
