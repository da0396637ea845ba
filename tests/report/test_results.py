import csv
import json
import logging

import numpy as np
import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.files import sha256_of_file
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.report import scene_html, scene_png, state_files
from tdcr_planner.report.results import RESULT_FILES, read_result, write_result


def _rewrite(file, change):
    content = json.loads(file.read_text(encoding="utf-8"))
    change(content)
    file.write_text(json.dumps(content))


@pytest.fixture
def quick_pictures(monkeypatch):
    """Pictures have their own tests; here they are one byte each."""
    monkeypatch.setattr("tdcr_planner.report.scene_png.write_png", lambda picture, file: file.write_bytes(b"p"))
    monkeypatch.setattr("tdcr_planner.report.scene_html.write_html", lambda picture, file: file.write_bytes(b"h"))


@pytest.fixture
def written(make_result, tmp_path, quick_pictures):
    """A result and the result.json that it was written to."""
    result = make_result()
    return result, write_result(result, tmp_path / "out")


def test_all_files_are_written_with_real_pictures(make_result, tmp_path):
    file = write_result(make_result(), tmp_path / "new" / "out")
    assert sorted(item.name for item in file.parent.iterdir()) == sorted(RESULT_FILES)
    assert (file.parent / "path.png").read_bytes().startswith(b"\x89PNG")
    assert "</html>" in (file.parent / "path.html").read_text(encoding="utf-8")[-20:]


@pytest.mark.parametrize("robot", ["paper", "two_segment"])
def test_round_trip_keeps_every_value(make_result, tmp_path, quick_pictures, robot):
    result = make_result(robot)
    again = read_result(write_result(result, tmp_path / "out"))
    for name in ("bending", "insertion", "tensions", "tendon_displacements", "tip_positions", "times"):
        np.testing.assert_array_equal(getattr(again.path, name), getattr(result.path, name))
    # degrees in the file: one rounding there and one back
    np.testing.assert_allclose(again.path.roll, result.path.roll, rtol=4 * np.finfo(float).eps)
    report, expected = again.verification, result.verification
    for name in ("converged", "residual", "deviation", "clearance", "in_limits", "positions", "rotations"):
        np.testing.assert_array_equal(getattr(report, name), getattr(expected, name))
    np.testing.assert_array_equal(report.model_positions, expected.model_positions)
    assert (report.verified, report.message, report.cause, report.worst_state) == (True, "", "", 5)
    for name in ("status", "message", "seed", "repairs", "timings_s", "planner", "versions"):
        assert getattr(again, name) == getattr(result, name), name
    assert again.scenario == result.scenario


def test_round_trip_keeps_changed_planner_settings(make_result, tmp_path, quick_pictures):
    result = make_result(found=False)
    changed = result.scenario.with_planner(name="RRT", time_limit_s=3.5, validity="reference")
    from dataclasses import replace

    again = read_result(write_result(replace(result, scenario=changed), tmp_path / "out"))
    assert again.scenario.planner == changed.planner


def test_result_without_a_path(make_result, tmp_path, quick_pictures):
    file = write_result(make_result(found=False), tmp_path / "out")
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["path"] is None
    assert content["verification"] is None
    again = read_result(file)
    assert again.status is PlanStatus.NO_PATH
    assert again.path is None
    assert again.verification is None
    assert len((file.parent / "trajectory.csv").read_text(encoding="utf-8").splitlines()) == 1


def test_keys_of_the_contract(written):
    _, file = written
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["format"] == "tdcr-result/1"
    assert content["status"] == "verified"
    assert content["scenario"] == "../scene/scenario_pipe.toml"
    assert content["scenario_sha256"] == sha256_of_file(file.parent / content["scenario"])
    assert set(content["timings_s"]) == {"load", "plan", "verify", "total"}
    assert {"bending_n", "insertion_m", "roll_deg", "tensions_n", "tendon_displacement_m", "tip_position_m"} <= set(
        content["path"]
    )
    assert {"verified", "states", "worst", "repairs"} <= set(content["verification"])
    assert set(content["verification"]["worst"]) == {"residual_nm", "deviation_m", "clearance_m"}
    assert np.shape(content["path"]["bending_n"]) == (12, 1, 2)
    assert content["path"]["roll_deg"][-1] == pytest.approx(np.rad2deg(0.5))


def test_json_holds_null_and_never_nan(written):
    result, file = written
    text = file.read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))
    assert content["verification"]["deviation_m"][3] is None
    assert content["verification"]["worst"]["deviation_m"] == 0.001
    assert np.isnan(result.verification.deviation[3])


def test_csv_has_units_and_the_values(make_result, tmp_path, quick_pictures):
    result = make_result("two_segment")
    file = write_result(result, tmp_path / "out").with_name("trajectory.csv")
    with file.open(newline="") as stream:
        header, *rows = list(csv.reader(stream))
    assert header[:3] == ["time_s", "insertion_m", "roll_deg"]
    assert all(name.endswith(("_s", "_m", "_deg", "_n")) for name in header)
    assert [name for name in header if name.startswith("tension_")] == [f"tension_{i}_n" for i in range(1, 7)]
    assert sum(name.startswith("tendon_displacement_") for name in header) == 6
    table = np.array(rows, dtype=float)
    columns = [header.index(f"tension_{i}_n") for i in range(1, 7)]
    np.testing.assert_array_equal(table[:, columns], result.path.tensions)
    np.testing.assert_array_equal(table[:, 0], result.path.times)


def test_a_failing_picture_costs_neither_the_result_nor_the_other_picture(written, make_result, monkeypatch, caplog):
    _, file = written

    def fail(picture, target):
        target.write_text("half")
        raise ValueError("no such colour")

    monkeypatch.setattr(scene_png, "write_png", fail)
    write_result(make_result(found=False), file.parent)
    assert read_result(file).status is PlanStatus.NO_PATH
    # the earlier result's picture does not stay beside this one
    assert sorted(item.name for item in file.parent.iterdir()) == sorted({*RESULT_FILES} - {"path.png"})
    assert [record.getMessage() for record in caplog.records] == [
        f"{file.parent / 'path.png'} is not drawn: ValueError: no such colour"
    ]


def test_an_interrupted_drawing_leaves_the_result(written, make_result, monkeypatch):
    _, file = written

    def stop(picture, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(scene_html, "write_html", stop)
    with pytest.raises(KeyboardInterrupt):
        write_result(make_result(found=False), file.parent)
    assert read_result(file).status is PlanStatus.NO_PATH
    assert sorted(item.name for item in file.parent.iterdir()) == sorted({*RESULT_FILES} - {"path.html"})


def test_a_result_that_cannot_be_written_draws_nothing(written, make_result, monkeypatch):
    _, file = written
    before = {item.name: item.read_bytes() for item in file.parent.iterdir()}

    def stop(result, target):
        raise KeyboardInterrupt

    monkeypatch.setattr("tdcr_planner.report.results.write_shapes", stop)
    with pytest.raises(KeyboardInterrupt):
        write_result(make_result(found=False), file.parent)
    assert {item.name: item.read_bytes() for item in file.parent.iterdir()} == before


def test_the_same_result_gives_the_same_bytes(written, tmp_path):
    result, file = written
    other = write_result(result, tmp_path / "other").parent
    for name in ("result.json", "shapes.npz", "trajectory.csv"):
        assert (other / name).read_bytes() == (file.parent / name).read_bytes()


def test_a_folder_that_is_a_file_is_refused(make_result, tmp_path, quick_pictures):
    (tmp_path / "out").write_text("")
    with pytest.raises(FormatError, match="cannot be written"):
        write_result(make_result(found=False), tmp_path / "out")


def test_reading_a_folder_reads_its_result(written):
    result, file = written
    assert read_result(file.parent).message == result.message


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("status", lambda content: content.pop("status")),
        ("path.tensions_n", lambda content: content["path"].pop("tensions_n")),
        ("verification.worst.clearance_m", lambda content: content["verification"]["worst"].pop("clearance_m")),
        ("shapes_sha256", lambda content: content.pop("shapes_sha256")),
        ("format", lambda content: content.pop("format")),
        ("format", lambda content: content.update(format="tdcr-result/0")),
        ("status", lambda content: content.update(status="fine")),
        ("path.tip_position_m", lambda content: content["path"]["tip_position_m"].pop()),
        ("path.bending_n", lambda content: content["path"]["bending_n"][0].append([0.0, 0.0])),
        ("verification.clearance_m", lambda content: content["verification"]["clearance_m"].pop()),
        ("path", lambda content: content.update(path=None)),
        ("colour", lambda content: content.update(colour="red")),
    ],
)
def test_a_wrong_key_is_named(written, key, change):
    _, file = written
    _rewrite(file, change)
    with pytest.raises(FormatError) as caught:
        read_result(file)
    assert caught.value.place == key


def test_an_older_format_says_what_to_do(written):
    _, file = written
    _rewrite(file, lambda content: content.update(format="tdcr-result/0"))
    with pytest.raises(FormatError, match="plan again"):
        read_result(file)


@pytest.mark.parametrize("part", [0, 1, 100, 2000])
def test_a_truncated_file_is_refused(written, part):
    _, file = written
    file.write_bytes(file.read_bytes()[:part])
    with pytest.raises(FormatError, match="not valid JSON"):
        read_result(file)


def test_a_changed_scenario_is_refused(written):
    result, file = written
    scenario = result.scenario.path
    scenario.write_text(scenario.read_text(encoding="utf-8").replace("0.15]", "0.16]"))
    with pytest.raises(FormatError, match="has changed since") as caught:
        read_result(file)
    assert caught.value.place == "scenario_sha256"


@pytest.mark.parametrize(("name", "place"), [("ball.stl", "meshes[2].file"), ("robot.toml", "robot")])
def test_a_changed_input_of_the_scenario_is_refused(written, name, place):
    result, file = written
    changed = result.scenario.path.with_name(name)
    changed.write_bytes(changed.read_bytes() + b"\n")
    with pytest.raises(FormatError, match="has changed since") as caught:
        read_result(file)
    assert caught.value.place == f"inputs_sha256.{place}"


def test_a_missing_scenario_is_named(written):
    result, file = written
    result.scenario.path.unlink()
    with pytest.raises(FormatError, match="scenario_pipe.toml"):
        read_result(file)


def test_a_result_that_moved_finds_its_scenario_by_the_absolute_path(written, tmp_path):
    _, file = written
    moved = tmp_path / "far" / "away" / "out"
    moved.parent.mkdir(parents=True)
    file.parent.rename(moved)
    assert read_result(moved).status is PlanStatus.VERIFIED


def test_result_and_scene_that_moved_together_find_each_other(written, tmp_path):
    _, file = written
    there = tmp_path / "there"
    there.mkdir()
    (tmp_path / "scene").rename(there / "scene")
    file.parent.rename(there / "out")
    assert read_result(there / "out").scenario.path == (there / "scene" / "scenario_pipe.toml").resolve()


def test_missing_shapes_are_nan_with_a_warning(written, caplog):
    result, file = written
    file.with_name("shapes.npz").unlink()
    with caplog.at_level(logging.WARNING, logger=state_files.__name__):
        again = read_result(file)
    assert "shapes.npz" in caplog.text
    assert np.isnan(again.verification.positions).all()
    assert again.verification.positions.shape == result.verification.positions.shape
    np.testing.assert_array_equal(again.path.tensions, result.path.tensions)


def test_shapes_of_another_result_are_refused(written, make_result, tmp_path):
    _, file = written
    other = write_result(make_result(found=False), tmp_path / "other")
    file.with_name("shapes.npz").write_bytes(other.with_name("shapes.npz").read_bytes())
    with pytest.raises(FormatError, match="another result"):
        read_result(file)
