"""What a picture points out: places, and configurations with a label, from the caller, the result or its message."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.files import FileModel, Vector3, parse_table
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.report.reference_poses import reference_shapes

if TYPE_CHECKING:
    from tdcr_planner.query.result import PlanResult

_NUMBER = r"(-?[\d.]+(?:e[+-]?\d+)?)"
# What `str` of a contact says: the part or parts, what they do, and where.
_CONTACT = re.compile(
    r"(?P<part>(?:disk|gap) \d+|shaft)(?: \(between disk \d+ and disk \d+\))?"
    r"(?: and (?P<other>(?:disk|gap) \d+|shaft)(?: \(between disk \d+ and disk \d+\))?)?"
    r" (?:touches .*? \(triangle \d+\) at|is (?:inside|outside) of .*? at|touch each other near)"
    rf" \({_NUMBER}, {_NUMBER}, {_NUMBER}\) m",
    re.DOTALL,
)


@dataclass(frozen=True)
class Mark:
    """Something to point out in a picture.

    Attributes:
        label: What it is, plain text.
        point: A place, shape (3,), m, world frame, drawn as a cross; None for none.
        positions: Disk centres of a configuration, shape (d, 3), m, world frame, drawn as an outline; None for none.
        rotations: Its world_from_disk, shape (d, 3, 3).
        part: The part of the body to highlight, as contacts name it ("disk 7", "gap 3", "shaft", or two joined by
            " and "), in `positions` or else in the only state of a picture without a path; empty for none.
    """

    label: str
    point: FloatArray | None = None
    positions: FloatArray | None = None
    rotations: FloatArray | None = None
    part: str = ""


class _MarkTable(FileModel):
    """A mark in a result's statistics; the keys are those of a goal of a scenario, a place and a part."""

    label: str
    point_m: Vector3 | None = None
    bending_n: tuple[tuple[float, float], ...] | None = None
    insertion_m: float = 0.0
    roll_deg: float = 0.0
    part: str = ""


def configuration_mark(scenario: Scenario, row: FloatArray, label: str, part: str = "") -> Mark:
    """Returns a mark of a configuration, shape (dimension,), drawn as the reference shapes it; a label alone if not."""
    positions, rotations = reference_shapes(scenario, np.asarray(row)[None])
    if not (np.isfinite(positions).all() and np.isfinite(rotations).all()):
        return Mark(f"{label} (no shape)")
    return Mark(label, positions=positions[0], rotations=rotations[0], part=part)


def marks_of(result: PlanResult) -> tuple[Mark, ...]:
    """Returns what a result asks its pictures to mark: the tables in its `planner["marks"]`.

    Each has a `label` and may have `point_m`, a configuration (`bending_n`, `insertion_m`, `roll_deg`) and `part`.

    Raises:
        FormatError: A table has another form.
    """
    marks = []
    space = ConfigurationSpace(result.scenario)
    for content in result.planner.get("marks", ()):
        table = parse_table(_MarkTable, content, result.scenario.path)
        mark = Mark(table.label, part=table.part)
        if table.bending_n is not None:
            row = space.row(table.bending_n, table.insertion_m, table.roll_deg)
            mark = configuration_mark(result.scenario, row, table.label, table.part)
        point = None if table.point_m is None else np.asarray(table.point_m)
        marks.append(Mark(mark.label, point, mark.positions, mark.rotations, mark.part))
    return tuple(marks)


def contact_marks(message: str, *, at_start: bool = False) -> tuple[Mark, ...]:
    """Returns a mark for each contact that a message tells, as `Contact` words them.

    Args:
        message: Why a query has no path or a path is not verified.
        at_start: Whether the state that touches is the start.
    """
    marks = []
    for found in _CONTACT.finditer(message):
        part = " and ".join(name for name in (found["part"], found["other"]) if name)
        point = np.array([float(value) for value in found.groups()[-3:]])
        label = "contact of the start" if at_start else f"contact of {part}"
        marks.append(Mark(label, point, part=part if at_start else ""))
    return tuple(marks)


def goal_marks(scenario: Scenario, contacts: Sequence[Mark] = ()) -> tuple[Mark, ...]:
    """Returns a mark for each goal that is a configuration.

    Args:
        scenario: The query.
        contacts: What such a configuration touches, where one was refused for it: its part is highlighted.
    """
    space, marks = ConfigurationSpace(scenario), []
    part = contacts[0].label.removeprefix("contact of ") if contacts else ""
    for number, goal in enumerate(scenario.goals, start=1):
        if not goal.is_configuration:
            continue
        label = "goal configuration" if len(scenario.goals) == 1 else f"configuration of goal {number}"
        row = space.row_of(goal)
        marks.append(configuration_mark(scenario, row, label, part))
    return tuple(marks)
