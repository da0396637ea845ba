"""A trial: one design, built and measured in its scene, as plain values."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tdcr_planner.design.study import Limit, Study, load_study
from tdcr_planner.design.variants import apply, base_tables, write_variant
from tdcr_planner.errors import TdcrError
from tdcr_planner.inspection.inspect import make_search
from tdcr_planner.inspection.reach import map_reach, scene_grid
from tdcr_planner.planning.scenario import Scenario, load_scenario
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.robot import RobotSpec, load_robot


@dataclass(frozen=True)
class TrialJob:
    """What a worker needs to measure a design.

    Attributes:
        study: The study file.
        number: The trial's number.
        values: A number for each parameter, by its label.
        folder: Where the design's files go.
    """

    study: str
    number: int
    values: dict[str, float]
    folder: str


def run_trial(job: TrialJob) -> dict[str, Any]:
    """Measures a design; returns values a measure, or why it failed as "reason".

    A design that is no robot, that breaks a limit or whose start is not valid is a failed trial, no error.
    """
    study = load_study(job.study)
    try:
        scenario = build(study, job.values, Path(job.folder), f"design_{job.number}")
        broken = _breaks(study.file.limits, {"length_m": scenario.robot.length})
        if broken:
            return {"reason": broken}
        values = measure(study, scenario, Path(job.folder))
        broken = _breaks(study.file.limits, values)
        return {"reason": broken, "values": values} if broken else {"values": values, "robot": scenario.robot.name}
    except TdcrError as error:
        return {"reason": " ".join(str(error).split())}


def build(study: Study, values: dict[str, float], folder: Path, name: str) -> Scenario:
    """Writes a design's files and returns its scenario, with a shape model that fits its mechanics.

    The scenario's learned model is asked where the design's mechanics are those that it was trained for, else the
    reference.

    Raises:
        FormatError: The design is no valid robot or scenario.
    """
    robot_table, scenario_table = base_tables(study.scenario)
    base = load_robot(scenario_table["robot"])
    tables = apply((robot_table, scenario_table), values, study.file.parameters)
    robot_file, scenario_file = write_variant(tables, folder, name)
    robot = load_robot(robot_file)
    if robot.mechanics_hash != base.mechanics_hash:
        _ask_reference(tables[1])
    _fit_start(tables[1], robot)
    _, scenario_file = write_variant(tables, folder, name)
    return load_scenario(scenario_file)


def _ask_reference(scenario: dict[str, Any]) -> None:
    scenario.pop("shape_model", None)
    planner = scenario.setdefault("planner", {})
    if planner.get("validity", "learned") == "learned":
        planner["validity"] = "reference"


def _fit_start(scenario: dict[str, Any], robot: RobotSpec) -> None:
    """Gives the start as many rows as the robot has segments: those of the file, then zeros."""
    rows = scenario["start"]["bending_n"]
    missing = robot.segment_count - len(rows)
    scenario["start"]["bending_n"] = [*rows[: robot.segment_count], *([[0.0, 0.0]] * max(missing, 0))]


def _breaks(limits: tuple[Limit, ...], values: dict[str, float]) -> str:
    """Returns which limit values break; empty when they keep all that are about them."""
    for limit in limits:
        if limit.of not in values:
            continue
        value = values[limit.of]
        if limit.least is not None and value < limit.least:
            return f"{limit.of} of {value:.4g} is below the limit {limit.least:g}"
        if limit.most is not None and value > limit.most:
            return f"{limit.of} of {value:.4g} is above the limit {limit.most:g}"
    return ""


def measure(study: Study, scenario: Scenario, folder: Path) -> dict[str, float]:
    """Returns a value for each of the study's measures; larger is better.

    Raises:
        TdcrError: The design cannot be judged, as when its start is not valid.
    """
    session = PlanningSession(scenario)
    start = scenario.file.start
    checker = session.checker()
    problem = checker.explain(session.space.row(start.bending_n, start.insertion_m, start.roll_deg))
    if problem:
        raise TdcrError(f"the start is not valid: {problem}")
    values: dict[str, float] = {}
    if "coverage" in study.file.measures:
        values["coverage"] = _coverage(session, study.file.search_s)
    if "reach" in study.file.measures:
        values["reach"] = _reach(session, study)
    if {"clearance", "success"} & set(study.file.measures):
        solved = _solve(study, scenario, folder)
        for name in ("clearance", "success"):
            if name in study.file.measures:
                values[name] = solved[name]
    return values


def _coverage(session: PlanningSession, seconds: float) -> float:
    """Returns the share of the surfaces that free shapes see; whether a path leads to them is left to confirmation."""
    survey = make_search(session).survey
    survey.run(time.monotonic() + seconds)
    return survey.visibility.targets.share(survey.counts > 0)


def _reach(session: PlanningSession, study: Study) -> float:
    grid = scene_grid(session, study.file.cells)
    return map_reach(session, grid=grid, time_limit_s=study.file.search_s, seed=study.file.seed).reached_volume


def _solve(study: Study, scenario: Scenario, folder: Path) -> dict[str, float]:
    """Plans the study's queries with the design's robot; returns least clearance (m) and share solved."""
    clearances, solved = [], 0
    for number, file in enumerate(study.scenarios):
        _, table = base_tables(file)
        table["robot"] = str(folder / "robot.toml")
        if scenario.file.shape_model is None:
            _ask_reference(table)
        _fit_start(table, scenario.robot)
        name = folder / f"query_{number + 1}.toml"
        name.write_text(tomli_w.dumps(table), encoding="utf-8")
        query = load_scenario(name).with_planner(time_limit_s=study.file.search_s)
        result = PlanningSession(query).plan()
        if result.status is PlanStatus.VERIFIED and result.verification is not None:
            solved += 1
            clearances.append(float(result.verification.worst["clearance_m"]))
    least = float(np.min(clearances)) if clearances and solved == len(study.scenarios) else 0.0
    return {"clearance": least, "success": solved / len(study.scenarios)}
