"""What of a scenario makes its scene: the meshes in their roles, and the facts by which two queries share one."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.collision.entrance import missed_by, obstruction
from tdcr_planner.collision.mesh_files.registry import mesh_sha256
from tdcr_planner.collision.meshes import SceneMesh, load_scene_mesh
from tdcr_planner.collision.roles import find_role
from tdcr_planner.errors import FormatError
from tdcr_planner.files import sha256_of_file, sha256_of_json
from tdcr_planner.planning.scenario import MeshEntry, Scenario

logger = logging.getLogger(__name__)

_SHOWN_DIGITS = 12  # of a hash, in messages


def load_scene_meshes(scenario: Scenario) -> list[SceneMesh]:
    """Returns the meshes of a scenario in metres, each with its role and, for a cavity, its entry plane.

    Raises:
        FormatError: A mesh cannot be used, or it is a cavity that the body cannot get into from its base at the start.
    """
    files = [scenario.resolve(entry.file) for entry in scenario.file.meshes]
    meshes = []
    for index, (entry, file, name) in enumerate(zip(scenario.file.meshes, files, mesh_names(files), strict=True)):
        point, normal = entry_plane(scenario, entry)
        mesh = load_scene_mesh(file, entry.unit, entry.role, point, normal, name)
        _check_way_in(scenario, mesh, f"meshes[{index + 1}].file")
        meshes.append(mesh)
    return meshes


def mesh_names(files: Sequence[Path]) -> list[str]:
    """Returns what to call meshes: their files' names, with as many folders as tell equal names apart."""
    names = []
    for index, file in enumerate(files):
        others = [other for other in files if other != file]
        depth = 1
        while any(other.parts[-depth:] == file.parts[-depth:] for other in others):
            depth += 1
        again = files[:index].count(file)
        names.append("/".join(file.parts[-depth:]) + (f" ({again + 1})" if again else ""))
    return names


def _check_way_in(scenario: Scenario, mesh: SceneMesh, place: str) -> None:
    """Refuses a cavity that the body cannot get into, and warns of a base that does not face its opening."""
    axis = scenario.base_rotation[:, 2]
    base = scenario.base_position + scenario.file.start.insertion_m * axis
    reason = obstruction(mesh, base, float(scenario.robot.disk_radii[1:].min()))
    if reason is not None:
        raise FormatError(scenario.path, f"{mesh.name} {reason}", place)
    missed = missed_by(mesh, base, axis)
    if missed is not None:
        logger.warning("%s: %s: %s", scenario.path, mesh.name, missed)


def entry_plane(scenario: Scenario, mesh: MeshEntry) -> tuple[Any, Any]:
    """Returns point and normal of the plane through which the body enters a cavity; None twice for other roles."""
    if not find_role(mesh.role).keeps_inside:
        return None, None
    if mesh.entry is not None:
        return np.asarray(mesh.entry.point_m), np.asarray(mesh.entry.normal)
    return scenario.base_position, scenario.base_rotation[:, 2]


def scene_files(scenario: Scenario) -> dict[Path, str]:
    """Returns the SHA-256 of every mesh and of the shape model that a scenario names, by absolute path.

    That of a mesh covers all files that its geometry lies in; see `mesh_sha256`.
    """
    hashes = {path: mesh_sha256(path) for path in {scenario.resolve(mesh.file) for mesh in scenario.file.meshes}}
    if scenario.shape_model_path is not None:
        hashes[scenario.shape_model_path] = sha256_of_file(scenario.shape_model_path)
    return hashes


def geometry_sha256(meshes: Sequence[SceneMesh]) -> str:
    """Returns the SHA-256 of meshes as they were read: vertices in metres, faces, roles and entry planes."""
    return sha256_of_json([mesh.sha256 for mesh in meshes])


def scene_facts(scenario: Scenario, known: Mapping[Path, str] | None = None) -> dict[str, Any]:
    """Returns what must agree for two scenarios to share one scene, as JSON has it.

    Files count by what they hold, wherever they lie: meshes with unit, role and entry plane, the shape model; the
    robot counts whole but for its name; base pose and ranges, gravity and tip force count as the file states them.
    Start, goals, planner settings and rates do not count.

    Args:
        scenario: The scenario.
        known: Hashes of files by absolute path, as `scene_files` gives them; what is not in it is read and hashed.
    """
    hashes = known or {}

    meshes = []
    for mesh in scenario.file.meshes:
        point, normal = entry_plane(scenario, mesh)
        entry = None if point is None else {"point_m": point.tolist(), "normal": normal.tolist()}
        file = scenario.resolve(mesh.file)
        digest = hashes.get(file) or mesh_sha256(file)
        meshes.append({"sha256": digest, "unit": mesh.unit, "role": mesh.role, "entry": entry})
    model = scenario.shape_model_path
    facts = {
        "robot": {"mechanics": scenario.robot.mechanics_hash, **scenario.robot.model_dump(exclude={"name"})},
        "meshes": meshes,
        "base": scenario.file.base.model_dump(),
        "gravity_m_s2": scenario.file.gravity_m_s2,
        "tip_force_n": scenario.file.tip_force_n,
        "shape_model": None if model is None else hashes.get(model) or sha256_of_file(model),
    }
    plain: dict[str, Any] = json.loads(json.dumps(facts, allow_nan=False))
    return plain


def differences(mine: Any, other: Any) -> list[str]:
    """Returns where two sets of facts differ, each as "key: one value, not another".

    Args:
        mine: Facts as JSON has them.
        other: Those they are compared with; named second.
    """
    return [f"{place}: {_shown(a)}, not {_shown(b)}" for place, a, b in _differing("", mine, other)]


def _differing(place: str, mine: Any, other: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(mine, dict) and isinstance(other, dict):
        for key in [*mine, *(key for key in other if key not in mine)]:
            yield from _differing(f"{place}.{key}" if place else key, mine.get(key), other.get(key))
    elif isinstance(mine, list) and isinstance(other, list) and any(isinstance(item, dict) for item in mine + other):
        if len(mine) != len(other):
            yield place, f"{len(mine)} of them", f"{len(other)}"
        for index, (a, b) in enumerate(zip(mine, other, strict=False)):
            yield from _differing(f"{place}[{index + 1}]", a, b)
    elif mine != other:
        yield place, mine, other


def _shown(value: Any) -> str:
    text = str(value)
    is_hash = isinstance(value, str) and len(value) == 64
    return text[:_SHOWN_DIGITS] if is_hash else text
