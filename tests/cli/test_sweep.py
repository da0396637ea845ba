from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.cli.sweep import describe
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.sweep.runner import SweepOutcome
from tdcr_planner.sweep.suite import load_suite


@pytest.fixture
def suite(make_scenario: Callable[..., Scenario], tmp_path: Path) -> Path:
    make_scenario()
    path = tmp_path / "suite.toml"
    path.write_text(
        'format = "tdcr-suite/1"\nscenarios = [{file = "scenario.toml", difficulty = "easy"}]\n'
        'planners = ["RRTConnect"]\nmodels = ["constant_curvature"]\nseeds = [1, 2]\n'
    )
    return path


def test_sweeps_writes_a_report_and_goes_on(suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(["sweep", str(suite), "--out", str(out), "--jobs", "1"]) == 0
    printed = capsys.readouterr().out
    assert "finished: 2 of 2 jobs, 0 of them in an earlier run" in printed
    assert "RRTConnect, constant_curvature: 2 of 2" in printed
    assert json.loads((out / "summary.json").read_text(encoding="utf-8"))["complete"]
    before = (out / "results.csv").read_bytes()
    assert run(["sweep", str(suite), "--out", str(out), "--jobs", "1"]) == 0
    assert "2 of 2 jobs, 2 of them in an earlier run" in capsys.readouterr().out
    assert (out / "results.csv").read_bytes() == before


def test_the_terminal_says_how_the_other_queries_ended(suite: Path) -> None:
    records = {
        0: {"status": "invalid_goal", "result": {}, "timing": {}},
        1: {"status": "no_path", "result": {}, "timing": {}},
    }
    assert "0 of 2 (0 to 84 %), 1 invalid_goal, 1 no_path" in describe(SweepOutcome(load_suite(suite), records, 0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('"RRTConnect"', '"Teleport"'), "Teleport"),
        (('"scenario.toml"', '"nowhere.toml"'), "nowhere.toml"),
        (("[1, 2]", "[]"), "nothing to do"),
    ],
)
def test_a_suite_that_cannot_be_run_exits_with_2(
    suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], words: str
) -> None:
    suite.write_text(suite.read_text(encoding="utf-8").replace(*change))
    assert run(["sweep", str(suite), "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_of_another_sweep_exits_with_2(
    suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "jobs.jsonl").write_text('{"format": "tdcr-sweep/1", "suite_sha256": "0", "jobs": 1}\n')
    assert run(["sweep", str(suite), "--out", str(out)]) == 2
    assert "another sweep" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--jobs", "0"], ["--jobs", "1", "--scheduler", "tcp://127.0.0.1:9"]])
def test_wrong_numbers_exit_with_2(suite: Path, tmp_path: Path, arguments: list[str]) -> None:
    assert run(["sweep", str(suite), "--out", str(tmp_path / "out"), *arguments]) == 2


def test_no_scheduler_exits_with_1(
    suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tdcr_planner.cluster.CONNECT_S", 0.5)
    assert run(["sweep", str(suite), "--out", str(tmp_path / "out"), "--scheduler", "tcp://127.0.0.1:9"]) == 1
    assert "no scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().out
