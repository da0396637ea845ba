from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from tdcr_planner.cli.main import run
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.session import plan
from tdcr_planner.report.results import write_result


@pytest.fixture
def result_file(make_scenario: Callable[..., Scenario], tmp_path: Path) -> Path:
    return write_result(plan(make_scenario()), tmp_path / "out")


def test_a_table_and_files_come_out(result_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "robustness"
    arguments = ["robustness", str(result_file), "--samples", "4", "--mass", "0", "--out", str(out)]
    assert run(arguments) == 0
    printed = capsys.readouterr().out
    assert "verified for         100 % [39.8, 100] (4 of 4)" in printed
    assert "base angle" in printed
    assert "mass" not in printed
    content = json.loads((out / "robustness.json").read_text(encoding="utf-8"))
    assert content["format"] == "tdcr-robustness/1"
    assert content["tolerances"]["base_position_m"] == 0.0005
    assert set(content["alone"]) == {"youngs_modulus", "tension", "base_position_m", "base_angle_deg"}
    assert content["verified"]["count"] == content["samples"] == 4
    assert len(content["clearance_m_p05"]) == len(content["nominal_clearance_m"]) == len(content["time_s"])
    with Image.open(out / "robustness.png") as picture:
        assert picture.size == (1200, 460)


def test_nothing_is_written_unless_asked(result_file: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    assert run(["robustness", str(result_file), "--samples", "1"]) == 0
    assert sorted(tmp_path.rglob("*")) == before


def test_bad_tolerances_and_results_without_a_path_end_with_2(
    result_file: Path, make_scenario: Callable[..., Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["robustness", str(result_file), "--tension", "5"]) == 2
    assert "0.05 is 5 %" in capsys.readouterr().err
    without = write_result(plan(make_scenario(start={"bending_n": [[90.0, 0.0]]})), tmp_path / "none")
    assert run(["robustness", str(without)]) == 2
    assert "holds no path to assess" in capsys.readouterr().err
