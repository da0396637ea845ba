"""The way through: a shipped scenario in, a verified path and its files out, by command and by call."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tdcr_planner import load_scenario, plan, verify
from tdcr_planner.cli.main import run
from tdcr_planner.files import read_toml
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.session import PlanningSession

ROOT = Path(__file__).resolve().parents[2]


def easy_scenarios() -> list[Path]:
    suite = read_toml(ROOT / "scenes/benchmark.toml")
    first: dict[str, Path] = {}
    for entry in suite["scenarios"]:
        file = ROOT / "scenes" / entry["file"]
        if entry["difficulty"] == "easy":
            first.setdefault(file.parent.name, file)
    return list(first.values())


@pytest.fixture(scope="module")
def elbow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder with the result of the elbow scenario, planned by the command."""
    out = tmp_path_factory.mktemp("elbow")
    assert run(["plan", str(ROOT / "scenes/duct/scenario_elbow.toml"), "--out", str(out)]) == 0
    return out


@pytest.mark.parametrize("file", easy_scenarios(), ids=lambda file: file.parent.name)
def test_the_easy_scenario_of_each_scene_is_verified(file: Path) -> None:
    result = plan(load_scenario(file))
    assert result.status is PlanStatus.VERIFIED, result.message
    assert result.path is not None
    report = verify(result, refine=4)
    assert report.verified, report.message
    assert report.worst["clearance_m"] >= result.scenario.planner.clearance_m


def test_plan_writes_every_file_of_a_result(elbow: Path) -> None:
    assert {item.name for item in elbow.iterdir()} == {
        "result.json",
        "trajectory.csv",
        "path.png",
        "path.html",
        "shapes.npz",
    }
    content = json.loads((elbow / "result.json").read_text(encoding="utf-8"))
    assert content["format"] == "tdcr-result/1"
    assert content["status"] == "verified"
    assert content["verification"]["verified"] is True
    assert content["verification"]["worst"]["clearance_m"] >= 0.0005
    assert set(content["timings_s"]) == {"load", "plan", "verify", "total"}
    count = len(content["path"]["insertion_m"])
    for key in ("bending_n", "roll_deg", "tensions_n", "tendon_displacement_m", "tip_position_m"):
        assert len(content["path"][key]) == count
    with (elbow / "trajectory.csv").open() as stream:
        assert len(list(csv.reader(stream))) == count + 1


def test_a_written_result_is_verified_again(elbow: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["verify", str(elbow / "result.json"), "--refine", "3"]) == 0
    assert capsys.readouterr().out.startswith("verified: ")
    assert run(["info", str(elbow / "result.json")]) == 0
    assert "status:    verified" in capsys.readouterr().out


def test_a_result_whose_path_was_tampered_with_is_not_verified(elbow: Path, tmp_path: Path) -> None:
    for item in elbow.iterdir():
        shutil.copy(item, tmp_path)
    content = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    middle = len(content["path"]["bending_n"]) // 2
    content["path"]["bending_n"][middle] = [[3.0, 0.0]]
    content["scenario"] = content["scenario_absolute"]
    (tmp_path / "result.json").write_text(json.dumps(content))
    assert run(["verify", str(tmp_path / "result.json")]) == 1


def test_the_same_seed_gives_the_same_path_and_another_one_another() -> None:
    session = PlanningSession(load_scenario(ROOT / "scenes/duct/scenario_narrowing.toml"))
    paths = [session.plan(session.scenario.with_planner(seed=seed)).path for seed in (3, 3, 4)]
    assert all(path is not None for path in paths)
    first, again, other = (path for path in paths if path is not None)
    np.testing.assert_array_equal(first.bending, again.bending)
    np.testing.assert_array_equal(first.insertion, again.insertion)
    assert first.bending.shape != other.bending.shape or not np.array_equal(first.bending, other.bending)


PLATE = """
format = "tdcr-scenario/1"
robot = "{root}/models/robots/inspection.toml"
gravity_m_s2 = [0.0, 0.0, -9.81]
meshes = [{{ file = "plate.stl", unit = "mm", role = "obstacle" }}]
start = {{ bending_n = [[-0.4, 0.0]] }}
goal = {{ bending_n = [[0.0, 0.0]], insertion_m = 0.2 }}
planner = {{ time_limit_s = 5.0, validity = "constant_curvature" }}

[base]
position_m = [-0.22, 0.0, 0.0]
quaternion_wxyz = [0.7071067811865476, 0.0, 0.7071067811865476, 0.0]
insertion_m = [0.0, 0.2]
"""


def test_a_path_planned_on_a_wrong_shape_model_comes_out_unverified(tmp_path: Path) -> None:
    # A hole of 40 mm radius straight ahead: without gravity the straight robot of 10 mm radius passes it, in truth its
    # tip hangs more than 30 mm below the axis.
    plate = trimesh.creation.annulus(r_min=40.0, r_max=120.0, height=10.0)
    plate.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
    plate.export(tmp_path / "plate.stl")
    (tmp_path / "scenario.toml").write_text(PLATE.format(root=ROOT.as_posix()))
    result = plan(load_scenario(tmp_path / "scenario.toml"))
    assert result.status is PlanStatus.UNVERIFIED
    assert "the reference does not confirm it" in result.message
    assert result.verification is not None
    assert result.verification.worst["deviation_m"] > 0.03
    assert result.verification.worst["clearance_m"] < 0.0
