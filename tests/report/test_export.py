import csv
import json
import os
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageSequence

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.report import export
from tdcr_planner.report.export import export_picture, write_animation
from tdcr_planner.report.picture import gather_picture
from tdcr_planner.report.state_files import write_trajectory_csv
from tdcr_planner.report.viewpoint import choose_camera


@pytest.fixture
def result(make_result):
    return make_result("two_segment")


@pytest.fixture
def picture(result):
    return gather_picture(result)


def lowest_blue(frame):
    """Lowest row with pixels that are clearly blue, which only the robot is."""
    rgb = np.asarray(frame, dtype=float)
    rows = np.flatnonzero(((rgb[..., 2] > rgb[..., 0] + 40) & (rgb[..., 2] > rgb[..., 1] + 15)).any(axis=1))
    assert len(rows) > 50
    return rows[-1]


def read_mp4(file, width, height):
    """Frames of a video as ffmpeg decodes them, shape (n, height, width, 3)."""
    command = ["ffmpeg", "-v", "error", "-i", str(file), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    return np.frombuffer(raw, dtype=np.uint8).reshape(-1, height, width, 3)


def read_gif(file, width, height):
    with Image.open(file) as image:
        assert image.size == (width, height)
        frames = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]
    return np.stack(frames)


def needs_ffmpeg():
    if not shutil.which("ffmpeg"):
        if os.environ.get("TDCR_FFMPEG_REQUIRED"):
            pytest.fail("needs ffmpeg on the PATH")
        pytest.skip("needs ffmpeg on the PATH")


@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_animation_has_its_frames_and_the_robot_follows_the_path(picture, tmp_path, ending):
    if ending == "mp4":
        needs_ffmpeg()
    file = tmp_path / f"path.{ending}"
    picture = replace(picture, meshes=())  # no glass before the robot
    write_animation(picture, file, frames=4, seconds=1.0, width=480, height=360)
    frames = (read_mp4 if ending == "mp4" else read_gif)(file, 480, 360)
    assert frames.shape == (4, 360, 480, 3)
    # states 0, 4, 8 and 11 of the 12 are shown; the base, lowest in the picture, is pushed up by the insertion
    camera = choose_camera(picture, 480, 360)
    seen = [lowest_blue(frame) for frame in frames]
    base = [camera.project(picture.positions[state, 0])[1] for state in (0, 4, 8, 11)]
    assert base[0] - base[-1] > 60.0
    # a disk's rim is found to a pixel or two on each side
    np.testing.assert_allclose(np.diff(seen), np.diff(base), atol=3.0)


def test_a_second_of_film_lasts_a_second(picture, tmp_path):
    write_animation(picture, tmp_path / "path.gif", frames=5, seconds=1.0, width=160, height=120)
    with Image.open(tmp_path / "path.gif") as image:
        durations = [frame.info["duration"] for frame in ImageSequence.Iterator(image)]
    assert sum(durations) == pytest.approx(1000.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 321}, "width: expected an even number of pixels"),
        ({"height": 0}, "height: expected an even number"),
        ({"frames": 0}, "frames: expected 1 or more, got 0"),
        ({"seconds": 0.0}, "seconds: expected a duration"),
        ({"seconds": float("nan")}, "seconds: expected a duration"),
    ],
)
def test_animation_options_that_cannot_be_are_refused(picture, tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        write_animation(picture, tmp_path / "path.gif", **options)
    assert not (tmp_path / "path.gif").exists()


def test_an_animation_without_a_shape_is_refused(result, tmp_path):
    result.verification.positions[:] = np.nan
    with pytest.raises(InputError, match="a state whose shape is known"):
        export_picture(gather_picture(result), tmp_path / "path.gif")
    assert list(tmp_path.glob("path*")) == []


def test_mp4_without_ffmpeg_is_refused(result, picture, tmp_path, monkeypatch):
    monkeypatch.setattr(export.shutil, "which", lambda name: None)
    with pytest.raises(FormatError, match="ffmpeg"):
        export_picture(picture, tmp_path / "path.mp4", result)
    assert list(tmp_path.glob("*.mp4")) == []


def test_trajectory_json_is_a_joint_trajectory_and_repeats_the_csv(result, picture, tmp_path):
    export_picture(picture, tmp_path / "path.json", result)
    content = json.loads((tmp_path / "path.json").read_text(encoding="utf-8"))
    assert content["joint_names"] == [*(f"tendon_{i}" for i in range(1, 7)), "insertion", "roll"]
    assert len(content["points"]) == len(result.path)
    last = content["points"][-1]
    assert last["time_from_start"] == {"sec": 6, "nanosec": 0}
    np.testing.assert_array_equal(last["positions"][:6], result.path.tendon_displacements[-1])
    assert last["positions"][6:] == [result.path.insertion[-1], result.path.roll[-1]]
    np.testing.assert_array_equal(last["effort"][:6], result.path.tensions[-1])
    # trajectory_msgs/JointTrajectoryPoint: float64 arrays of one length; nothing there may be null
    for point in content["points"]:
        for key in ("positions", "effort"):
            assert len(point[key]) == len(content["joint_names"])
            assert all(isinstance(value, float) for value in point[key])
        assert all(isinstance(value, int) for value in point["time_from_start"].values())
    stamps = [
        point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in content["points"]
    ]
    np.testing.assert_allclose(stamps, result.path.times, atol=1e-9)
    write_trajectory_csv(result, tmp_path / "path.csv")
    with (tmp_path / "path.csv").open(newline="") as stream:
        header, *rows = list(csv.reader(stream))
    assert content["columns"] == header
    np.testing.assert_array_equal(np.array(content["rows"]), np.array(rows, dtype=float))


def test_csv_reads_back_to_the_last_digit(result, picture, tmp_path):
    export_picture(picture, tmp_path / "path.csv", result)
    table = np.genfromtxt(tmp_path / "path.csv", delimiter=",", names=True)
    path = result.path
    np.testing.assert_array_equal(table["time_s"], path.times)
    np.testing.assert_array_equal(table["insertion_m"], path.insertion)
    for tendon in range(6):
        np.testing.assert_array_equal(table[f"tension_{tendon + 1}_n"], path.tensions[:, tendon])
        np.testing.assert_array_equal(
            table[f"tendon_displacement_{tendon + 1}_m"], path.tendon_displacements[:, tendon]
        )
    tips = np.stack([table[f"tip_{axis}_m"] for axis in "xyz"], axis=1)
    np.testing.assert_array_equal(tips, path.tip_positions)
    bending = np.stack([table[f"bending_{segment}_{axis}_n"] for segment in (1, 2) for axis in "xy"], axis=1)
    np.testing.assert_array_equal(bending.reshape(-1, 2, 2), path.bending)


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
    assert (tmp_path / "path.glb").read_text(encoding="utf-8") == "earlier"


def test_result_without_a_path_exports_what_there_is(make_result, tmp_path):
    result = make_result(found=False)
    picture = gather_picture(result)
    for name in ("a.glb", "a.json", "a.npz"):
        export_picture(picture, tmp_path / name, result)
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))["points"] == []


def test_a_scenario_has_a_picture_and_no_trajectory(picture, tmp_path):
    export_picture(picture, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="no trajectory"):
        export_picture(picture, tmp_path / "a.json")
