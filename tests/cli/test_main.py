from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.cli.commands import COMMANDS
from tdcr_planner.cli.main import run
from tdcr_planner.robot import load_robot
from tdcr_planner.statics.solver import solve_statics


def test_help_names_every_command_and_imports_no_heavy_library() -> None:
    code = (
        "import sys\n"
        "from tdcr_planner.cli.main import run\n"
        "try:\n    run(['--help'])\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
        "heavy = {'torch', 'ompl', 'fcl', 'numba', 'matplotlib', 'plotly', 'trimesh'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for command in COMMANDS:
        assert command in done.stdout


@pytest.mark.parametrize("command", list(COMMANDS))
def test_every_command_has_help_with_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        run([command, "--help"])
    assert end.value.code == 0
    assert f"Example: tdcr {command} " in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("arguments", [[], ["fly"], ["solve"], ["plan", "a.toml"], ["info", "a.toml", "--fast"]])
def test_wrong_arguments_exit_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        run(arguments)
    assert end.value.code == 2
    assert "Traceback" not in capsys.readouterr().err


def test_solve_prints_the_reference_as_json(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = root / "models/robots/inspection.toml"
    assert run(["solve", str(file), "--bending-n", "-1.5,0.5", "--gravity", "-9.81,0,0"]) == 0
    printed = capsys.readouterr()
    content = json.loads(printed.out)
    robot = load_robot(file)
    expected = solve_statics(robot, robot.tensions_from_bending([[[-1.5, 0.5]]]), gravity=[-9.81, 0, 0])
    np.testing.assert_array_equal(content["positions_m"], expected.positions[0])
    np.testing.assert_array_equal(content["rotations"], expected.rotations[0])
    assert content["converged"] is True
    (line,) = printed.err.splitlines()
    tip = [float(value) for value in line[line.index("(") + 1 : line.index(")")].split(",")]
    np.testing.assert_allclose(tip, 1e3 * expected.positions[0, -1], atol=0.005)
    assert line.startswith("tip (")
    assert " mm, converged, stable, residual " in line


@pytest.mark.parametrize("name", ["shape.npz", "shape.json"])
def test_solve_writes_a_file(root: Path, tmp_path: Path, name: str) -> None:
    file = root / "models/robots/two_segment.toml"
    assert run(["solve", str(file), "--bending-n", "1,0,0,1", "--out", str(tmp_path / name)]) == 0
    content = (
        np.load(tmp_path / name) if name.endswith("npz") else json.loads((tmp_path / name).read_text(encoding="utf-8"))
    )
    assert np.asarray(content["positions_m"]).shape == (21, 3)


def test_solve_says_when_there_is_no_shape(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = root / "models/robots/paper.toml"
    code = run(["solve", str(file), "--bending-n", "0,0", "--tip-force", "1e9,0,0"])
    printed = capsys.readouterr()
    content = json.loads(printed.out)
    assert code == 1
    assert printed.err.startswith(f"no shape: {content['status']}, residual ")
    assert content["positions_m"] is None
    assert content["status"] != "converged"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["solve", "none.toml", "--bending-n", "1,0"], "none.toml: no such file"),
        (
            ["solve", "{paper}", "--bending-n", "1,0,0"],
            "--bending-n: expected 2 numbers separated by commas, got '1,0,0'",
        ),
        (["solve", "{paper}", "--bending-n", "1,nan"], "--bending-n: expected 2 numbers"),
        (["solve", "{paper}", "--bending-n", "1,0", "--gravity", "0,0"], "--gravity: expected 3 numbers"),
        (["solve", "{paper}", "--bending-n", "9,0"], "asks tendon 2 for"),
        (
            ["solve", "{paper}", "--bending-n", "1,0", "--out", "a.csv"],
            "--out: expected a file ending in .json or .npz",
        ),
        (["plan", "none.toml", "--out", "{tmp}/x"], "none.toml: no such file"),
        (["plan", "{paper}", "--out", "{tmp}/x"], "format: is a tdcr-robot/1 file, expected tdcr-scenario/1"),
        (["verify", "none.json"], "none.json: no such file"),
        (["view", "none.json"], "none.json: no such file"),
        (["info", "{readme}"], "expected a file ending in .toml, .pt, .json or .npz, got '.md'"),
        (
            ["info", "{pyproject}"],
            "format: expected 'tdcr-robot/1', 'tdcr-robot/2', 'tdcr-scenario/1' or 'tdcr-suite/1', got None",
        ),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], message: str, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {
        "paper": root / "models/robots/paper.toml",
        "readme": root / "README.md",
        "pyproject": root / "pyproject.toml",
        "tmp": tmp_path,
    }
    assert run([argument.format(**places) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert "Traceback" not in error
    assert not list(tmp_path.iterdir())


def test_ctrl_c_says_what_was_kept(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted() -> int:
        """Stand in for a command that is interrupted."""
        raise KeyboardInterrupt

    monkeypatch.setitem(COMMANDS, "info", interrupted)
    assert run(["info"]) == 1
    assert "interrupted: no file is left half-written" in capsys.readouterr().err


def test_info_describes_a_robot(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(root / "models/robots/two_segment.toml")]) == 0
    text = capsys.readouterr().out
    assert "segment 2: 100 mm, 10 disks of 12 mm and 0.2 g" in text
    assert "1 g payload" in text


def test_info_describes_tendons_drive_and_camera_of_a_version_2_robot(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["info", str(root / "models/robots/bench.toml")]) == 0
    text = capsys.readouterr().out
    assert "tendon 4: disk 0 to 12, at 50 degrees, 4.5 mm from the backbone, straight between disks, to 20 N" in text
    assert "displacement drive, pretension 1 N, transmission 7000 N/m" in text
    assert "camera with a field of view of 90 degrees, from 5 to 60 mm" in text
    assert "beyond what the planner and learned models know: displacement drive, elastic" in text
    assert run(["info", str(root / "models/robots/helical.toml")]) == 0
    text = capsys.readouterr().out
    assert "tendon 1: disk 0 to 20, winding by 1 turns from 0 degrees, 8 mm from the backbone, to 5 N" in text
    assert "tendon 2: disk 0 to 20, at 90 degrees, 8 to 2 mm from the backbone, to 5 N" in text


def test_info_shows_a_model_as_a_table_for_a_terminal(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(root / "models/shape/inspection/model.pt")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert [line.split()[:2] for line in lines if "(" in line and line.startswith("  ")] == [
        ["position", "(mm)"],
        ["rotation", "(deg)"],
        ["residual", "(N"],
    ] * 2
    median, percentile, largest = (float(cell) for cell in lines[4].split()[2:])
    assert 0.0 < median < percentile < largest


def test_info_counts_the_jobs_of_a_suite(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(root / "scenes/benchmark.toml")]) == 0
    text = capsys.readouterr().out
    assert "370 jobs" in text  # 37 scenarios, 10 seeds, one planner, one model
    assert text.count("scenario_") == 37
    assert max(map(len, text.splitlines())) <= 80


def test_info_describes_a_scenario(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(root / "scenes/airway/scenario_tour.toml")]) == 0
    text = capsys.readouterr().out
    assert "gravity (0, 0, -9.81) m/s^2, no tip force" in text
    assert "goal 2: tip at (155, 26, 2) mm" in text


def test_a_reader_that_has_seen_enough_gets_no_traceback(root: Path) -> None:
    program = "from tdcr_planner.cli.main import main; main()"
    pipe = f"'{sys.executable}' -c '{program}' info '{root}/models/robots/two_segment.toml' | true"
    done = subprocess.run(["sh", "-c", pipe], capture_output=True, text=True, check=True)
    assert done.stderr == ""
