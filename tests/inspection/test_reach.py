from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.cli.main import run
from tdcr_planner.errors import InputError
from tdcr_planner.inspection.reach import ReachMap, Verdict, map_reach
from tdcr_planner.planning.edges import EdgeChecker
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.report.reach_results import REACH_FILES, pair_classes

Make = Callable[..., Scenario]


@pytest.fixture(scope="module")
def mapped(write_inspection: Make, tmp_path_factory: pytest.TempPathFactory) -> tuple[PlanningSession, ReachMap]:
    session = PlanningSession(write_inspection(tmp_path_factory.mktemp("reach")))
    return session, map_reach(session, cells=600, time_limit_s=60.0, batches=4)


def test_what_is_called_attained_is_so_by_the_reference(mapped: tuple[PlanningSession, ReachMap]) -> None:
    session, found = mapped
    attained = np.flatnonzero(found.verdicts <= Verdict.NO_PATH)
    assert len(attained) > 30
    good, states = session.verifier().judge_each(found.rows[attained])
    assert good.all()
    np.testing.assert_array_equal(found.grid.find(states.positions[:, -1]), attained)
    np.testing.assert_allclose(found.tips[attained], states.positions[:, -1])


def test_reached_cells_have_a_way_from_the_start(mapped: tuple[PlanningSession, ReachMap]) -> None:
    session, found = mapped
    # In this open scene the straight motion from the start passes for some; it proves these without the map's own.
    edges = EdgeChecker(session.checker(), session.scenario.planner.step_m)
    start = session.space.row(((0.0, 0.0),))
    rows = found.rows[found.verdicts == Verdict.REACHED]
    assert sum(edges.check_edge(start, row) for row in rows[:40]) > 10


def test_cells_within_the_plate_collide(mapped: tuple[PlanningSession, ReachMap]) -> None:
    _, found = mapped
    centres = found.grid.centres
    hit = (np.abs(centres[:, 2] - 0.315) < 0.005) & (np.abs(centres[:, :2]).max(axis=1) < 0.14)
    assert not (found.verdicts[hit] <= Verdict.NO_PATH).any()
    collides = found.verdicts == Verdict.COLLIDES
    assert {cause for cause, at in zip(found.causes, collides, strict=True) if at} <= {"obstacle", "self_collision"}


def test_a_map_against_itself_has_no_difference(mapped: tuple[PlanningSession, ReachMap]) -> None:
    _, found = mapped
    assert set(pair_classes(found, found).tolist()) <= {0, 3}


def test_the_command_writes_a_row_a_cell(make_inspection: Make, tmp_path: Path) -> None:
    out = tmp_path / "out"
    scenario = make_inspection().path
    options = ["--out", str(out), "--cells", "200", "--time-limit-s", "1", "--no-progress", "--against", str(scenario)]
    assert run(["reach", str(scenario), *options]) == 0
    assert sorted(item.name for item in out.iterdir()) == sorted(REACH_FILES)
    content = json.loads((out / "reach.json").read_text(encoding="utf-8"))
    with (out / "reach.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == np.prod(content["grid"]["shape"]) == sum(content["cells"].values())
    assert sum(content["difference"].values()) == len(rows)


def test_too_few_cells_are_refused(make_inspection: Make, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    session = PlanningSession(make_inspection())
    with pytest.raises(InputError, match="8 or more"):
        map_reach(session, cells=2)
    assert run(["reach", str(session.scenario.path), "--out", str(tmp_path / "out"), "--cells", "2"]) == 2
    assert "--cells" in capsys.readouterr().err


def test_surfaces_are_mapped_without_a_path(
    make_inspection: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tdcr_planner.report.coverage_results.draw_inspection", lambda *_: [])
    scenario = str(make_inspection(surfaces=[{"mesh": "plate.stl", "facing": [0.0, 0.0, -1.0]}]).path)
    out = tmp_path / "out"
    assert run(["reach", scenario, "--surfaces", "--out", str(out), "--time-limit-s", "1", "--no-progress"]) == 0
    assert "can be seen by paths from the start" in capsys.readouterr().out
    with (out / "coverage.csv").open() as stream:
        states = {row["state"] for row in csv.DictReader(stream)}
    assert states == {"could be seen", "cannot be seen"}
    assert run(["reach", scenario, "--surfaces", "--against", scenario, "--out", str(out)]) == 2
