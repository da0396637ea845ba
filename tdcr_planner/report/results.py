"""The result folder: result.json, trajectory.csv and shapes.npz, written together and read back, then the pictures."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, field_validator

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError
from tdcr_planner.files import (
    Count,
    FileModel,
    NotNegative,
    parse_table,
    read_json,
    real_path,
    sha256_of_file,
    write_folder_whole,
)
from tdcr_planner.planning.coordinates import drive_key
from tdcr_planner.planning.path import TensionPath
from tdcr_planner.planning.scenario import PlannerSettings, Scenario, load_scenario
from tdcr_planner.query.result import PlanResult, PlanStatus
from tdcr_planner.query.verification_report import FrictionSpread, VerificationReport
from tdcr_planner.report.plain import plain_json
from tdcr_planner.report.state_files import MOST_STATES, read_shapes, write_shapes, write_trajectory_csv

if TYPE_CHECKING:
    from tdcr_planner.report.marks import Mark
    from tdcr_planner.report.picture import Picture

RESULT_FORMAT = "tdcr-result/1"
RESULT_FILES = ("path.html", "path.png", "result.json", "shapes.npz", "trajectory.csv")

_Number = float | None
_Row = list[_Number]


class _PathTable(FileModel):
    """The states of a path, k rows each; keys carry the units."""

    bending_n: list[list[tuple[float, float]]] = []
    bending_m: list[list[tuple[float, float]]] = []
    tendon_n: list[list[float]] = []
    tendon_m: list[list[float]] = []
    insertion_m: Annotated[list[float], Field(min_length=1, max_length=MOST_STATES)]
    roll_deg: list[float]
    tensions_n: list[list[NotNegative]]
    tendon_displacement_m: list[_Row]
    tip_position_m: list[_Row]
    time_s: list[NotNegative]
    goal_states: list[tuple[Count, Count]] = []

    @field_validator("time_s")
    @classmethod
    def _check_order(cls, value: list[float]) -> list[float]:
        if any(after < before for before, after in pairwise(value)):
            raise ValueError("expected times that do not go back")
        return value


class _Worst(FileModel):
    """The worst values over the states; null where nothing is known."""

    residual_nm: _Number
    deviation_m: _Number
    clearance_m: _Number


class _FrictionTable(FileModel):
    """How far friction moves the body."""

    spread_m: NotNegative
    state: Count
    direction: str


class _VerificationTable(FileModel):
    """What the reference says of the path, with one entry a state in the arrays."""

    verified: bool
    message: str
    friction: _FrictionTable | None = None
    states: Count
    cause: str
    worst_state: Count
    worst: _Worst
    repairs: Count
    converged: list[bool]
    in_limits: list[bool]
    residual_nm: _Row
    deviation_m: _Row
    clearance_m: _Row


class _Timings(FileModel):
    """Seconds that each stage took."""

    load: NotNegative = 0.0
    plan: NotNegative = 0.0
    verify: NotNegative = 0.0
    total: NotNegative = 0.0


class _RoadmapUse(FileModel):
    """What the roadmap in use did for the query."""

    model_config = ConfigDict(extra="allow")

    vertices: Count
    edges: Count
    answered: bool
    reason: str = ""
    unfit: str = ""


class _RetractionUse(FileModel):
    """How far states were pulled back out of a narrow place."""

    model_config = ConfigDict(extra="allow")

    states: Count
    steps: Count
    out: bool
    from_insertion_m: float | None = None
    to_insertion_m: float | None = None


class _Planner(FileModel):
    """What the search says of itself; planners of one's own may say more."""

    model_config = ConfigDict(extra="allow")

    name: str
    settings: PlannerSettings
    iterations: Count | None = None
    vertices: Count | None = None
    states_checked: Count = 0
    edges_checked: Count = 0
    rejected: dict[str, Count] = {}
    answered_by: str = ""
    goal_states: Count = 0
    retraction: _RetractionUse | None = None
    roadmap: _RoadmapUse | None = None


class _ResultFile(FileModel):
    """The content of result.json."""

    format: Literal["tdcr-result/1"]
    status: PlanStatus
    message: str
    scenario: str
    scenario_absolute: str
    scenario_sha256: str
    inputs_sha256: dict[str, str]
    hashes: dict[str, str]
    versions: dict[str, str]
    seed: int
    timings_s: _Timings
    planner: _Planner
    path: _PathTable | None
    verification: _VerificationTable | None
    coverage: dict[str, Any] | None = None
    risk: dict[str, Any] | None = None
    shapes_sha256: str


def write_result(result: PlanResult, folder: str | Path, marks: Sequence[Mark] = ()) -> Path:
    """Writes a result as result.json, trajectory.csv and shapes.npz, all of them or none, then draws its pictures.

    Args:
        result: The answer to a query; path and verification may be missing.
        folder: Where to write; made when missing. Files of an earlier result are replaced.
        marks: What the pictures mark besides.

    Returns:
        The path of result.json.

    Raises:
        FormatError: The folder cannot be written. A picture that cannot be drawn is a warning.
    """
    file = write_result_data(result, folder)
    draw_result(result, folder, marks)
    return file


def write_result_data(result: PlanResult, folder: str | Path) -> Path:
    """Writes result.json, trajectory.csv and shapes.npz, all of them or none; returns the path of result.json.

    Pictures of an earlier result stay until `draw_result` replaces them.

    Raises:
        FormatError: The folder cannot be written.
    """
    target = real_path(folder)
    with write_folder_whole(target) as staging:
        write_shapes(result, staging / "shapes.npz")
        write_trajectory_csv(result, staging / "trajectory.csv")
        content = result_content(result, target)
        content["shapes_sha256"] = sha256_of_file(staging / "shapes.npz")
        text = json.dumps(content, indent=1, allow_nan=False)
        (staging / "result.json").write_text(text + "\n", encoding="utf-8")
    return target / "result.json"


def draw_result(result: PlanResult, folder: str | Path, marks: Sequence[Mark] = ()) -> list[str]:
    """Draws path.png and path.html into a result's folder and returns the names of those that were drawn.

    A picture that cannot be drawn is a warning that names it; earlier ones of these names go in any case.

    Args:
        result: The answer to a query.
        folder: The folder that `write_result_data` wrote.
        marks: What the pictures mark besides what the result itself carries.
    """
    from tdcr_planner.report.drawing import draw_pictures

    @cache
    def picture() -> Picture:
        from tdcr_planner.report.picture import gather_picture

        return gather_picture(result, marks)

    # what draws is loaded by the drawings: where it cannot be, the result stands
    def draw_png(file: Path) -> None:
        from tdcr_planner.report.scene_png import write_png

        write_png(picture(), file)

    def draw_html(file: Path) -> None:
        from tdcr_planner.report.scene_html import write_html

        write_html(picture(), file)

    return draw_pictures(folder, {"path.png": draw_png, "path.html": draw_html})


def result_content(result: PlanResult, folder: Path) -> dict[str, Any]:
    """Returns what result.json holds (shapes_sha256 excepted), with null for every number that is not finite.

    Args:
        result: The answer to a query.
        folder: The folder that the scenario's path is written relative to.
    """
    scenario = result.scenario
    content = {
        "format": RESULT_FORMAT,
        "status": result.status.value,
        "message": result.message,
        "scenario": _relative(scenario.path, folder),
        "scenario_absolute": str(scenario.path),
        "scenario_sha256": scenario.sha256,
        "inputs_sha256": _input_hashes(scenario),
        "hashes": {"scenario": scenario.sha256, "robot": scenario.robot.mechanics_hash, **result.hashes},
        "versions": result.versions,
        "seed": result.seed,
        "timings_s": result.timings_s,
        "planner": {
            "name": scenario.planner.name,
            **result.planner,
            "settings": scenario.planner.model_dump(mode="json"),
        },
        "path": None if result.path is None else _path_content(result.path, drive_key(scenario.robot)),
        "verification": None
        if result.verification is None
        else _verification_content(result.verification, result.repairs),
    }
    if result.risk is not None:
        content["risk"] = result.risk
    plain = plain_json(content)
    assert isinstance(plain, dict)  # a dictionary stays one
    return plain


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive has no relative path
        return str(path)


def _input_hashes(scenario: Scenario) -> dict[str, str]:
    """SHA-256 of the files that decide what a path means: the robot and the meshes with the files that they name."""
    hashes = {"robot": sha256_of_file(scenario.resolve(scenario.file.robot))}
    for surface, file, place in scenario.surfaces:
        hashes[f"{place}.file"] = surface.sha256(file)
    return hashes


def _path_content(path: TensionPath, drive: str) -> dict[str, Any]:
    return {
        drive: path.bending if drive.startswith("bending") else path.drive,
        "insertion_m": path.insertion,
        "roll_deg": np.rad2deg(path.roll),
        "tensions_n": path.tensions,
        "tendon_displacement_m": path.tendon_displacements,
        "tip_position_m": path.tip_positions,
        "time_s": path.times,
        "goal_states": path.goal_states,
    }


def _verification_content(report: VerificationReport, repairs: int) -> dict[str, Any]:
    friction = {} if report.friction is None else {"friction": asdict(report.friction)}
    return friction | {
        "verified": report.verified,
        "message": report.message,
        "states": report.states,
        "cause": report.cause,
        "worst_state": report.worst_state,
        "worst": report.worst,
        "repairs": repairs,
        "converged": report.converged,
        "in_limits": report.in_limits,
        "residual_nm": report.residual,
        "deviation_m": report.deviation,
        "clearance_m": report.clearance,
    }


def read_result(path: str | Path) -> PlanResult:
    """Returns a result that `write_result` wrote, with its scenario loaded again.

    Where shapes.npz is missing, a warning is logged and the poses of the verification are NaN: the path and what the
    reference said of it stand in result.json.

    Args:
        path: result.json, or the folder that holds it.

    Raises:
        FormatError: The file is missing, truncated, of another format or lacks a key; shapes.npz belongs to another
            result; or the scenario, its robot or a mesh is gone or has changed since, so that the path would be
            judged against something that it was not planned for.
    """
    file = Path(path)
    if os.path.isdir(file):
        file = file / "result.json"
    content = read_json(file)
    _check_format(content, file)
    table = parse_table(_ResultFile, content, file)
    scenario = _find_scenario(table, file)
    planner = table.planner.model_dump(exclude={"settings"}, exclude_unset=True)
    scenario = scenario.with_planner(**table.planner.settings.model_dump())
    tension_path = None if table.path is None else _read_path(table.path, scenario, file)
    report = None
    if table.verification is not None:
        if tension_path is None:
            raise FormatError(file, "there is a verification without a path", "path")
        if table.verification.worst_state >= len(tension_path):
            raise FormatError(file, f"expected a state below {len(tension_path)}", "verification.worst_state")
        report = _read_verification(table, len(tension_path), scenario, file)
    if table.status is PlanStatus.VERIFIED and not (report is not None and report.verified):
        raise FormatError(file, "is 'verified', expected a path and a verification that says so", "status")
    return PlanResult(
        status=table.status,
        message=table.message,
        scenario=scenario,
        seed=table.seed,
        path=tension_path,
        verification=report,
        repairs=0 if table.verification is None else table.verification.repairs,
        timings_s=table.timings_s.model_dump(),
        planner=planner,
        hashes=table.hashes,
        versions=table.versions,
        risk=table.risk,
    )


def _check_format(content: dict[str, Any], file: Path) -> None:
    if "format" not in content:
        raise FormatError(file, f"missing; expected {RESULT_FORMAT!r}: is this a result of `tdcr plan`?", "format")
    if content["format"] != RESULT_FORMAT:
        raise FormatError(
            file, f"expected {RESULT_FORMAT!r}, got {content['format']!r}; plan again with `tdcr plan`", "format"
        )


def _find_scenario(table: _ResultFile, file: Path) -> Scenario:
    """Loads the scenario that the result was planned for; a changed one, or a changed input of it, is refused."""
    candidates = [real_path(real_path(file).parent / table.scenario), Path(table.scenario_absolute)]
    present = [candidate for candidate in candidates if os.path.isfile(candidate)]
    if not present:
        tried = " or ".join(dict.fromkeys(str(candidate) for candidate in candidates))
        raise FormatError(file, f"no such file: {tried}; put the scenario back or plan it again", "scenario")
    same = [candidate for candidate in present if sha256_of_file(candidate) == table.scenario_sha256]
    if not same:
        raise FormatError(
            file,
            f"{present[0]} has changed since this result was written, and the path was planned for what it held then; "
            "plan it again with `tdcr plan`, or restore the scenario",
            "scenario_sha256",
        )
    scenario = load_scenario(same[0])
    for place, digest in _input_hashes(scenario).items():
        if table.inputs_sha256.get(place) != digest:
            raise FormatError(
                file,
                f"the file that {same[0]} names as {place} has changed since this result was written; "
                "plan it again with `tdcr plan`, or restore that file",
                f"inputs_sha256.{place}",
            )
    return scenario


def _read_array(value: Any, shape: tuple[int, ...], file: Path, place: str) -> FloatArray:
    """Returns lists of numbers (null for NaN) as an array of the given shape, or raises FormatError."""
    try:
        array = np.array(value, dtype=np.float64)
    except ValueError as error:
        raise FormatError(file, "expected rows of equal length", place) from error
    if array.size == 0 == math.prod(shape):
        return np.zeros(shape)
    if array.shape != shape:
        raise FormatError(file, f"expected shape {shape}, got {array.shape}", place)
    return array


def _read_path(table: _PathTable, scenario: Scenario, file: Path) -> TensionPath:
    robot, count = scenario.robot, len(table.insertion_m)

    def read(key: str, *shape: int) -> FloatArray:
        return _read_array(getattr(table, key), (count, *shape), file, f"path.{key}")

    key = drive_key(robot)
    values = read(key, *((robot.segment_count, 2) if key.startswith("bending") else (robot.tendon_count,)))
    return TensionPath(
        bending=values if key.startswith("bending") else np.zeros((count, robot.segment_count, 2)),
        drive=None if key == "bending_n" else values.reshape(count, -1),
        insertion=read("insertion_m"),
        roll=np.deg2rad(read("roll_deg")),
        tensions=read("tensions_n", robot.tendon_count),
        tendon_displacements=read("tendon_displacement_m", robot.tendon_count),
        tip_positions=read("tip_position_m", 3),
        times=read("time_s"),
        goal_states=_read_goal_states(table, count, scenario, file),
    )


def _read_goal_states(table: _PathTable, count: int, scenario: Scenario, file: Path) -> tuple[tuple[int, int], ...]:
    for state, goal in table.goal_states:
        if not (0 <= state < count and 0 <= goal < len(scenario.goals)):
            expected = f"a state below {count} and a goal below {len(scenario.goals)}"
            raise FormatError(file, f"expected {expected}, got {[state, goal]}", "path.goal_states")
    return tuple(table.goal_states)


def _read_verification(table: _ResultFile, count: int, scenario: Scenario, file: Path) -> VerificationReport:
    verification = table.verification
    assert verification is not None  # the caller has looked

    def read(key: str) -> FloatArray:
        return _read_array(getattr(verification, key), (count,), file, f"verification.{key}")

    shapes = read_shapes(file.with_name("shapes.npz"), table.shapes_sha256, count, scenario.robot.disk_count)
    return VerificationReport(
        verified=verification.verified,
        message=verification.message,
        converged=read("converged").astype(np.bool_),
        residual=read("residual_nm"),
        deviation=read("deviation_m"),
        clearance=read("clearance_m"),
        in_limits=read("in_limits").astype(np.bool_),
        positions=shapes["positions_m"],
        rotations=shapes["rotations"],
        model_positions=shapes.get("model_positions_m"),
        cause=verification.cause,
        worst_state=verification.worst_state,
        friction=None if verification.friction is None else FrictionSpread(**verification.friction.model_dump()),
    )
