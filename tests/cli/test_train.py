from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.shape.learned import load_shape_model


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "train.toml"
    path.write_text(
        """format = "tdcr-train/1"
[dataset]
cases = 1500
validation_cases = 50
[shooting]
hidden = [8]
[optimiser]
epochs = 1
[bound]
alpha = 0.02
cases = 300
"""
    )
    return path


def test_processes_train_the_same_model(
    root: Path, config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tdcr_planner.learning.fitness._BLAME_CASES", 100)
    robot, models = root / "models/robots/inspection.toml", []
    for name, options in (("here", []), ("there", ["--jobs", "1"])):
        out = tmp_path / f"{name}.pt"
        assert (
            run(["train", str(robot), "--config", str(config), "--out", str(out), *options]) == 1
        )  # one epoch makes no model that is fit
        models.append(load_shape_model(out))
    printed = capsys.readouterr()
    assert models[1].card.describe() in printed.out
    assert [line.split(":")[0] for line in printed.err.splitlines()].count("training") == 2
    for name in ("domain", "training", "libraries"):
        assert getattr(models[0].card, name) == getattr(models[1].card, name)
    weights = [model.torch_module.state_dict() for model in models]
    for name, tensor in weights[0].items():
        # A process that compiles the solver for itself may round otherwise; training enlarges that a thousandfold.
        np.testing.assert_allclose(weights[1][name].numpy(), tensor.numpy(), rtol=0.0, atol=1e-4)


@pytest.mark.parametrize("options", [["--jobs", "0"], ["--jobs", "1", "--scheduler", "tcp://127.0.0.1:9"]])
def test_wrong_numbers_exit_with_2(root: Path, config: Path, tmp_path: Path, options: list[str]) -> None:
    robot, out = root / "models/robots/inspection.toml", tmp_path / "model.pt"
    assert run(["train", str(robot), "--config", str(config), "--out", str(out), *options]) == 2


def test_no_scheduler_exits_with_1(
    root: Path, config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tdcr_planner.cluster.CONNECT_S", 0.5)
    robot, out = root / "models/robots/inspection.toml", tmp_path / "model.pt"
    options = ["--scheduler", "tcp://127.0.0.1:9"]
    assert run(["train", str(robot), "--config", str(config), "--out", str(out), *options]) == 1
    assert "no scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err
    assert not out.exists()
