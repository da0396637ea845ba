"""What of a scenario makes its scene: the meshes in their roles, and the facts by which two queries share one."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.collision.meshes import SceneMesh, load_scene_mesh
from tdcr_planner.files import sha256_of_file
from tdcr_planner.planning.scenario import MeshEntry, Scenario

_SHOWN_DIGITS = 12  # of a hash, in messages


def load_scene_meshes(scenario: Scenario) -> list[SceneMesh]:
    """Returns the meshes of a scenario in metres, each with its role and, for a cavity, its entry plane."""
    meshes = []
    for entry in scenario.file.meshes:
        point, normal = entry_plane(scenario, entry)
        meshes.append(load_scene_mesh(scenario.resolve(entry.file), entry.unit, entry.role, point, normal))
    return meshes


def entry_plane(scenario: Scenario, mesh: MeshEntry) -> tuple[Any, Any]:
    """Returns point and normal of the plane through which the body enters a cavity; None twice for an obstacle."""
    if mesh.role != "cavity":
        return None, None
    if mesh.entry is not None:
        return np.asarray(mesh.entry.point_m), np.asarray(mesh.entry.normal)
    return scenario.base_position, scenario.base_rotation[:, 2]


def scene_files(scenario: Scenario) -> dict[Path, str]:
    """Returns the SHA-256 of every mesh and of the shape model that a scenario names, by absolute path."""
    named = [scenario.resolve(mesh.file) for mesh in scenario.file.meshes]
    if scenario.shape_model_path is not None:
        named.append(scenario.shape_model_path)
    return {path: sha256_of_file(path) for path in named}


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

    def content(path: Path) -> str:
        return hashes.get(path) or sha256_of_file(path)

    meshes = []
    for mesh in scenario.file.meshes:
        point, normal = entry_plane(scenario, mesh)
        entry = None if point is None else {"point_m": point.tolist(), "normal": normal.tolist()}
        meshes.append(
            {"sha256": content(scenario.resolve(mesh.file)), "unit": mesh.unit, "role": mesh.role, "entry": entry}
        )
    model = scenario.shape_model_path
    facts = {
        "robot": {"mechanics": scenario.robot.mechanics_hash, **scenario.robot.model_dump(exclude={"name"})},
        "meshes": meshes,
        "base": scenario.file.base.model_dump(),
        "gravity_m_s2": scenario.file.gravity_m_s2,
        "tip_force_n": scenario.file.tip_force_n,
        "shape_model": None if model is None else content(model),
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
