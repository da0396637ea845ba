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
    assert json.loads((out / "result.json").read_text(encoding="utf-8"))["status"] == "invalid_goal"
    with (out / "trajectory.csv").open() as stream:
        assert len(list(csv.reader(stream))) == 1
    with np.load(out / "shapes.npz") as shapes:
        assert len(shapes["positions_m"]) == 0


def test_a_plan_with_a_path_has_no_empty_files(
    make_scenario: Callable[..., Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plan", str(make_scenario().path), "--out", str(tmp_path / "out")]) == 0
    assert EMPTY not in capsys.readouterr().out


@pytest.mark.parametrize("fault", [ValueError("no such colour"), KeyboardInterrupt()])
def test_pictures_that_fail_cost_neither_result_nor_exit_code(
    make_scenario: Callable[..., Scenario],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    fault: BaseException,
) -> None:
    def fail(picture: object, file: Path) -> None:
        raise fault

    monkeypatch.setattr("tdcr_planner.report.scene_png.write_png", fail)
    monkeypatch.setattr("tdcr_planner.report.scene_html.write_html", fail)
    out = tmp_path / "out"
    assert run(["plan", str(make_scenario(title="part_$REV_$DATE <b>").path), "--out", str(out), "--no-progress"]) == 0
    assert sorted(file.name for file in out.iterdir()) == ["result.json", "shapes.npz", "trajectory.csv"]
    told = capsys.readouterr()
    assert "status:    verified" in told.out
    assert "files:" in told.out
    assert "path.png" not in told.out
    if isinstance(fault, KeyboardInterrupt):
        assert "interrupted while drawing: the result stands" in told.err
    else:
        assert told.err.count("is not drawn: ValueError: no such colour") == 2
