"""Scene and path as binary glTF, in metres: walls, goals, the tip's way, and the robot moving along the path."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from trimesh.visual.material import PBRMaterial

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.body import Kind
from tdcr_planner.collision.roles import find_role
from tdcr_planner.report import plots
from tdcr_planner.report.body_mesh import solid_ends
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.robot_mesh import Mesh, backbone_curve, disk_mesh, merge_meshes, tendon_lines, tube_mesh
from tdcr_planner.report.tendon_style import tendon_colour
from tdcr_planner.report.text import plain_text

MAX_KEYFRAMES = 128
_PIECES_PER_GAP = 2
# A real tendon is a hair that no viewer shows.
_TENDON_OF_DISK = 0.03
_FLOAT = 5126  # glTF 2.0, table of accessor data types
_JSON_CHUNK, _BIN_CHUNK = 0x4E4F534A, 0x004E4942


@dataclass(frozen=True)
class Track:
    """How a node moves: its pose at each keyframe.

    Attributes:
        translation: Shape (k, 3), m, world frame.
        rotation: Quaternions x, y, z, w, shape (k, 4), world_from_node.
        scale: Shape (k, 3).
    """

    translation: FloatArray
    rotation: FloatArray
    scale: FloatArray


def write_glb(picture: Picture, file: str | Path) -> None:
    """Writes the scene and the robot as a binary glTF file whose animation "path" runs in the path's own time.

    Each disk is a node ("disk 7"), backbone and tendons are pieces between disks, all of them moved by keyframes at up
    to `MAX_KEYFRAMES` states. A scenario has the robot at its start and no animation.
    """
    scene = trimesh.Scene()
    for number, mesh in enumerate(picture.meshes):
        colour = to_rgb(find_role(mesh.role).wall.export)
        _add(scene, f"{number + 1} {plain_text(mesh.name)}", (mesh.vertices, mesh.faces), colour, 0.3)
    for number, goal in enumerate(picture.goals):
        ball = trimesh.creation.icosphere(subdivisions=3, radius=max(goal.tolerance, 1e-3))
        _add(scene, f"goal {number + 1}", (ball.vertices + goal.position, ball.faces), to_rgb(plots.GOAL), 0.5)
    tips = picture.positions[picture.known][:, -1]
    apart = np.ones(len(tips), dtype=np.bool_)
    apart[1:] = np.linalg.norm(np.diff(tips, axis=0), axis=1) > 1e-7
    if apart.sum() > 1:
        tube = tube_mesh(tips[apart], 0.25 * picture.robot.backbone.radius_m + 2e-4)
        _add(scene, "tip trace", tube, to_rgb(plots.TRACE), 1.0)
    for number, mark in enumerate(picture.marks):
        name = f"mark {number + 1}: {plain_text(mark.label)}"
        if mark.point is not None:
            ball = trimesh.creation.icosphere(subdivisions=3, radius=0.4 * float(picture.robot.disk_radii.max()))
            _add(scene, name, (ball.vertices + mark.point, ball.faces), to_rgb(plots.ALERT), 1.0)
        if mark.positions is not None and mark.rotations is not None:
            line = backbone_curve(mark.positions, mark.rotations, picture.robot.arc_lengths)
            tube = tube_mesh(line, picture.robot.backbone.radius_m)
            ghost = merge_meshes([disk_mesh(picture.robot, mark.positions, mark.rotations), tube])
            _add(scene, f"{name}, configuration", ghost, to_rgb(plots.ALERT), 0.4)
    states = picture.frame_states(MAX_KEYFRAMES)
    states = states[np.diff(picture.times[states], prepend=-np.inf) > 0.0]
    tracks = _add_robot(scene, picture, states) if len(states) else {}
    content = scene.export(file_type="glb")
    if tracks:
        content = animate_glb(content, picture.times[states], tracks)
    Path(file).write_bytes(content)


def _add_robot(scene: trimesh.Scene, picture: Picture, states: IntArray) -> dict[str, Track]:
    """Adds the robot's parts as nodes and returns how each of them moves over some states."""
    robot, positions, rotations = picture.robot, picture.positions[states], picture.rotations[states]
    tracks: dict[str, Track] = {}
    flat_positions, flat_rotations = np.zeros((robot.disk_count, 3)), np.tile(np.eye(3), (robot.disk_count, 1, 1))
    vertices, faces = disk_mesh(robot, flat_positions, flat_rotations)
    corners, sides = len(vertices) // robot.disk_count, len(faces) // robot.disk_count
    for disk in range(robot.disk_count):
        body = (vertices[disk * corners : (disk + 1) * corners], faces[:sides])
        _add(scene, f"disk {disk}", body, to_rgb(plots.ROBOT), 1.0)
        quaternions = Rotation.from_matrix(rotations[:, disk]).as_quat()
        tracks[f"disk {disk}"] = Track(positions[:, disk], _steady(quaternions), np.ones((len(states), 3)))
    curves = np.stack(
        [
            backbone_curve(one, turn, robot.arc_lengths, _PIECES_PER_GAP)
            for one, turn in zip(positions, rotations, strict=True)
        ]
    )
    rod = _rod(scene, "backbone", robot.backbone.radius_m, plots.INK)
    rod.lay(tracks, "backbone", curves, np.repeat(rotations[:, :-1], _PIECES_PER_GAP, axis=1))
    radius = max(robot.body.tendon_radius_m, _TENDON_OF_DISK * float(robot.disk_radii.max()))
    lines = [tendon_lines(robot, one, turn) for one, turn in zip(positions, rotations, strict=True)]
    for tendon in range(robot.tendon_count):
        line = np.stack([state[tendon] for state in lines])
        thread = _rod(scene, f"tendon {tendon + 1}", radius, tendon_colour(tendon))
        thread.lay(tracks, f"tendon {tendon + 1}", line, rotations[:, : line.shape[1] - 1])
    for kind, name, colour, opacity in (
        (Kind.SLEEVE, "sleeve", plots.SLEEVE, 0.35),
        (Kind.SHAFT, "shaft", plots.SHAFT, 1.0),
    ):
        solids = [solid_ends(picture.body, kind, one, turn) for one, turn in zip(positions, rotations, strict=True)]
        for number, radius in enumerate(solids[0][1]):
            node = name if kind == Kind.SHAFT else f"{name} {number + 1}"
            line = np.stack([ends[number] for ends, _ in solids])
            disk = 0 if kind == Kind.SHAFT else number
            _rod(scene, node, float(radius), colour, opacity, sides=24).lay(
                tracks, node, line, rotations[:, disk : disk + 1]
            )
    return tracks


@dataclass(frozen=True)
class _Rod:
    """A rod of length 1 along z that pieces of a line share."""

    scene: trimesh.Scene
    body: trimesh.Trimesh

    def lay(self, tracks: dict[str, Track], name: str, lines: FloatArray, frames: FloatArray) -> None:
        """Adds a node for each piece of a line, shape (k, m, 3), m, and its track.

        `frames` (k, m - 1, 3, 3) are rotations whose z is near each piece's direction: the piece turns as they do.
        """
        chords = np.diff(lines, axis=1)
        lengths = np.linalg.norm(chords, axis=2)
        local = np.einsum("kmij,kmi->kmj", frames, chords / np.maximum(lengths, 1e-12)[..., None])
        # the shortest turn from z to a direction u: (z x u, 1 + z . u), normalised
        half = np.stack([-local[..., 1], local[..., 0], np.zeros_like(lengths), 1.0 + local[..., 2]], axis=-1)
        for piece in range(chords.shape[1]):
            turn = Rotation.from_matrix(frames[:, piece]) * Rotation.from_quat(half[:, piece])
            node = f"{name}, piece {piece + 1}"
            # a piece of no length, as a shaft that is not out, is a point
            across = (lengths[:, piece] > 0.0).astype(np.float64)
            scale = np.stack([across, across, lengths[:, piece]], axis=1)
            tracks[node] = Track(lines[:, piece], _steady(turn.as_quat()), scale)
            if piece == 0:
                self.scene.add_geometry(self.body, geom_name=name, node_name=node)
            else:
                self.scene.graph.update(frame_to=node, matrix=np.eye(4), geometry=name)


def _rod(scene: trimesh.Scene, name: str, radius: float, colour: str, opacity: float = 1.0, sides: int = 8) -> _Rod:
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return _Rod(scene, _body(name, tube_mesh(ends, radius, sides), to_rgb(colour), opacity))


def _steady(quaternions: FloatArray) -> FloatArray:
    """Returns the same rotations with signs that make neighbours near, so that interpolation takes the short way."""
    flips = np.where(np.einsum("ki,ki->k", quaternions[1:], quaternions[:-1]) < 0.0, -1.0, 1.0)
    return np.asarray(quaternions * np.concatenate([[1.0], np.cumprod(flips)])[:, None])


def _add(scene: trimesh.Scene, name: str, mesh: Mesh, colour: tuple[float, ...], opacity: float) -> None:
    scene.add_geometry(_body(name, mesh, colour, opacity), geom_name=name, node_name=name)


def _body(name: str, mesh: Mesh, colour: tuple[float, ...], opacity: float) -> trimesh.Trimesh:
    material = PBRMaterial(
        name=name,
        baseColorFactor=[*colour, opacity],
        metallicFactor=0.0,
        roughnessFactor=0.6,
        alphaMode="OPAQUE" if opacity >= 1.0 else "BLEND",
        doubleSided=True,
    )
    return trimesh.Trimesh(*mesh, process=False, visual=trimesh.visual.TextureVisuals(material=material))


def animate_glb(content: bytes, times: FloatArray, tracks: dict[str, Track]) -> bytes:
    """Returns a binary glTF file with an animation "path" of named nodes added, which stand at the first keyframe.

    Args:
        content: A glTF 2.0 file with one JSON and one binary chunk (Khronos, glTF 2.0 Specification, section 4).
        times: Of the keyframes, increasing, shape (k,), s; one keyframe places the nodes without an animation.
        tracks: How each node moves, by name.
    """
    length = struct.unpack_from("<I", content, 12)[0]
    tree = json.loads(content[20 : 20 + length])
    binary = bytearray(content[28 + length : 28 + length + struct.unpack_from("<I", content, 20 + length)[0]])

    def add(array: FloatArray, kind: str) -> int:
        """Appends an accessor of 32-bit floats and returns its index."""
        values = np.ascontiguousarray(array, dtype="<f4")
        binary.extend(b"\0" * (-len(binary) % 4))
        tree["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        binary.extend(values.tobytes())
        tree["accessors"].append(_accessor(values, len(tree["bufferViews"]) - 1, kind))
        return len(tree["accessors"]) - 1

    places = {node.get("name"): index for index, node in enumerate(tree["nodes"])}
    for name, track in tracks.items():
        node = tree["nodes"][places[name]]
        node.pop("matrix", None)  # an animated node must not have one (section 3.6.3)
        for path in ("translation", "rotation", "scale"):
            node[path] = getattr(track, path)[0].tolist()
    if len(times) > 1:
        clock = add(times - times[0], "SCALAR")
        samplers: list[dict[str, Any]] = []
        channels: list[dict[str, Any]] = []
        for name, track in tracks.items():
            for path, kind in (("translation", "VEC3"), ("rotation", "VEC4"), ("scale", "VEC3")):
                values = getattr(track, path)
                if (values == values[0]).all():
                    continue
                channels.append({"sampler": len(samplers), "target": {"node": places[name], "path": path}})
                samplers.append({"input": clock, "output": add(values, kind), "interpolation": "LINEAR"})
        tree["animations"] = [{"name": "path", "samplers": samplers, "channels": channels}]
    tree["buffers"][0]["byteLength"] = len(binary)
    return _pack(tree, bytes(binary))


def _accessor(values: NDArray[np.float32], view: int, kind: str) -> dict[str, Any]:
    accessor = {"bufferView": view, "componentType": _FLOAT, "count": len(values), "type": kind}
    if kind == "SCALAR":  # what times come as must state its range (section 3.11)
        accessor |= {"min": [float(values.min())], "max": [float(values.max())]}
    return accessor


def _pack(tree: dict[str, Any], binary: bytes) -> bytes:
    """Returns the two chunks as a file, each filled up to a multiple of four bytes."""
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary))
    chunks = struct.pack("<II", len(text), _JSON_CHUNK) + text + struct.pack("<II", len(binary), _BIN_CHUNK) + binary
    return header + chunks
