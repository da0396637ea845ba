"""glTF 2.0 files, as JSON (.gltf) or in one file (.glb): the triangles of the scene that the file shows.

Every mesh of the file must be in that scene, and every extension on the way to it must be one that changes no geometry,
or one that is decoded (KHR_mesh_quantization). Morph targets, skins and animations are refused: they leave open which
shape is meant.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.mesh_files.gltf_buffers import Buffers, buffer_file, pick
from tdcr_planner.collision.mesh_files.gltf_schema import Document, Node, Primitive, parse_document
from tdcr_planner.collision.mesh_files.polygons import fan_faces, strip_faces
from tdcr_planner.collision.mesh_files.source import MeshFormat, RawMesh, check_triangle_count, read_bytes
from tdcr_planner.errors import FormatError

_MAGIC, _JSON, _BINARY = b"glTF", b"JSON", b"BIN\0"
_DECODED = frozenset(["KHR_mesh_quantization"])
# Extensions that change how a surface looks or what belongs to it, not where it is.
_HARMLESS_PREFIXES = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
_HARMLESS = frozenset(["MSFT_lod", "MSFT_texture_dds", "EXT_mesh_features", "EXT_structural_metadata"])
# Draco data beside plain accessors may be left aside; where the plain ones are missing, their accessor says so.
_DRACO = "KHR_draco_mesh_compression"
_MODES = {0: "points", 1: "lines", 2: "line loops", 3: "line strips"}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def _read(path: Path) -> RawMesh:
    document, binary = _open(path)
    _check_document(path, document)
    buffers = Buffers(path, document, binary)
    vertices, faces = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)]
    total, triangles = 0, 0
    shown = set()
    for index, node, matrix in _placed_nodes(path, document):
        if node.mesh is None:
            continue
        shown.add(node.mesh)
        place = f"nodes[{index}], meshes[{node.mesh}]"
        mesh = pick(path, document.meshes, node.mesh, "meshes")
        _check_extensions(path, mesh.extensions, place)
        for number, primitive in enumerate(mesh.primitives):
            points, found = _triangles(path, buffers, primitive, f"{place}.primitives[{number}]")
            triangles += len(found)
            check_triangle_count(path, max(triangles, (total + len(points)) // 3))
            if np.linalg.det(matrix[:3, :3]) < 0.0:
                found = found[:, ::-1]  # a mirror turns the outside in
            vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
            faces.append(found + total)
            total += len(points)
    left = sorted(set(range(len(document.meshes))) - shown)
    if left:
        raise FormatError(
            path, "is in no node of the scene that the file shows; place it there or delete it", f"meshes[{left[0]}]"
        )
    return RawMesh(np.concatenate(vertices), np.concatenate(faces))


def _open(path: Path) -> tuple[Document, bytes | None]:
    """Returns the document, and the binary chunk of a GLB file."""
    data = read_bytes(path)
    if not data.startswith(_MAGIC):
        if path.suffix.lower() == ".glb":
            raise FormatError(path, "has no GLB header: cut off, damaged or no GLB file")
        return parse_document(path, data), None
    if len(data) < 20:
        raise FormatError(path, "is cut off inside its GLB header")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise FormatError(path, f"is GLB version {version}, version 2 is read; export it as glTF 2.0")
    if length != len(data):
        raise FormatError(path, f"declares {length} bytes and holds {len(data)}: cut off or damaged")
    chunks, place = [], 12
    while place < length:
        if place + 8 > length:
            raise FormatError(path, "is cut off inside a chunk's header")
        size, kind = struct.unpack_from("<I4s", data, place)
        if place + 8 + size > length:
            raise FormatError(path, f"declares a chunk of {size} bytes and holds {length - place - 8}: damaged")
        chunks.append((kind, data[place + 8 : place + 8 + size]))
        place += 8 + size
    kinds = [kind for kind, _ in chunks]
    if kinds[0] != _JSON or kinds not in ([_JSON], [_JSON, _BINARY]):
        raise FormatError(path, f"expected a chunk JSON and one BIN, got {kinds}: damaged or with unknown parts")
    return parse_document(path, chunks[0][1]), chunks[1][1] if len(chunks) > 1 else None


def _parts(path: Path) -> tuple[Path, ...]:
    """Returns the file and the buffers that it names."""
    document, _ = _open(path)
    named = [
        buffer_file(path, buffer.uri, f"buffers[{index}]")
        for index, buffer in enumerate(document.buffers)
        if buffer.uri is not None and buffer.uri[:5].lower() != "data:"
    ]
    return (path, *dict.fromkeys(named))


def _check_document(path: Path, document: Document) -> None:
    """Refuses a document that holds, as a whole, what is not decoded."""
    asset = document.asset
    if not asset.version.startswith("2.") or (asset.minVersion or "2.0") != "2.0":
        raise FormatError(path, f"is glTF {asset.minVersion or asset.version}, 2.0 is read", "asset")
    unknown = [name for name in document.extensionsRequired if not (name in _DECODED or _is_harmless(name))]
    if unknown:
        raise FormatError(
            path,
            f"needs {', '.join(unknown)}, which is not decoded; export plain triangles, no compression or instances",
            "extensionsRequired",
        )
    _check_extensions(path, document.extensions, "extensions")
    if document.animations:
        raise FormatError(path, "moves in time, so which shape is meant is open; export it at rest", "animations")
    if document.skins:
        raise FormatError(path, "is deformed by a skin, which is not decoded; apply it and export again", "skins")


def _is_harmless(name: str) -> bool:
    return name in _HARMLESS or name.startswith(_HARMLESS_PREFIXES)


def _check_extensions(path: Path, extensions: dict[str, object], place: str) -> None:
    unknown = sorted(name for name in extensions if not (name in _DECODED or _is_harmless(name)))
    if unknown:
        raise FormatError(
            path, f"uses {', '.join(unknown)}, which is not decoded; export plain triangles without it", place
        )


def _placed_nodes(path: Path, document: Document) -> Iterator[tuple[int, Node, FloatArray]]:
    """Yields the nodes of the scene that the file shows, each with its number and world_from_node, shape (4, 4)."""
    if document.scene is None and len(document.scenes) != 1:
        raise FormatError(
            path, f"has {len(document.scenes)} scenes and does not say which is shown; name one in 'scene'", "scenes"
        )
    number = document.scene or 0
    scene = pick(path, document.scenes, number, "scenes")
    _check_extensions(path, scene.extensions, f"scenes[{number}]")
    seen: set[int] = set()
    waiting = [(index, np.eye(4)) for index in reversed(scene.nodes)]
    while waiting:
        index, parent = waiting.pop()
        node = pick(path, document.nodes, index, "nodes")
        place = f"nodes[{index}]"
        if index in seen:
            raise FormatError(path, "has two parents or is its own ancestor: damaged", place)
        seen.add(index)
        _check_extensions(path, node.extensions, place)
        if node.skin is not None or node.weights:
            raise FormatError(path, "is deformed by a skin or by morph targets, which are not decoded", place)
        matrix = parent @ _matrix(path, node, place)
        yield index, node, matrix
        waiting += [(child, matrix) for child in reversed(node.children)]


def _matrix(path: Path, node: Node, place: str) -> FloatArray:
    """Returns parent_from_node, shape (4, 4)."""
    if node.matrix is not None:
        matrix = np.array(node.matrix).reshape(4, 4).T
        moved = bool(node.model_fields_set & {"translation", "rotation", "scale"})
        if moved or (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
            raise FormatError(path, "expected an affine 'matrix' alone, or translation, rotation and scale", place)
        return matrix
    x, y, z, w = node.rotation
    length = float(np.linalg.norm(node.rotation))
    if abs(length - 1.0) > 1e-3:
        raise FormatError(path, f"expected a rotation of length 1, got {length:.6g}: damaged", place)
    x, y, z, w = x / length, y / length, z / length, w / length
    matrix = np.eye(4)
    rotation = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    matrix[:3, :3] = rotation * np.array(node.scale)
    matrix[:3, 3] = node.translation
    return matrix


def _triangles(path: Path, buffers: Buffers, primitive: Primitive, place: str) -> tuple[FloatArray, IntArray]:
    """Returns a primitive's vertices, shape (v, 3), node frame, and faces, shape (f, 3)."""
    if primitive.mode in _MODES:
        raise FormatError(
            path, f"holds {_MODES[primitive.mode]}, which have no surface; delete them or export triangles", place
        )
    if primitive.mode not in (_TRIANGLES, _STRIP, _FAN):
        raise FormatError(path, f"has mode {primitive.mode}; valid: 4, 5 and 6", place)
    if primitive.targets:
        raise FormatError(path, "has morph targets, which are not decoded; apply them and export again", place)
    _check_extensions(path, {name: 0 for name in primitive.extensions if name != _DRACO}, place)
    if "POSITION" not in primitive.attributes:
        raise FormatError(path, "has no attribute POSITION; export plain triangles", place)
    points = buffers.positions(primitive.attributes["POSITION"])
    indices = (
        np.arange(len(points), dtype=np.int64)
        if primitive.indices is None
        else buffers.indices(primitive.indices, len(points))
    )
    if len(indices) < 3 or (primitive.mode == _TRIANGLES and len(indices) % 3):
        raise FormatError(path, f"has {len(indices)} indices, which make no whole triangles: damaged", place)
    check_triangle_count(path, len(indices) // 3)
    if primitive.mode == _TRIANGLES:
        return points, indices.reshape(-1, 3)
    return points, strip_faces(indices) if primitive.mode == _STRIP else fan_faces(indices)


GLTF = MeshFormat("glTF", (".gltf", ".glb"), _read, _parts)
