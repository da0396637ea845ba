"""Variants: the robot and scenario files of a design, made from those that a study starts from."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from tdcr_planner.design.study import CAMERA_TILT, SCENARIO_PREFIX, SEGMENT_COUNT, Parameter
from tdcr_planner.errors import nearest_name
from tdcr_planner.files import read_toml, real_path

Tables = tuple[dict[str, Any], dict[str, Any]]


def base_tables(scenario: Path) -> Tables:
    """Returns the tables of the robot and of a scenario file, its paths absolute.

    Raises:
        FormatError: A file is missing or no TOML.
    """
    table = read_toml(scenario)
    folder = real_path(scenario).parent
    for name in ("robot", "shape_model"):
        if isinstance(table.get(name), str):
            table[name] = str(real_path(folder / table[name]))
    for mesh in table.get("meshes", []):
        mesh["file"] = str(real_path(folder / mesh["file"]))
    inspect = table.get("inspect")
    for surface in (inspect or {}).get("surfaces", []):
        if isinstance(surface, dict) and "within" in surface:
            surface["within"]["file"] = str(real_path(folder / surface["within"]["file"]))
    return read_toml(table["robot"]), table


def apply(tables: Tables, values: Mapping[str, float], parameters: Sequence[Parameter]) -> Tables:
    """Returns the tables of robot and scenario with a design's numbers in them.

    Args:
        tables: Those of the study.
        values: A number for each parameter, by its label.
        parameters: The study's.

    Raises:
        KeyError: A key names nothing; its argument says what would be valid.
    """
    robot, scenario = copy.deepcopy(tables)
    # The number of segments first, so that keys may name those that it makes.
    ordered = sorted(parameters, key=lambda parameter: SEGMENT_COUNT not in parameter.keys)
    for parameter in ordered:
        value: float | int = values[parameter.label]
        value = round(value) if parameter.whole else float(value)
        for key in parameter.keys:
            if key == SEGMENT_COUNT:
                _repeat_last(robot, int(value))
            elif key == CAMERA_TILT:
                tilt = math.radians(float(value))
                _camera(robot, scenario)["direction"] = [math.sin(tilt), 0.0, math.cos(tilt)]
            elif key.startswith(SCENARIO_PREFIX):
                _write(scenario, key.removeprefix(SCENARIO_PREFIX), value, key)
            else:
                _write(robot, key, value, key)
    return robot, scenario


def _camera(robot: dict[str, Any], scenario: dict[str, Any]) -> dict[str, Any]:
    inspect = scenario.get("inspect") or {}
    found = inspect.get("camera") or robot.get("camera")
    if found is None:
        raise KeyError("there is no [camera] to tilt")
    camera: dict[str, Any] = found
    return camera


def _repeat_last(robot: dict[str, Any], count: int) -> None:
    """Makes a robot of so many segments: the last is repeated, with its tendons, or segments are left out."""
    segments = robot["segments"]
    known = len(segments)
    tendons = robot.get("tendons")
    robot["segments"] = [copy.deepcopy(segments[min(index, known - 1)]) for index in range(count)]
    if tendons is not None:
        robot["tendons"] = [
            {**copy.deepcopy(tendon), "segment": index + 1}
            for index in range(count)
            for tendon in tendons
            if tendon.get("segment") == min(index + 1, known)
        ]


def _write(table: dict[str, Any], key: str, value: float, name: str) -> None:
    places: list[Any] = [table]
    parts = re.findall(r"[a-z_0-9]+|\[(?:\d+|\*)\]", key)
    for part in parts[:-1]:
        places = [inner for place in places for inner in _step(place, part, name)]
    for place in places:
        _set(place, parts[-1], value, name)


def _step(place: Any, part: str, name: str) -> list[Any]:
    if part.startswith("["):
        return [place[index] for index in _indices(place, part, name)]
    if not isinstance(place, dict) or part not in place:
        valid = place if isinstance(place, dict) else ()
        raise KeyError(f"{name!r}: there is no {part!r}; {nearest_name(part, map(str, valid))}")
    return [place[part]]


def _set(place: Any, part: str, value: float, name: str) -> None:
    if part.startswith("["):
        for index in _indices(place, part, name):
            place[index] = value
        return
    if not isinstance(place, dict):
        raise KeyError(f"{name!r}: {part!r} belongs to no table")
    known = place.get(part)
    if part not in place or isinstance(known, bool) or not isinstance(known, int | float):
        numbers = [str(key) for key, held in place.items() if isinstance(held, int | float)]
        raise KeyError(f"{name!r}: the file states no number {part!r}; {nearest_name(part, numbers)}")
    place[part] = value


def _indices(place: Any, part: str, name: str) -> list[int]:
    if not isinstance(place, list) or not place:
        raise KeyError(f"{name!r}: {part} follows what is no list")
    if part == "[*]":
        return list(range(len(place)))
    index = int(part[1:-1])
    if not 1 <= index <= len(place):
        raise KeyError(f"{name!r}: expected a number from 1 to {len(place)} in {part}")
    return [index - 1]


def write_variant(tables: Tables, folder: Path, name: str = "design") -> tuple[Path, Path]:
    """Writes a design as robot.toml and scenario.toml into a folder, made when missing; returns their paths."""
    robot, scenario = copy.deepcopy(tables)
    robot["name"] = name
    folder.mkdir(parents=True, exist_ok=True)
    files = folder / "robot.toml", folder / "scenario.toml"
    scenario["robot"] = "robot.toml"
    for file, table in zip(files, (robot, scenario), strict=True):
        file.write_text(tomli_w.dumps(table), encoding="utf-8")
    return files
