"""A shape model and a planner of another package, found by entry points and used like this package's own."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tdcr_planner.cli.main import run
from tdcr_planner.collision.roles import CAVITY, MESH_ROLES
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.session import plan
from tdcr_planner.report.picture import gather_picture
from tdcr_planner.report.scene_figure import build_figure

ROOT = Path(__file__).resolve().parents[2]
MODULE = '''
"""Arcs that bend less than constant curvature says, and a planner that knows one path: straight to the goal."""

import numpy as np

from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.planner import Planner, SearchOutcome, SearchStatus
from tdcr_planner.shape.base import ShapeModel
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape


class StiffArcs(ShapeModel):
    name = "stiff_arcs"
    colour = "#117733"

    def __init__(self, robot):
        self.robot = robot
        self.error_bound = np.full(robot.disk_count, 1e-3)
        self._arcs = ConstantCurvatureShape(robot)

    @classmethod
    def load(cls, robot, file):
        return cls(robot)

    def disk_poses(self, tensions, *, gravity=None, tip_force=None):
        return self._arcs.disk_poses(0.99 * np.asarray(tensions), gravity=gravity, tip_force=tip_force)


class StraightLine(Planner):
    name = "StraightLine"
    repairs = False

    def search(self, task):
        rows = np.stack([task.space.row_of(state) for state in (task.scenario.file.start, *task.scenario.goals)])
        if not EdgeChecker(task.checker, task.scenario.planner.step_m).path_valid(rows):
            return SearchOutcome(SearchStatus.NO_PATH, "the straight path is not free")
        goals = tuple(range(1, len(rows)))
        order = tuple(range(len(goals)))
        return SearchOutcome(SearchStatus.FOUND, "a straight path", rows, goals, order, {"name": self.name})
'''
GOOD = """[tdcr_planner.shape_models]
stiff_arcs = toy_plugin:StiffArcs

[tdcr_planner.planners]
StraightLine = toy_plugin:StraightLine
"""
BAD = """[tdcr_planner.shape_models]
reference = toy_plugin:StiffArcs
broken_arcs = no_such_module:Arcs

[tdcr_planner.planners]
RRTConnect = toy_plugin:StraightLine
"""


@pytest.fixture
def site(tmp_path):
    """A folder as pip leaves it: modules with the files by which a package tells what it registers."""
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "toy_plugin.py").write_text(MODULE)
    for name, entries in (("toy-plugin", GOOD), ("bad-plugin", BAD)):
        info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(entries)
    return folder


@pytest.fixture
def scenario_file(write_scenario):
    table = {
        "format": "tdcr-scenario/1",
        "robot": str(ROOT / "models/robots/paper.toml"),
        "meshes": [{"file": "box.stl", "unit": "mm", "role": "obstacle"}],
        "start": {"bending_n": [[0.0, 0.0]]},
        "goal": {"bending_n": [[1.0, 0.0]]},
        "planner": {"name": "StraightLine", "validity": "stiff_arcs"},
    }
    return write_scenario(table)


@pytest.fixture
def tdcr(site, monkeypatch, capsys):
    monkeypatch.syspath_prepend(site)
    # What is tested elsewhere: pictures take longer than all else.
    for name in ("tdcr_planner.report.results.draw_result", "tdcr_planner.report.compare_results.draw_comparison"):
        monkeypatch.setattr(name, lambda *_: [])

    def run_command(*arguments):
        code = run([str(argument) for argument in arguments])
        return code, *capsys.readouterr()

    yield run_command
    sys.modules.pop("toy_plugin", None)


def test_a_package_s_model_and_planner_plan_compare_and_sweep(tdcr, scenario_file, tmp_path):
    code, out, err = tdcr("plan", scenario_file, "--out", tmp_path / "plan", "--no-progress")
    assert code == 0, out + err
    result = json.loads((tmp_path / "plan/result.json").read_text(encoding="utf-8"))
    assert (result["status"], result["planner"]["name"]) == ("verified", "StraightLine")
    # The package that takes other names is told of, once a name.
    assert err.count("bad-plugin registers a shape model 'reference'") == 1
    assert err.count("bad-plugin registers a planner 'RRTConnect'") == 1

    code, out, err = tdcr(
        "compare", scenario_file, "--models", "stiff_arcs", "constant_curvature", "--samples", "30", "--paths", "1",
        "--jobs", "1", "--out", tmp_path / "compare", "--no-progress",
    )  # fmt: skip
    assert code == 0, out + err
    compared = json.loads((tmp_path / "compare/compare.json").read_text(encoding="utf-8"))
    assert {"stiff_arcs", "stiff_arcs_as_planned", "constant_curvature"} <= set(compared["variants"])
    assert [entry["model"] for entry in compared["times"]] == ["stiff_arcs", "constant_curvature", "reference"]

    suite = tmp_path / "suite.toml"
    suite.write_text(
        'format = "tdcr-suite/1"\nplanners = ["StraightLine"]\nmodels = ["stiff_arcs"]\nseeds = [1, 2]\n'
        f'scenarios = [{{ file = "{scenario_file}", difficulty = "easy" }}]\n'
    )
    code, out, err = tdcr("sweep", suite, "--out", tmp_path / "sweep", "--jobs", "1", "--no-progress")
    assert code == 0, out + err
    assert "StraightLine, stiff_arcs: 2 of 2" in out


def test_a_package_that_cannot_be_imported_is_named_and_all_else_works(tdcr, scenario_file, tmp_path):
    code, _, err = tdcr("plan", scenario_file, "--validity", "broken_arcs", "--out", tmp_path / "out", "--no-progress")
    assert code == 2
    assert "bad-plugin" in err
    assert "no_such_module" in err
    options = ("--planner", "RRTConnect", "--validity", "constant_curvature")
    code, out, err = tdcr("plan", scenario_file, *options, "--out", tmp_path / "out", "--no-progress")
    assert code == 0, out + err


def test_a_role_of_meshes_is_one_entry_of_their_table(scenario_file, monkeypatch, tmp_path):
    lumen = replace(CAVITY, name="lumen", wall=replace(CAVITY.wall, shades=("#113355", "#AACCEE")))
    monkeypatch.setitem(MESH_ROLES, "lumen", lumen)
    text = (
        scenario_file.read_text(encoding="utf-8")
        .replace('"obstacle"', '"lumen"')
        .replace("stiff_arcs", "constant_curvature")
    )
    scenario_file.write_text(text.replace("StraightLine", "RRTConnect"))
    trimesh.creation.box((400.0, 400.0, 900.0)).export(tmp_path / "box.stl")
    result = plan(load_scenario(scenario_file), seed=1)
    assert result.status is PlanStatus.VERIFIED
    # The body keeps off the walls that it is inside of.
    assert 0.0 < result.verification.worst["clearance_m"] < 0.2
    figure = build_figure(gather_picture(result), np.array([0]))
    assert "box.stl (lumen)" in [trace["name"] for trace in figure["data"] if "name" in trace]
