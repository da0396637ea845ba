"""What every picture of a result or a scenario shows, gathered once: meshes, shapes, goals, and numbers along time."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.body import RobotBody
from tdcr_planner.errors import FormatError
from tdcr_planner.planning.refusals import impossible_tip, missed_entries
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.report.body_mesh import tested_body
from tdcr_planner.report.marks import Mark, contact_marks, goal_marks, marks_of
from tdcr_planner.report.reference_poses import reference_shapes, reference_tensions
from tdcr_planner.robot import RobotSpec

if TYPE_CHECKING:
    from tdcr_planner.query.result import PlanResult

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DisplayMesh:
    """A mesh of the scene.

    Attributes:
        name: What the file is called.
        role: Name in `MESH_ROLES`.
        vertices: Shape (v, 3), m, world frame.
        faces: Shape (f, 3).
    """

    name: str
    role: str
    vertices: FloatArray
    faces: IntArray


@dataclass(frozen=True)
class GoalMark:
    """A goal of the scenario.

    Attributes:
        position: Where the tip is to be, shape (3,), m, world frame.
        tolerance: Largest distance from it, m; 0 for a goal that is a configuration.
        direction: Where the tip is to look, shape (3,), or None for any direction.
    """

    position: FloatArray
    tolerance: float
    direction: FloatArray | None


@dataclass(frozen=True)
class Picture:
    """A scene with a robot in k states.

    Attributes:
        title: What the scenario is called.
        status: How the query ended, or "scenario" for a scenario alone.
        message: The same for a person.
        scenario: The query.
        meshes: The scene.
        goals: The goals whose place is known.
        times: Shape (k,), s.
        positions: Disk centres, shape (k, d, 3), m, world frame; NaN where no shape is known.
        rotations: world_from_disk, shape (k, d, 3, 3).
        model_positions: Disk centres by the shape model, shape (k, d, 3), or None.
        model_name: Which model the search asked.
        tensions: Shape (k, t), N.
        insertion: Shape (k,), m.
        roll: Shape (k,), rad.
        clearance: Shape (k,), m; NaN where it is not known.
        deviation: Between reference and shape model, shape (k,), m; NaN where it is not known.
        has_path: False when the only state is the start.
        marks: What is pointed out besides: contacts, and configurations with a label.
        failed_state: Index of the state for which the reference does not verify the path; None where it does.
        failure: Why, in a word or two.
        in_view: Points that are to be in view besides, shape (n, 3), m, world frame.
    """

    title: str
    status: str
    message: str
    scenario: Scenario
    meshes: tuple[DisplayMesh, ...]
    goals: tuple[GoalMark, ...]
    times: FloatArray
    positions: FloatArray
    rotations: FloatArray
    model_positions: FloatArray | None
    model_name: str
    tensions: FloatArray
    insertion: FloatArray
    roll: FloatArray
    clearance: FloatArray
    deviation: FloatArray
    has_path: bool
    marks: tuple[Mark, ...] = ()
    failed_state: int | None = None
    failure: str = ""
    in_view: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    @property
    def robot(self) -> RobotSpec:
        """The scenario's robot."""
        return self.scenario.robot

    @property
    def required_clearance(self) -> float:
        """Clearance that the scenario asks for, m."""
        return self.scenario.required_clearance

    @property
    def known(self) -> BoolArray:
        """Which states have a shape to draw, shape (k,)."""
        placed = np.isfinite(self.positions).all(axis=(1, 2))
        return np.asarray(placed & np.isfinite(self.rotations).all(axis=(1, 2, 3)))

    @cached_property
    def body(self) -> RobotBody:
        """The solids that are tested against the meshes, without margins."""
        return tested_body(self.scenario)

    @property
    def contact(self) -> FloatArray | None:
        """The first place that is marked, shape (3,), m, world frame; None without one."""
        return next((mark.point for mark in self.marks if mark.point is not None), None)

    @property
    def worst_state(self) -> int | None:
        """Index of the state that fails, else of the state of least clearance; None when neither is known.

        Where the reference has no shape for the state that fails, it is the last state before it that has one.
        """
        if self.failed_state is not None:
            drawn = np.flatnonzero(self.known[: self.failed_state + 1])
            if len(drawn):
                return int(drawn[-1])
        return int(np.nanargmin(self.clearance)) if np.isfinite(self.clearance).any() else None

    @property
    def worst_label(self) -> str:
        """What the worst state is called: why it fails, and its clearance where that is known."""
        state = self.worst_state
        name = f"failing state ({self.failure})" if self.failure else "worst state"
        known = state is not None and np.isfinite(self.clearance[state])
        return f"{name}, {1e3 * self.clearance[state]:.2f} mm" if known else name

    def frame_states(self, most: int) -> IntArray:
        """Returns up to `most` states with a shape, spread evenly over the time; first, last and worst among them."""
        known = np.flatnonzero(self.known)
        if len(known) <= most:
            return known
        times = self.times[known]
        wanted = np.linspace(times[0], times[-1], most - 1)
        chosen = np.searchsorted(times, wanted - 1e-12).clip(0, len(known) - 1)
        worst = self.worst_state
        extra = [worst] if worst is not None and self.known[worst] else []
        return np.unique(np.concatenate([known[chosen], np.array(extra, dtype=np.int64)]))


def gather_picture(result: PlanResult, marks: Sequence[Mark] = ()) -> Picture:
    """Returns what a picture of a result shows; without a path, the scene with start, goal and what is in the way.

    Args:
        result: The answer to a query. What its `planner["marks"]` names is marked, see `marks.marks_of`.
        marks: What is to be marked besides.
    """
    path, report = result.path, result.verification
    marked = (*marks, *marks_of(result))
    if path is None or len(path) == 0:
        picture = gather_scenario_picture(result.scenario, result.status.value, result.message)
        at_goal = result.status.value == "invalid_goal"
        found = contact_marks(result.message, at_start=result.status.value == "invalid_start")
        return replace(picture, marks=(*marked, *goal_marks(result.scenario, found if at_goal else ()), *found))
    failed = report is not None and not report.verified
    robot, count = result.scenario.robot, len(path)
    unknown = np.full(count, np.nan)
    return Picture(
        title=_title(result.scenario),
        status=result.status.value,
        message=result.message,
        scenario=result.scenario,
        meshes=load_display_meshes(result.scenario),
        goals=_goal_marks(result.scenario),
        times=path.times,
        positions=np.full((count, robot.disk_count, 3), np.nan) if report is None else report.positions,
        rotations=np.full((count, robot.disk_count, 3, 3), np.nan) if report is None else report.rotations,
        model_positions=None if report is None else report.model_positions,
        model_name=result.scenario.planner.validity,
        tensions=path.tensions,
        insertion=path.insertion,
        roll=path.roll,
        clearance=unknown if report is None else report.clearance,
        deviation=unknown if report is None else report.deviation,
        has_path=True,
        marks=(*marked, *contact_marks(result.message)),
        failed_state=report.worst_state if report is not None and failed else None,
        failure=report.cause.replace("_", " ") if report is not None and failed else "",
    )


def gather_scenario_picture(scenario: Scenario, status: str = "scenario", message: str = "") -> Picture:
    """Returns what a picture of a scenario shows: the scene, the robot in its start state, and the goals."""
    space = ConfigurationSpace(scenario)
    start = scenario.file.start
    row = space.row_of(start)[None]
    positions, rotations = reference_shapes(scenario, row)
    unknown = np.full(1, np.nan)
    return Picture(
        title=_title(scenario),
        status=status,
        message=message,
        scenario=scenario,
        meshes=load_display_meshes(scenario),
        goals=_goal_marks(scenario),
        times=np.zeros(1),
        positions=positions,
        rotations=rotations,
        model_positions=None,
        model_name=scenario.planner.validity,
        tensions=reference_tensions(scenario, row),
        insertion=space.insertion(row),
        roll=space.roll(row),
        clearance=unknown,
        deviation=unknown,
        has_path=False,
    )


def with_start_checked(picture: Picture) -> Picture:
    """Returns the picture of a scenario with what the search would say of its start as message, and the contact marked.

    The search asks its own shape model, whose shape is drawn beside the reference's.

    Args:
        picture: From `gather_scenario_picture`. The clearance told is that of the shape in it.

    Raises:
        FormatError: A mesh or the shape model cannot be used.
        DomainError: The shape model does not know the scenario's loads.
    """
    from tdcr_planner.query.session import PlanningSession

    session = PlanningSession(picture.scenario)
    checker, start = session.checker(), picture.scenario.file.start
    row = session.space.row_of(start)
    model_positions, _, solved = checker.world_poses(row[None])
    clearance = np.full(1, np.nan)
    if picture.known.all():
        clearance = session.scene.clearance(picture.positions, picture.rotations)
    told = f"clearance {1e3 * clearance[0]:.1f} mm" if np.isfinite(clearance[0]) else "clearance not known"
    picture = replace(picture, clearance=clearance, model_positions=model_positions if solved.all() else None)
    problem = checker.explain(row)
    if not problem:
        remarks = [impossible_tip(checker, goal) for goal in picture.scenario.goals] + [missed_entries(checker)]
        doubts = "".join(f"; but {remark}" for remark in remarks if remark)
        return replace(picture, message=f"start: {'free' if doubts else 'valid'}, {told}{doubts}")
    shapes = checker.shapes(row[None])
    contact = None
    if shapes.codes[0] == 0:
        contact = checker.scene.first_contact(shapes.positions[0], shapes.rotations[0])
    marks: tuple[Mark, ...] = ()
    if contact is not None and np.isfinite(contact.point).all():
        marks = (Mark("contact of the start", contact.point, part=contact.part),)
    return replace(picture, message=f"start: not valid, {problem}", marks=marks)


def load_display_meshes(scenario: Scenario) -> tuple[DisplayMesh, ...]:
    """Returns the meshes of a scenario in metres and in the world frame, as they stand in their files.

    Raises:
        FormatError: A file cannot be read as a mesh.
    """
    meshes = []
    for entry, file, _ in scenario.surfaces:
        vertices, faces = entry.triangles(file)
        if not len(faces) or not np.isfinite(vertices).all():
            raise FormatError(file, "holds no triangles" if not len(faces) else "holds a vertex that is not finite")
        meshes.append(DisplayMesh(file.name, entry.role, vertices, faces))
    return tuple(meshes)


def _title(scenario: Scenario) -> str:
    return scenario.file.title or scenario.path.stem.removeprefix("scenario_").replace("_", " ")


def _goal_marks(scenario: Scenario) -> tuple[GoalMark, ...]:
    marks = []
    space = ConfigurationSpace(scenario)
    for goal in scenario.goals:
        if goal.tip_position_m is not None:
            direction = None
            if goal.view_direction is not None:
                direction = np.asarray(goal.view_direction) / np.linalg.norm(goal.view_direction)
            marks.append(GoalMark(np.asarray(goal.tip_position_m), goal.tip_tolerance_m, direction))
        elif goal.is_configuration:
            row = space.row_of(goal)[None]
            positions, _ = reference_shapes(scenario, row)
            if np.isfinite(positions).all():
                marks.append(GoalMark(positions[0, -1], 0.0, None))
            else:
                _log.warning("%s: the reference finds no shape for a goal; it is not drawn", scenario.path)
    return tuple(marks)
