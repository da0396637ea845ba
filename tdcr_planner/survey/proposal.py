"""A scenario for a file of a place: role, unit, entry plane, base pose, travel and a goal on the centreline."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomli_w

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.meshes import Entry
from tdcr_planner.collision.topology import Loop
from tdcr_planner.robot import RobotSpec
from tdcr_planner.survey.centreline import Centreline

TRAVEL = 0.95
"""Of the robot's length: how far it is pushed in at most, so that its base stays outside."""
STANDOFF_IN_RADII = 2.0
GOAL_FRACTIONS = (0.9, 0.75, 0.6, 0.45, 0.3)
"""Of the depth that the robot can reach: where goals are proposed, deepest first."""


@dataclass(frozen=True)
class Proposal:
    """A scenario in the making.

    Attributes:
        surfaces: The surfaces' tables, as TOML.
        robot: The robot's file, as the scenario names it.
        shape_model: The model's file as the scenario names it; None for the reference.
        entry: The entry plane at the mouth.
        base: Where the base stands at insertion 0, shape (3,), m.
        travel: Largest insertion, m.
        goal: The tip's goal, shape (3,), m.
    """

    surfaces: str
    robot: str
    shape_model: str | None
    entry: Entry
    base: FloatArray
    travel: float
    goal: FloatArray

    def to_toml(self, title: str) -> str:
        """Returns the scenario file's text."""
        validity = "" if self.shape_model is not None else '\nvalidity = "reference"'
        model = "" if self.shape_model is None else f"shape_model = {quoted(self.shape_model)}\n"
        return f"""format = "tdcr-scenario/1"
title = {quoted(title)}
robot = {quoted(self.robot)}
{model}gravity_m_s2 = [0.0, 0.0, -9.81]
start = "straight"

{self.surfaces}
[base]
position_m = {vector(self.base)}
look_along = {vector(self.entry.normal)}
insertion_m = [0.0, {self.travel:.6g}]
roll_deg = [-180.0, 180.0]

[goal]
tip_position_m = {vector(self.goal)}

[planner]
time_limit_s = 20.0{validity}
"""


def propose(
    entry: Entry, line: Centreline, robot: RobotSpec, surfaces: str, robot_name: str, shape_model: str | None
) -> list[Proposal]:
    """Returns scenarios whose goals lie on the centreline, the deepest first.

    Args:
        entry: The entry plane at the mouth.
        line: The place's centreline.
        robot: The robot.
        surfaces: The surfaces' tables, as TOML.
        robot_name: The robot's file as the scenario names it.
        shape_model: The model's file as the scenario names it, or None.
    """
    standoff = STANDOFF_IN_RADII * float(robot.disk_radii.max())
    base = entry.point - (robot.length + standoff) * entry.normal
    depth = float(line.depths[-1])
    travel = min(TRAVEL * robot.length, depth) + standoff
    goals = []
    for fraction in GOAL_FRACTIONS:
        at = int(np.searchsorted(line.depths, fraction * (travel - standoff)))
        goals.append(line.points[min(at, len(line.points) - 1)])
    return [Proposal(surfaces, robot_name, shape_model, entry, base, travel, goal) for goal in goals]


def entry_at(vertices: FloatArray, loop: Loop) -> Entry:
    """Returns the entry plane at an opening: through the rim's outermost point, its normal into the cavity.

    Args:
        vertices: The surface's vertices, shape (v, 3), m.
        loop: The opening's rim.
    """
    from_rim = vertices - loop.centre
    # Next to the rim the wall runs inward.
    near = np.linalg.norm(from_rim, axis=1) < 3.0 * loop.diameter
    direction = loop.normal if float((from_rim[near] @ loop.normal).sum()) >= 0.0 else -loop.normal
    return Entry(loop.centre - loop.flatness * direction, direction)


def relative_name(file: Path, folder: Path) -> str:
    """Returns a file as a scenario in a folder names it."""
    return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()


def quoted(text: str) -> str:
    """Returns a text as TOML has it."""
    return tomli_w.dumps({"x": text})[4:].strip()


def vector(values: FloatArray) -> str:
    """Returns a vector as TOML has it, to seven digits."""
    return "[" + ", ".join(repr(float(f"{value:.7g}")) for value in (np.asarray(values) + 0.0).tolist()) + "]"
