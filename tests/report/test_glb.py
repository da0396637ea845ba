import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation, Slerp

from tdcr_planner.report.glb import MAX_KEYFRAMES, write_glb
from tdcr_planner.report.picture import gather_picture, gather_scenario_picture


def read_glb(file):
    """The JSON and the binary chunk of a file, by the sizes that its header states."""
    content = file.read_bytes()
    magic, version, total = struct.unpack_from("<4sII", content)
    assert (magic, version, total) == (b"glTF", 2, len(content))
    length, kind = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON"
    assert length % 4 == 0
    size, kind = struct.unpack_from("<I4s", content, 20 + length)
    assert kind == b"BIN\0"
    assert 28 + length + size == total
    return json.loads(content[20 : 20 + length]), content[28 + length :]


def values(tree, binary, accessor):
    entry = tree["accessors"][accessor]
    view = tree["bufferViews"][entry["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[entry["type"]]
    assert entry["componentType"] == 5126
    assert view["byteLength"] == 4 * width * entry["count"]
    array = np.frombuffer(binary, dtype="<f4", count=width * entry["count"], offset=view["byteOffset"])
    return array.reshape(entry["count"], width).astype(float)


def channels(tree, binary):
    """Times, shape (k,), and values, shape (k, n), of each node's moves, by node name and kind."""
    (animation,) = tree["animations"]
    found = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        target = channel["target"]
        name = tree["nodes"][target["node"]]["name"]
        clock = values(tree, binary, sampler["input"])[:, 0]
        found[name, target["path"]] = clock, values(tree, binary, sampler["output"])
    return found


@pytest.fixture
def picture(make_result):
    return gather_picture(make_result("two_segment"))


@pytest.fixture
def written(picture, tmp_path):
    write_glb(picture, tmp_path / "path.glb")
    return tmp_path / "path.glb"


def test_scene_stands_in_metres_with_the_robot_in_its_first_state(picture, written):
    scene = trimesh.load(written)
    assert {"1 pipe.stl", "2 ball.stl", "tip trace", "goal 1", "disk 0", "disk 20", "backbone"} <= set(scene.geometry)
    assert scene.geometry["1 pipe.stl"].visual.material.alphaMode == "BLEND"
    for disk in (0, 9, 20):
        pose, _ = scene.graph[f"disk {disk}"]
        # glTF stores single precision
        np.testing.assert_allclose(pose[:3, 3], picture.positions[0, disk], atol=1e-7)
        np.testing.assert_allclose(pose[:3, :3], picture.rotations[0, disk], atol=1e-6)
    radius = np.linalg.norm(scene.geometry["disk 20"].vertices[:, :2], axis=1).max()
    assert radius == pytest.approx(picture.robot.disk_radii[20], rel=1e-6)


def test_disks_move_along_the_path_in_its_time(picture, written):
    moves = channels(*read_glb(written))
    for disk in range(picture.robot.disk_count):
        clock, places = moves[f"disk {disk}", "translation"]
        np.testing.assert_allclose(clock, picture.times, atol=1e-6)
        np.testing.assert_allclose(places, picture.positions[:, disk], atol=1e-7)
        _, turns = moves[f"disk {disk}", "rotation"]
        np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-6)
        np.testing.assert_allclose(Rotation.from_quat(turns).as_matrix(), picture.rotations[:, disk], atol=1e-6)
        assert (np.einsum("ki,ki->k", turns[1:], turns[:-1]) > 0.0).all()  # the short way between keyframes


@pytest.mark.parametrize("name", ["backbone", "tendon 1", "tendon 6"])
def test_pieces_of_backbone_and_tendons_join_and_end_at_the_last_disk(picture, written, name):
    tree, binary = read_glb(written)
    moves = channels(tree, binary)
    nodes = {node["name"]: node for node in tree["nodes"]}
    count = sum(node.startswith(f"{name}, piece ") for node in nodes)

    def track(piece, kind):
        node = f"{name}, piece {piece + 1}"
        still = np.tile(nodes[node][kind], (len(picture.times), 1))  # what does not move has no channel
        return moves[node, kind][1] if (node, kind) in moves else still

    ends = None
    for piece in range(count):
        start, scale = track(piece, "translation"), track(piece, "scale")
        if ends is not None:
            np.testing.assert_allclose(start, ends, atol=1e-6)
        along = Rotation.from_quat(track(piece, "rotation")).apply([0.0, 0.0, 1.0])
        ends = start + along * scale[:, 2:]
    reach = 0.0 if name == "backbone" else picture.robot.segments[0 if name == "tendon 1" else 1].tendon_circle_radius_m
    apart = np.linalg.norm(ends - picture.positions[:, -1 if name != "tendon 1" else 10], axis=1)
    np.testing.assert_allclose(apart, reach, atol=1e-6)


def test_nothing_animated_has_a_matrix_and_times_state_their_range(written):
    tree, _ = read_glb(written)
    (animation,) = tree["animations"]
    for channel in animation["channels"]:
        assert "matrix" not in tree["nodes"][channel["target"]["node"]]
    for sampler in animation["samplers"]:
        clock = tree["accessors"][sampler["input"]]
        assert (clock["min"], clock["max"]) == ([0.0], [6.0])
    ends = [view["byteOffset"] + view["byteLength"] for view in tree["bufferViews"]]
    assert max(ends) <= tree["buffers"][0]["byteLength"]


def test_long_paths_are_thinned_and_stay_near_the_path_between_keyframes(make_result, tmp_path):
    short = gather_picture(make_result("two_segment"))
    count = 600
    along = np.linspace(0.0, 6.0, count)
    # a finer path through the same states
    positions = np.array(
        [[np.interp(along, short.times, column) for column in disk] for disk in short.positions.transpose(1, 2, 0)]
    )
    rotations = np.stack(
        [Slerp(short.times, Rotation.from_matrix(short.rotations[:, d]))(along).as_matrix() for d in range(21)], axis=1
    )
    long = replace(
        short,
        times=along,
        positions=positions.transpose(2, 0, 1),
        rotations=rotations,
        clearance=np.interp(along, short.times, short.clearance),
    )
    write_glb(long, tmp_path / "path.glb")
    clock, places = channels(*read_glb(tmp_path / "path.glb"))["disk 20", "translation"]
    assert len(clock) <= MAX_KEYFRAMES
    assert (np.diff(clock) > 0.0).all()
    between = np.stack([np.interp(along, clock, column) for column in places.T], axis=1)
    # half a keyframe's travel would be 1 mm; corners of the path are what is cut
    assert np.linalg.norm(between - long.positions[:, -1], axis=1).max() < 2e-4


def test_a_scenario_stands_still(make_scenario, tmp_path):
    picture = gather_scenario_picture(make_scenario("paper"))
    write_glb(picture, tmp_path / "scene.glb")
    tree, _ = read_glb(tmp_path / "scene.glb")
    assert "animations" not in tree
    pose, _ = trimesh.load(tmp_path / "scene.glb").graph["disk 20"]
    np.testing.assert_allclose(pose[:3, 3], picture.positions[0, -1], atol=1e-7)


def test_without_a_shape_the_scene_is_written_alone(make_result, tmp_path):
    result = make_result()
    result.verification.positions[:] = np.nan
    write_glb(gather_picture(result), tmp_path / "path.glb")
    names = set(trimesh.load(tmp_path / "path.glb").geometry)
    assert "1 pipe.stl" in names
    assert not any(name.startswith("disk") for name in names)
