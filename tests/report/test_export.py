import csv
import json

import numpy as np
import pytest
import trimesh
from PIL import Image

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.report import export
from tdcr_planner.report.export import export_picture, write_animation
from tdcr_planner.report.picture import gather_picture
from tdcr_planner.report.state_files import write_trajectory_csv


@pytest.fixture
def result(make_result):
    return make_result("two_segment")


@pytest.fixture
def picture(result):
    return gather_picture(result)


def test_glb_holds_scene_robot_and_trace_in_metres(result, picture, tmp_path):
    export_picture(picture, tmp_path / "path.glb", result)
    scene = trimesh.load(tmp_path / "path.glb")
    names = set(scene.geometry)
    assert {"1 pipe.stl", "2 ball.stl", "start: disks", "end: disks", "end: backbone", "tip trace", "goal 1"} <= names
    disks = scene.geometry["end: disks"]
    # glTF stores single precision
    centres = [part.centroid for part in disks.split(only_watertight=False)]
    assert len(centres) == 21
    tip = min(centres, key=lambda centre: np.linalg.norm(centre - result.path.tip_positions[-1]))
    np.testing.assert_allclose(tip, result.path.tip_positions[-1], atol=1e-6)
    assert scene.geometry["1 pipe.stl"].visual.material.alphaMode == "BLEND"


def test_gif_has_a_frame_a_state_and_moves(picture, tmp_path):
    write_animation(picture, tmp_path / "path.gif", frames=4, seconds=1.0, width=320, height=240)
    with Image.open(tmp_path / "path.gif") as image:
        assert image.n_frames == 4
        assert image.size == (320, 240)
        first = np.asarray(image.convert("RGB"), dtype=float)
        image.seek(3)
        last = np.asarray(image.convert("RGB"), dtype=float)
    assert first.std() > 5.0
    assert np.abs(first - last).max(axis=2).mean() > 1.0


def test_mp4_without_ffmpeg_is_refused(result, picture, tmp_path, monkeypatch):
    monkeypatch.setattr(export.shutil, "which", lambda name: None)
    with pytest.raises(FormatError, match="ffmpeg"):
        export_picture(picture, tmp_path / "path.mp4", result)
    assert list(tmp_path.glob("*.mp4")) == []


def test_trajectory_json_is_a_joint_trajectory_and_repeats_the_csv(result, picture, tmp_path):
    export_picture(picture, tmp_path / "path.json", result)
    content = json.loads((tmp_path / "path.json").read_text())
    assert content["joint_names"] == [*(f"tendon_{i}" for i in range(1, 7)), "insertion", "roll"]
    assert len(content["points"]) == len(result.path)
    last = content["points"][-1]
    assert last["time_from_start"] == {"sec": 6, "nanosec": 0}
    np.testing.assert_array_equal(last["positions"][:6], result.path.tendon_displacements[-1])
    assert last["positions"][6:] == [result.path.insertion[-1], result.path.roll[-1]]
    np.testing.assert_array_equal(last["effort"][:6], result.path.tensions[-1])
    stamps = [
        point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in content["points"]
    ]
    np.testing.assert_allclose(stamps, result.path.times, atol=1e-9)
    write_trajectory_csv(result, tmp_path / "path.csv")
    with (tmp_path / "path.csv").open(newline="") as stream:
        header, *rows = list(csv.reader(stream))
    assert content["columns"] == header
    np.testing.assert_array_equal(np.array(content["rows"]), np.array(rows, dtype=float))


def test_npz_holds_all_shapes(result, picture, tmp_path):
    export_picture(picture, tmp_path / "shapes.npz", result)
    with np.load(tmp_path / "shapes.npz") as archive:
        np.testing.assert_array_equal(archive["positions_m"], result.verification.positions)
        np.testing.assert_array_equal(archive["arc_lengths_m"], result.scenario.robot.arc_lengths)


def test_another_ending_is_refused(result, picture, tmp_path):
    with pytest.raises(InputError, match=r"\.glb"):
        export_picture(picture, tmp_path / "path.docx", result)


def test_a_failure_leaves_the_earlier_file(result, picture, tmp_path, monkeypatch):
    (tmp_path / "path.glb").write_text("earlier")

    def fail(picture, path):
        path.write_text("half")
        raise KeyboardInterrupt

    monkeypatch.setattr(export, "write_glb", fail)
    with pytest.raises(KeyboardInterrupt):
        export_picture(picture, tmp_path / "path.glb", result)
    assert (tmp_path / "path.glb").read_text() == "earlier"


def test_result_without_a_path_exports_what_there_is(make_result, tmp_path):
    result = make_result(found=False)
    picture = gather_picture(result)
    for name in ("a.glb", "a.json", "a.npz"):
        export_picture(picture, tmp_path / name, result)
    assert json.loads((tmp_path / "a.json").read_text())["points"] == []


def test_a_scenario_has_a_picture_and_no_trajectory(picture, tmp_path):
    export_picture(picture, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="no trajectory"):
        export_picture(picture, tmp_path / "a.json")
