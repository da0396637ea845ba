from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tdcr_planner.cli.main import run
from tdcr_planner.inspection.answer import Inspection
from tdcr_planner.inspection.causes import Unseen
from tdcr_planner.inspection.coverage import look_along
from tdcr_planner.inspection.inspect import inspect
from tdcr_planner.inspection.scene import make_visibility
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.session import PlanningSession, verify
from tdcr_planner.report.coverage_files import COLUMNS, INSPECTION_FILES
from tdcr_planner.report.results import read_result

Make = Callable[..., Scenario]
FACE = {"surfaces": [{"mesh": "plate.stl", "facing": [0.0, 0.0, -1.0]}]}


@pytest.fixture(scope="module")
def answer(write_inspection: Make, tmp_path_factory: pytest.TempPathFactory) -> Inspection:
    return inspect(PlanningSession(write_inspection(tmp_path_factory.mktemp("plate"), **FACE)))


def recomputed_share(result: Path) -> float:
    """Returns the share of the points that a result's shapes see, by numpy and trimesh alone, from its files."""
    shapes = np.load(result / "shapes.npz")
    tips, turns = shapes["positions_m"][:, -1], shapes["rotations"][:, -1]
    with (result / "coverage.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    points = np.array([[float(row[key]) for key in ("x_m", "y_m", "z_m")] for row in rows])
    normals = np.array([[float(row[f"normal_{axis}"]) for axis in "xyz"] for row in rows])
    areas = np.array([float(row["area_m2"]) for row in rows])
    folder = result.parent
    scene = trimesh.util.concatenate([trimesh.load(folder / name) for name in ("plate.stl", "post.stl")])
    seen = np.zeros(len(points), dtype=bool)
    for tip, turn in zip(tips, turns, strict=True):
        eye = tip + 0.001 * turn[:, 2]
        offset = points - eye
        distance = np.linalg.norm(offset, axis=1)
        sight = offset / distance[:, None]
        open_ = np.flatnonzero(
            (sight @ turn[:, 2] >= np.cos(np.radians(45.0)))
            & (distance >= 0.005)
            & (distance <= 0.15)
            & (-(sight * normals).sum(axis=1) >= np.cos(np.radians(75.0)))
            & ~seen
        )
        if not len(open_):
            continue
        origins = np.tile(eye, (len(open_), 1))
        places, rays, _ = scene.ray.intersects_location(origins, sight[open_], multiple_hits=False)
        first = np.full(len(open_), np.inf)
        first[rays] = np.linalg.norm(places - eye, axis=1)
        seen[open_[first >= distance[open_] - 2e-5]] = True
    return float(areas[seen].sum() / areas.sum())


def test_the_path_is_verified_and_sees_what_was_asked_for(answer: Inspection) -> None:
    coverage = answer.coverage
    assert answer.done
    assert answer.plan.status is PlanStatus.VERIFIED
    assert coverage.of_what_can_be_seen >= coverage.of_visible
    assert 0.2 < coverage.of_all <= coverage.visible < 1.0
    assert verify(answer.plan).verified


def test_what_is_stated_as_seen_is_seen_from_the_shapes_of_the_path(answer: Inspection) -> None:
    report = answer.plan.verification
    assert report is not None
    engine = make_visibility(PlanningSession(answer.plan.scenario))
    again = look_along(engine, report.positions, report.rotations)
    np.testing.assert_array_equal(again.first, answer.coverage.sight.first)
    one_by_one = engine.seen(report.positions, report.rotations)
    np.testing.assert_array_equal(one_by_one.any(axis=0), answer.coverage.sight.seen)
    np.testing.assert_array_equal(one_by_one.sum(axis=0), answer.coverage.sight.looks)
    seen = answer.coverage.sight.seen
    assert (one_by_one[answer.coverage.sight.first[seen], np.flatnonzero(seen)]).all()


def test_coverage_never_falls_while_the_search_goes_on(answer: Inspection) -> None:
    trace = np.array(answer.coverage.trace)
    assert len(trace) > 1
    assert (np.diff(trace[:, 1]) >= -1e-12).all()
    assert (np.diff(trace[:, 3]) >= -1e-12).all()
    same = np.diff(trace[:, 1]) <= 1e-12
    assert (np.diff(trace[:, 2])[same] < 0.0).all()


def test_every_point_is_seen_or_could_be_or_has_a_cause(answer: Inspection) -> None:
    coverage = answer.coverage
    for can, cause in zip(coverage.can_be_seen, coverage.causes, strict=True):
        assert can == (cause is None)
    assert set(coverage.cause_shares) <= {cause.value for cause in Unseen}
    lost = 1.0 - coverage.visible
    assert sum(coverage.cause_shares.values()) == pytest.approx(lost)


def test_the_files_say_the_same_and_are_read_again(make_inspection: Make, tmp_path: Path) -> None:
    scenario = make_inspection(**FACE)
    out = tmp_path / "out"
    assert run(["inspect", str(scenario.path), "--out", str(out), "--no-progress"]) == 0
    assert sorted(item.name for item in out.iterdir()) == sorted(INSPECTION_FILES)
    content = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert content["status"] == "verified"
    with (out / "coverage.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == content["coverage"]["points"]
    area = sum(float(row["area_m2"]) for row in rows if row["state"] == "seen")
    assert area / content["coverage"]["area_m2"] == pytest.approx(content["coverage"]["of_all"], abs=1e-6)
    for row in rows:
        assert (row["state"] == "seen") == (row["first_seen_s"] != "") == (row["best_distance_m"] != "")
        assert (row["state"] == "cannot be seen") == (row["cause"] != "")
    # Another program agrees with what is stated to half a percent.
    assert recomputed_share(out) == pytest.approx(content["coverage"]["of_all"], rel=0.005)
    assert verify(read_result(out)).verified
    painted = trimesh.load(out / "coverage.ply")
    assert len(np.unique(painted.visual.vertex_colors, axis=0)) == 4


def test_more_coverage_than_can_be_seen_is_told(
    make_inspection: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tdcr_planner.report.coverage_results.draw_inspection", lambda *_: [])
    scenario = make_inspection(coverage=0.95, time_limit_s=1.0)
    assert run(["inspect", str(scenario.path), "--out", str(tmp_path / "out"), "--no-progress"]) == 1
    text = capsys.readouterr().out
    assert "95.0 % were asked for" in text
    assert "cannot be seen" in text


def test_the_path_comes_back_when_it_is_asked_to(make_inspection: Make) -> None:
    found = inspect(PlanningSession(make_inspection(**FACE, back=True)))
    path = found.plan.path
    assert path is not None
    np.testing.assert_allclose(path.bending[-1], path.bending[0], atol=1e-12)
    assert path.insertion[-1] == pytest.approx(path.insertion[0])


def test_a_start_in_collision_is_a_status(make_inspection: Make) -> None:
    scenario = make_inspection(**FACE)
    text = scenario.path.read_text(encoding="utf-8").replace(
        "bending_n = [[0.0, 0.0]]", "bending_n = [[0.0, 0.0]]\ninsertion_m = 0.05"
    )
    scenario.path.write_text(
        text.replace("insertion_m = [0.0, 0.05]", "insertion_m = [0.0, 0.2]").replace("= 0.05\n", "= 0.12\n")
    )
    found = inspect(PlanningSession(load_scenario(scenario.path)))
    assert found.plan.status is PlanStatus.INVALID_START
    assert not found.done
    assert found.coverage.of_all == 0.0


def test_a_scenario_that_asks_for_nothing_is_refused(
    make_scenario: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["inspect", str(make_scenario().path), "--out", str(tmp_path / "out")]) == 2
    assert "[inspect]" in capsys.readouterr().err


def test_a_scenario_without_goals_cannot_be_planned(
    make_inspection: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plan", str(make_inspection().path), "--out", str(tmp_path / "out")]) == 2
    assert "goal" in capsys.readouterr().err
