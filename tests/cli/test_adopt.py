"""tdcr adopt: exit codes, messages, and what is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.robot import RobotSpec

ROBOT = Path(__file__).resolve().parents[2] / "models/robots/paper.toml"
QUICK = ["--alpha", "0.1", "--cases", "120", "--no-progress"]


def adopt(module: Path, *options: str) -> int:
    return run(
        ["adopt", str(module), "--robot", str(ROBOT), "--out", str(module.parent / "model.pt"), *QUICK, *options]
    )


@pytest.fixture
def save(networks: Any, tmp_path: Path) -> Any:
    def save_module(module: Any) -> Path:
        path = tmp_path / "mine.pt"
        path.write_bytes(networks.to_bytes(networks.script(module.eval())))
        return path

    return save_module


def test_a_fit_network_is_written_with_its_picture(
    networks: Any, save: Any, paper_robot: RobotSpec, capsys: pytest.CaptureFixture[str]
) -> None:
    module = save(networks.Converted(paper_robot, scale=1e3, turn_deg=30.0))
    assert adopt(module, "--length-unit", "mm", "--base-turn-deg", "30") == 0
    told = capsys.readouterr().out
    assert "fit for planning: in 90% of states" in told
    assert "times as fast as the reference" in told or "slower than the reference" in told
    assert sorted(path.name for path in module.parent.iterdir()) == ["mine.pt", "model.pt", "model_error.png"]
    assert run(["info", str(module.parent / "model.pt")]) == 0
    assert "adopted torchscript network of mine.pt" in capsys.readouterr().out


def test_an_unfit_network_is_written_and_exit_code_1_says_so(
    networks: Any, save: Any, paper_robot: RobotSpec, capsys: pytest.CaptureFixture[str]
) -> None:
    module = save(networks.Converted(paper_robot, scale=0.8))
    assert adopt(module) == 1
    assert "NOT fit for planning" in capsys.readouterr().out
    assert (module.parent / "model.pt").exists()


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        ({"scale": 1e3}, "--length-unit mm"),
        ({"order": (2, 0, 1)}, "--tendon-order 2,3,1"),
        ({"transposed": True}, "--transposed"),
    ],
)
def test_a_mistake_is_exit_code_2_and_nothing_is_written(
    mistake: dict[str, Any],
    words: str,
    networks: Any,
    save: Any,
    paper_robot: RobotSpec,
    capsys: pytest.CaptureFixture[str],
) -> None:
    module = save(networks.Converted(paper_robot, **mistake))
    assert adopt(module) == 2
    assert words in capsys.readouterr().err
    assert [path.name for path in module.parent.iterdir()] == ["mine.pt"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--tendon-order", "1,2"], "each of 1 to 3 once"),
        (["--inputs", "tension"], "did you mean 'tensions'"),
        (["--outputs", "rotations"], "positions or poses"),
        (["--tension-share", "2"], "--tension-share"),
        (["--cases", "5"], "at least"),
    ],
)
def test_bad_options_are_exit_code_2(
    options: list[str],
    words: str,
    networks: Any,
    save: Any,
    paper_robot: RobotSpec,
    capsys: pytest.CaptureFixture[str],
) -> None:
    module = save(networks.Converted(paper_robot))
    assert adopt(module, *options) == 2
    assert words in capsys.readouterr().err
    assert [path.name for path in module.parent.iterdir()] == ["mine.pt"]


def test_a_module_that_writes_is_refused(attacks: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module = tmp_path / "mine.pt"
    module.write_bytes(attacks.archive(attacks.code("load", f'torch.save(x, "{tmp_path}/written")')))
    assert adopt(module) == 2
    error = capsys.readouterr().err
    assert "mine.pt" in error
    assert "__setstate__" in error
    assert [path.name for path in tmp_path.iterdir()] == ["mine.pt"]
