"""glTF files: modes, component types, sparse and quantised vertices, placed nodes, and all that is refused by name."""

from __future__ import annotations

import base64
import copy
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.collision.mesh_files.registry import mesh_sha256, read_mesh_file
from tdcr_planner.errors import FormatError
from tdcr_planner.se3 import rotation_from_quaternion


@pytest.fixture
def read(writers, tmp_path):
    def inner(document, data, kind="glb"):
        path = tmp_path / f"mesh.{kind}"
        if kind == "glb":
            path.write_bytes(writers.glb(document, data))
        else:
            path.write_text(document if isinstance(document, str) else json.dumps(document))
        return read_mesh_file(path)

    return inner


def _corners(raw):
    return raw.vertices[raw.faces]


@pytest.mark.parametrize("component", [(5121, "u1"), (5123, "<u2"), (5125, "<u4"), None])
@pytest.mark.parametrize("mode", [4, 5, 6])
def test_every_mode_of_triangles_and_type_of_indices(writers, read, box, mode, component):
    points = np.random.default_rng(mode).random((9, 3)).astype("<f4").astype(np.float64)
    order = np.arange(9) if component is None else np.random.default_rng(1).permutation(9)
    document, _ = writers.gltf(points, np.arange(9).reshape(3, 3))
    indices = order.astype("<u4" if component is None else component[1])
    data = points.astype("<f4").tobytes() + indices.tobytes()
    primitive = document["meshes"][0]["primitives"][0]
    primitive["mode"] = mode
    document["bufferViews"][1]["byteLength"] = indices.nbytes
    document["buffers"][0]["byteLength"] = len(data)
    if component is None:
        del primitive["indices"]
    else:
        document["accessors"][1] |= {"componentType": component[0], "count": 9}
    o = order.tolist()
    expected = {
        4: [o[0:3], o[3:6], o[6:9]],
        5: [[o[k], o[k + 1 + k % 2], o[k + 2 - k % 2]] for k in range(7)],  # glTF 2.0, 3.7.2.1
        6: [[o[k + 1], o[k + 2], o[0]] for k in range(7)],
    }[mode]
    found = _corners(read(document, data))
    np.testing.assert_array_equal(found.sum(axis=1), points[expected].sum(axis=1))
    np.testing.assert_allclose(  # turned alike
        np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]),
        np.cross(points[expected][:, 1] - points[expected][:, 0], points[expected][:, 2] - points[expected][:, 0]),
        atol=1e-15,
    )


@pytest.mark.parametrize(
    ("component", "kind", "most"), [(5120, "i1", 127), (5121, "u1", 255), (5122, "<i2", 32767), (5123, "<u2", 65535)]
)
@pytest.mark.parametrize("normalized", [True, False])
def test_quantised_vertices_are_decoded(writers, read, component, kind, most, normalized):
    info = np.iinfo(kind)
    stored = np.random.default_rng(component).integers(info.min, info.max, (6, 3), endpoint=True).astype(kind)
    document, _ = writers.gltf(stored.astype(float), np.arange(6).reshape(2, 3))
    rows = np.zeros((6, 8 if stored.itemsize == 2 else 4), dtype="u1")
    rows[:, : 3 * stored.itemsize] = stored.view("u1").reshape(6, -1)
    indices = np.arange(6, dtype="<u4").tobytes()
    document["accessors"][0] |= {"componentType": component, "normalized": normalized}
    document["extensionsRequired"] = document["extensionsUsed"] = ["KHR_mesh_quantization"]
    document["bufferViews"] = [
        {"buffer": 0, "byteLength": rows.nbytes, "byteStride": rows.shape[1]},
        {"buffer": 0, "byteOffset": rows.nbytes, "byteLength": len(indices)},
    ]
    document["buffers"][0]["byteLength"] = rows.nbytes + len(indices)
    expected = np.maximum(stored / most, -1.0) if normalized else stored
    np.testing.assert_array_equal(read(document, rows.tobytes() + indices).vertices, expected)


@pytest.mark.parametrize("based", [True, False])
def test_sparse_vertices_are_put_in_their_places(writers, read, box, based):
    points, faces = box
    document, data = writers.gltf(points, faces)
    moved = np.array([[5.0, 5.0, 5.0], [6.0, 6.0, 6.0]])
    indices, values = np.array([1, 6], dtype="<u2"), moved.astype("<f4")
    offset = len(data)
    data += indices.tobytes() + values.tobytes()
    document["bufferViews"] += [
        {"buffer": 0, "byteOffset": offset, "byteLength": 4},
        {"buffer": 0, "byteOffset": offset + 4, "byteLength": values.nbytes},
    ]
    document["buffers"][0]["byteLength"] = len(data)
    expected = points.copy() if based else np.zeros_like(points)
    expected[[1, 6]] = moved
    accessor = document["accessors"][0]
    accessor["sparse"] = {
        "count": 2,
        "indices": {"bufferView": 2, "componentType": 5123},
        "values": {"bufferView": 3},
    }
    accessor |= {"min": expected.min(axis=0).tolist(), "max": expected.max(axis=0).tolist()}
    if not based:
        del accessor["bufferView"]
    np.testing.assert_array_equal(read(document, data).vertices, expected)
    accessor["sparse"]["indices"]["componentType"] = 5121  # then the indices are 1 and 0
    with pytest.raises(FormatError, match=r"accessors\[0\]: expected sparse indices that rise"):
        read(document, data)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), mirrored=st.booleans())
def test_nodes_place_meshes_by_matrix_or_parts_and_a_mirror_turns_faces(writers, tmp_path_factory, box, seed, mirrored):
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=4)
    quaternion /= np.linalg.norm(quaternion)
    scale = rng.uniform(0.5, 2.0, 3) * np.array([-1.0 if mirrored else 1.0, 1.0, 1.0])
    inner, outer = np.eye(4), np.eye(4)
    inner[:3, :3] = rotation_from_quaternion(quaternion) * scale
    inner[:3, 3] = rng.normal(size=3)
    outer[:3] = rng.normal(size=(3, 4))
    document, data = writers.gltf(*box)
    document["nodes"] = [
        {"matrix": outer.T.ravel().tolist(), "children": [1, 2]},
        {
            "mesh": 0,
            "rotation": [*quaternion[1:].tolist(), quaternion[0]],
            "scale": scale.tolist(),
            "translation": inner[:3, 3].tolist(),
        },
        {"mesh": 0},
    ]
    path = tmp_path_factory.mktemp("gltf") / "mesh.glb"
    path.write_bytes(writers.glb(document, data))
    found = _corners(read_mesh_file(path))
    for k, matrix in enumerate((outer @ inner, outer)):
        expected = box[0] @ matrix[:3, :3].T + matrix[:3, 3]
        corners = found[12 * k : 12 * (k + 1)]
        np.testing.assert_allclose(corners.sum(axis=1), expected[box[1]].sum(axis=1), atol=1e-9)
        volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
        own = box[0][box[1]]
        of_box = np.einsum("fi,fi->f", own[:, 0], np.cross(own[:, 1], own[:, 2])).sum() / 6.0
        # Only the size of the volume changes with the placement, never its sign.
        assert volume == pytest.approx(of_box * abs(np.linalg.det(matrix[:3, :3])), abs=1e-9)


def _change(document, where, value):
    changed = copy.deepcopy(document)
    target = changed
    *path, last = where
    for key in path:
        target = target[key]
    target[last] = value
    return changed


PRIMITIVE = ("meshes", 0, "primitives", 0)


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (("extensionsRequired",), ["KHR_draco_mesh_compression"], "extensionsRequired: needs KHR_draco"),
        (("extensionsRequired",), ["EXT_meshopt_compression"], "needs EXT_meshopt_compression"),
        (("nodes", 0, "extensions"), {"EXT_mesh_gpu_instancing": {}}, r"nodes\[0\]: uses EXT_mesh_gpu_instancing"),
        (("nodes", 0, "extensions"), {"KHR_node_visibility": {}}, "uses KHR_node_visibility"),
        (("bufferViews", 0, "extensions"), {"EXT_meshopt_compression": {}}, r"bufferViews\[0\]: needs the extension"),
        (("accessors", 0, "extensions"), {"VENDOR_packed": {}}, r"accessors\[0\]: needs the extension VENDOR_packed"),
        ((*PRIMITIVE, "extensions"), {"VENDOR_strands": {}}, "uses VENDOR_strands"),
        ((*PRIMITIVE, "targets"), [{"POSITION": 0}], "has morph targets"),
        ((*PRIMITIVE, "mode"), 1, "holds lines, which have no surface"),
        ((*PRIMITIVE, "mode"), 0, "holds points"),
        ((*PRIMITIVE, "mode"), 7, "has mode 7; valid: 4, 5 and 6"),
        ((*PRIMITIVE, "attributes"), {"NORMAL": 0}, "has no attribute POSITION"),
        ((*PRIMITIVE, "indices"), 9, r"names accessors\[9\], but there are 2"),
        ((*PRIMITIVE, "mdoe"), 4, r"meshes\[0\].primitives\[0\].mdoe: extra inputs"),
        (("nodes", 0, "skin"), 0, "deformed by a skin"),
        (("nodes", 0, "children"), [0], "has two parents or is its own ancestor"),
        (("nodes", 0, "rotation"), [0, 0, 0, 2], "expected a rotation of length 1"),
        (("nodes", 0, "matrix"), [1] * 16, "expected an affine 'matrix'"),
        (("nodes", 0, "mesh"), True, r"nodes\[0\].mesh: input should be a valid integer"),
        (("animations",), [{}], "moves in time"),
        (("skins",), [{}], "deformed by a skin"),
        (("scenes",), [{"nodes": [0]}, {"nodes": []}, {}], None),
        (("scene",), 3, r"names scenes\[3\]"),
        (("scenes", 0, "nodes"), [], r"meshes\[0\]: is in no node of the scene"),
        (("asset", "version"), "1.0", "is glTF 1.0, 2.0 is read"),
        (("accessors", 0, "count"), 9, r"accessors\[0\]: takes 9 elements"),
        (("accessors", 0, "count"), 7, "."),
        (("accessors", 0, "count"), 2**39, r"takes 549755813888 elements"),
        (("accessors", 0, "byteOffset"), 4, "takes 8 elements"),
        (("accessors", 0, "max"), [1.0, 1.0, 2.0], "declares vertices with max"),
        (("accessors", 0, "componentType"), 5125, "stores vertices as VEC3 of component type 5125"),
        (("accessors", 0, "type"), "VEC4", "stores vertices as VEC4"),
        (("accessors", 1, "count"), 35, "which make no whole triangles"),
        (("accessors", 1, "componentType"), 5126, "stores indices as SCALAR of component type 5126"),
        (("accessors", 1, "max"), [6], "declares indices with max"),
        (("accessors", 1, "byteOffset"), 1, "."),
        (("bufferViews", 1, "byteLength"), 10**6, "of a buffer of"),
        (("bufferViews", 0, "byteStride"), 4, "every 4 from byte 0"),
        (("buffers", 0, "byteLength"), 10**6, "cut off or damaged"),
        (("buffers", 0, "byteLength"), 10**12, "declares buffers of 1000000000000 bytes"),
    ],
)  # fmt: skip
def test_what_is_not_decoded_or_does_not_fit_is_refused_by_name(writers, read, box, where, value, message):
    document, data = writers.gltf(*box)
    changed = _change(document, where, value)
    if message is None:
        assert len(read(changed, data).faces) == 12
        del changed["scene"]
        message = "has 3 scenes and does not say which is shown"
    with pytest.raises(FormatError, match=message):
        read(changed, data)


def test_an_accessor_without_data_is_refused(writers, read, box):
    document, data = writers.gltf(*box)
    del document["accessors"][0]["bufferView"]
    with pytest.raises(FormatError, match=r"accessors\[0\]: stores vertices without data: compressed"):
        read(document, data)


@pytest.mark.parametrize(
    "uri",
    ["/etc/passwd", "../box.bin", "a/../../box.bin", "http://x/box.bin", "file:///etc/passwd", "//host/box.bin",
     "C:\\box.bin", "..\\box.bin", "%2e%2e/box.bin", "%2Fetc/passwd", "box.bin?x", "", "link.bin"],
)  # fmt: skip
def test_buffers_lie_beside_the_file(writers, tmp_path, box, uri):
    (tmp_path / "box.bin").write_bytes(writers.gltf(*box)[1])
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "box.bin")
    path = writers.write(folder / "mesh.gltf", "gltf", *box)
    document = json.loads(path.read_text(encoding="utf-8"))
    document["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(document))
    for call in (read_mesh_file, mesh_sha256):
        with pytest.raises(FormatError, match="expected a file beside it|leads out of its folder"):
            call(path)


def test_buffers_in_a_folder_beside_the_file_or_in_the_text_are_read(writers, read, tmp_path, box):
    document, data = writers.gltf(*box)
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    assert len(read(document, b"", "gltf").faces) == 12
    (tmp_path / "my buffers").mkdir()
    (tmp_path / "my buffers" / "b.bin").write_bytes(data)
    document["buffers"][0]["uri"] = "my%20buffers/b.bin"
    assert len(read(document, b"", "gltf").faces) == 12
    document["buffers"][0]["uri"] = "gone.bin"
    with pytest.raises(FormatError, match="gone.bin: no such file"):
        read(document, b"", "gltf")
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64,!!!!"
    with pytest.raises(FormatError, match="is not valid base64"):
        read(document, b"", "gltf")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "nested too deeply|is not valid"),
        ("[]", "expected a JSON object"),
        ("{", "is not valid glTF JSON"),
        ('{"asset": {"version": "2.0"}, "scene": ' + "9" * 5000 + "}", "is not valid glTF JSON"),
        ('{"asset": {"version": "2.0"}, "asset": {"version": "2.0"}}', "names a key twice"),
        ('{"asset": {"version": "2.0"}, "scene": NaN}', "NaN is no number"),
        ('{"scene": 0}', "asset: field required"),
        ('{"asset": {"version": "2.0"}}', "has 0 scenes"),
    ],
)
def test_json_that_is_none_or_absurd_is_refused(read, text, message):
    with pytest.raises(FormatError, match=message):
        read(text, b"", "gltf")


def test_a_glb_file_of_another_kind_is_refused(writers, tmp_path, box):
    whole = writers.glb(*writers.gltf(*box))
    path = tmp_path / "mesh.glb"
    for content, message in (
        (b"{}", "has no GLB header"),
        (whole[:4] + b"\1" + whole[5:], "is GLB version 1"),
        (whole + bytes(4), "declares .* bytes and holds"),
        (whole[:16] + b"XXXX" + whole[20:], "expected a chunk JSON"),
    ):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=message):
            read_mesh_file(path)
