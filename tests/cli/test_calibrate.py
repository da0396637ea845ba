"""tdcr calibrate: what it writes and prints, and bad input as one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.simulate import smooth_motion, write_simulated
from tdcr_planner.cli.main import run
from tdcr_planner.robot import load_robot


@pytest.fixture(scope="module")
def measured(root, tmp_path_factory):
    robot = load_robot(root / "models/robots/opencr.toml")
    random = np.random.default_rng(5)
    bench = Bench.nominal(robot, np.array([0.0, 0.0, 0.008]))
    path = tmp_path_factory.mktemp("bench") / "bench.csv"
    return write_simulated(path, bench, smooth_motion(9, 40, 0.002, random), 1e-3, random, point="marker")


def arguments(root, measured, out, *more):
    robot = str(root / "models/robots/opencr.toml")
    return ["calibrate", robot, str(measured), "--out", str(out), "--marker-mm", "0", "0", "8", *more]


def test_writes_robot_table_residuals_and_figure(root, measured, tmp_path, capsys):
    assert run(arguments(root, measured, tmp_path, "--fit", "base,offsets", "--stretches", "2", "--no-progress")) == 0
    printed = capsys.readouterr().out
    assert "offset tendon 9" in printed
    assert "constant curvature" in printed
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"robot.toml", "parameters.csv", "residuals.csv", "calibration.json", "residuals.png"}
    content = json.loads((tmp_path / "calibration.json").read_text(encoding="utf-8"))
    assert content["format"] == "tdcr-calibration/1"
    assert content["fitted"] == ["base", "offsets"]
    assert content["error_held_out"]["calibrated"]["rms_m"] < 0.003
    robot = load_robot(tmp_path / "robot.toml")
    assert robot.measured_error.disks_m[-1] == content["measured_error"]["disks_m"][-1]
    rows = (tmp_path / "parameters.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "parameter,unit,value,standard_error,nominal,determined"
    assert len(rows) == 1 + 6 + 9
    residuals = np.genfromtxt(tmp_path / "residuals.csv", delimiter=",", skip_header=1)
    assert residuals.shape == (40, 3 + 6)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--fit", "zeros"], "--fit"),
        (["--stretches", "1"], "--stretches: expected 2 to 100"),
    ],
)
def test_bad_options_are_one_line(root, measured, tmp_path, capsys, more, message):
    assert run(arguments(root, measured, tmp_path / "out", *more)) == 2
    text = capsys.readouterr().err
    assert message in text
    assert text.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_another_robots_data_is_one_line(root, measured, tmp_path, capsys):
    robot = str(root / "models/robots/paper.toml")
    assert run(["calibrate", robot, str(measured), "--out", str(tmp_path / "out"), "--no-progress"]) == 2
    text = capsys.readouterr().err
    assert "missing columns: tension_1_n to tension_3_n" in text
    assert text.count("\n") == 1
