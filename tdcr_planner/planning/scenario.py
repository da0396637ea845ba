"""The scenario: which robot, model, meshes, start, goal and planner a query is made of, read from TOML."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, field_validator, model_validator

from tdcr_planner.arrays import FloatArray
from tdcr_planner.bounds import ANGLE_DEG, LOAD, PLACE_M, SEARCH_SEED, TIME_S
from tdcr_planner.errors import FormatError, InputError, UnknownNameError
from tdcr_planner.files import (
    FileModel,
    NotNegative,
    Positive,
    Vector3,
    find_named_file,
    parse_table,
    read_toml,
    real_path,
    sha256_of_file,
)
from tdcr_planner.limits import snap
from tdcr_planner.planning.coordinates import drive_key
from tdcr_planner.planning.goal_kinds import GOAL_KINDS, GoalKind
from tdcr_planner.planning.inspect_table import InspectTable
from tdcr_planner.planning.objectives import Objective
from tdcr_planner.planning.surfaces import (
    CloudEntry,
    MeshEntry,
    SurfaceEntry,
    VolumeEntry,
    check_direction,
    check_one_of,
    place_names,
)
from tdcr_planner.planning.tolerance_table import ToleranceTable
from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.se3 import rotation_from_quaternion
from tdcr_planner.shape.registry import SHAPE_MODELS

# A range of insertion this many times as long as the robot was most likely given in millimetres.
LONGEST_TRAVEL = 20.0
MOST_MESHES = 1_000
"""Of a scene: each has a field of its own, of megabytes."""
MOST_GOALS = 1_000
"""Of a query: each is searched for by itself within the time limit."""

Place = Annotated[float, AfterValidator(PLACE_M.validate)]
Point = tuple[Place, Place, Place]
Angle = Annotated[float, AfterValidator(ANGLE_DEG.validate)]
Load = Annotated[float, AfterValidator(LOAD.validate)]
Loads = tuple[Load, Load, Load]
Length = Annotated[Positive, AfterValidator(PLACE_M.validate)]

# Lengths that a scenario leaves open, in radii of the robot's thinnest disk: 2 mm, 0.5 mm and 2 mm for disks of 20 mm.
STEP_IN_RADII = 0.2
CLEARANCE_IN_RADII = 0.05
TOLERANCE_IN_RADII = 0.2
SHORTEST_STEP_M, LONGEST_STEP_M = 1e-5, 0.1


def _check_rows(value: Any) -> Any:
    if isinstance(value, list | tuple) and not all(isinstance(row, list | tuple) for row in value):
        raise ValueError(f"expected a row [x, y] a segment, such as [[0.4, 0.0]], got {list(value)}")
    return value


Bending = Annotated[tuple[tuple[Load, Load], ...], BeforeValidator(_check_rows)]
DisplacedBending = Annotated[tuple[tuple[Place, Place], ...], BeforeValidator(_check_rows)]
DRIVE_KEYS = ("bending_n", "bending_m", "tendon_n", "tendon_m")
"""Keys of which a robot takes one, by its drive and its tendons; see `planning.coordinates`."""


def _check_validity(name: str) -> str:
    return check_one_of(name, SHAPE_MODELS.names())


Validity = Annotated[str, AfterValidator(_check_validity)]
"""Name of a shape model that is registered."""


class Base(FileModel):
    """Where the robot's base stands and how it may move.

    Attributes:
        position_m: Origin of the base frame at insertion 0, world frame.
        quaternion_wxyz: world_from_base rotation at roll 0; (1, 0, 0, 0) where neither it nor look_along is given.
        look_along: In place of the quaternion: direction of the base z axis, world frame.
        up: With look_along: direction of the base x axis, world frame, as near as it can be; where it is left out, the
            axis of the world that is farthest from look_along, z before y before x.
        insertion_m: Range of travel along the base z axis, or None for a fixed base.
        roll_deg: Range of rotation about the base z axis, or None for none.
        shaft_radius_m: Radius of the straight shaft that follows the base as it is inserted; None to leave it out of
            the collision test.
    """

    position_m: Point = (0.0, 0.0, 0.0)
    quaternion_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    look_along: Vector3 | None = None
    up: Vector3 | None = None
    insertion_m: tuple[Place, Place] | None = None
    roll_deg: tuple[Angle, Angle] | None = None
    shaft_radius_m: Length | None = None

    @field_validator("quaternion_wxyz")
    @classmethod
    def _check_quaternion(cls, value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        if np.linalg.norm(value) < 1e-9:
            raise ValueError(f"expected a quaternion of length above 0, got {list(value)}")
        return value

    _check_look = field_validator("look_along", "up")(check_direction)

    @model_validator(mode="after")
    def _check_orientation(self) -> Base:
        if self.look_along is None:
            if self.up is not None:
                raise ValueError("up needs look_along, the direction of the base z axis")
            return self
        if "quaternion_wxyz" in self.model_fields_set:
            raise ValueError("expected either quaternion_wxyz or look_along, got both")
        if self.up is not None:
            along, up = (np.asarray(v) / np.linalg.norm(v) for v in (self.look_along, self.up))
            if np.linalg.norm(np.cross(along, up)) < 1e-6:
                raise ValueError(f"up must not point along look_along, got {list(self.up)} and {list(self.look_along)}")
        return self

    def facts(self) -> dict[str, Any]:
        """Returns what the table says, as JSON has it, without look_along and up where they are not given."""
        left_out = {key for key in ("look_along", "up") if getattr(self, key) is None}
        return self.model_dump(mode="json", exclude=left_out)

    @property
    def rotation(self) -> FloatArray:
        """world_from_base at roll 0, shape (3, 3)."""
        if self.look_along is None:
            return rotation_from_quaternion(self.quaternion_wxyz)
        z = np.asarray(self.look_along) / np.linalg.norm(self.look_along)
        # Of equally far axes the last is taken: z before y before x.
        up = np.eye(3)[2 - int(np.argmin(np.round(np.abs(z[::-1]), 9)))] if self.up is None else np.asarray(self.up)
        x = up - (up @ z) * z
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(z, x), z], axis=1)

    @field_validator("insertion_m", "roll_deg")
    @classmethod
    def _check_range(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] >= value[1]:
            raise ValueError(f"expected a range [low, high] with low below high, got {list(value)}")
        return value


class Start(FileModel):
    """The configuration in which the robot starts: bending_n a row a segment, insertion_m, roll_deg.

    A robot driven by displacement takes bending_m in place of bending_n, one without bending vectors tendon_n or
    tendon_m, a number a tendon. Without any of them all are zero: the robot is straight but for its loads and rest
    curvature. In a scenario file the word "straight" in place of the table says the same, at insertion and roll 0.
    """

    bending_n: Bending = ()
    bending_m: DisplacedBending = ()
    tendon_n: tuple[Load, ...] = ()
    tendon_m: tuple[Place, ...] = ()
    insertion_m: Place = 0.0
    roll_deg: Angle = 0.0


class Goal(FileModel):
    """What is to be reached: a configuration, or a tip position with or without a viewing direction.

    Attributes:
        bending_n: Bending vector of each segment, N; with insertion_m and roll_deg a goal configuration.
        bending_m: The same of displacement, m at the tendon circle, for robots driven by displacement.
        tendon_n: The tension of each tendon, N, for robots without bending vectors.
        tendon_m: The displacement of each tendon, m, for robots driven by displacement without bending vectors.
        insertion_m: Insertion of a goal configuration.
        roll_deg: Roll of a goal configuration.
        tip_position_m: Goal of the last disk's centre, world frame.
        tip_tolerance_m: Largest distance from it; by default a fifth of the robot's smallest disk radius.
        view_direction: Direction of the tip's z axis, world frame; None for any.
        view_tolerance_deg: Largest angle from it.
    """

    bending_n: Bending | None = None
    bending_m: DisplacedBending | None = None
    tendon_n: tuple[Load, ...] | None = None
    tendon_m: tuple[Place, ...] | None = None
    insertion_m: Place = 0.0
    roll_deg: Angle = 0.0
    tip_position_m: Point | None = None
    tip_tolerance_m: Length = 0.002
    view_direction: Vector3 | None = None
    view_tolerance_deg: Annotated[float, Field(gt=0.0, le=180.0)] = 10.0

    _check_view = field_validator("view_direction")(check_direction)

    @model_validator(mode="after")
    def _check_kind(self) -> Goal:
        stated = {name for name, value in self if value is not None}
        kinds = [kind for kind in GOAL_KINDS if stated & kind.keys]
        if len(kinds) != 1 or len(stated & kinds[0].keys) != 1:
            raise ValueError(f"expected exactly one of {' and '.join(kind.key for kind in GOAL_KINDS)}")
        given = self.model_fields_set
        foreign = {key for kind in GOAL_KINDS for key in kind.other_keys} - kinds[0].other_keys
        if given & foreign:
            names = ", ".join(sorted(given & foreign))
            raise ValueError(f"{names} does not belong to a goal that is {kinds[0].title}")
        if "view_tolerance_deg" in given and self.view_direction is None:
            raise ValueError("view_tolerance_deg needs a view_direction")
        return self

    @property
    def kind(self) -> GoalKind:
        """What kind of goal it is."""
        stated = {name for name, value in self if value is not None}
        return next(kind for kind in GOAL_KINDS if stated & kind.keys)

    @property
    def is_configuration(self) -> bool:
        """Whether it is a configuration, so that `ConfigurationSpace.row_of` gives its row."""
        return any(getattr(self, key) is not None for key in DRIVE_KEYS)


class PlannerSettings(FileModel):
    """How to search.

    Attributes:
        name: Planner by its name in `planning.planners`.
        time_limit_s: Time for search, verification and repair together.
        seed: Seed of the search, above 0.
        step_m: No point of the body moves farther between two checked states; in a scenario that does not state it, a
            fifth of the robot's smallest disk radius.
        clearance_m: Distance kept from every surface on top of the model's error bound; in a scenario that does not
            state it, a twentieth of the robot's smallest disk radius.
        validity: The shape model that the search asks, by its name in `shape.registry`.
        parameters: The planner's own parameters by name.
        objective: What an optimising planner minimises.
        success_probability: Probability with which the path is to be verified on a robot within the scenario's
            tolerances; None to plan for the robot as its file has it.
    """

    name: str = "RRTConnect"
    time_limit_s: Annotated[float, AfterValidator(TIME_S.validate)] = 10.0
    seed: Annotated[int, AfterValidator(SEARCH_SEED.validate)] = 1
    step_m: Annotated[float, Field(ge=SHORTEST_STEP_M, le=LONGEST_STEP_M)] = 0.002
    clearance_m: Annotated[NotNegative, AfterValidator(PLACE_M.validate)] = 0.0005
    validity: Validity = "learned"
    shape_engine: Literal["compiled", "torchscript", "onnx"] | None = None
    shape_device: Literal["cpu", "cuda"] = "cpu"
    error_bound: Literal["state", "uniform"] = "state"
    parameters: dict[str, str | float | int | bool] = {}
    objective: Objective = Objective()
    success_probability: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None


class Limits(FileModel):
    """Rates and accelerations that bound the time along a path.

    Attributes:
        tension_rate_n_s: Largest rate of each tendon tension.
        insertion_speed_m_s: Largest insertion speed.
        roll_speed_deg_s: Largest roll speed.
        tension_acceleration_n_s2: Largest second derivative of each tendon tension; None for no limit.
        insertion_acceleration_m_s2: Largest acceleration of the insertion; None for no limit.
        roll_acceleration_deg_s2: Largest acceleration of the roll; None for no limit.
    """

    tension_rate_n_s: Positive = 1.0
    insertion_speed_m_s: Positive = 0.02
    roll_speed_deg_s: Positive = 45.0
    tension_acceleration_n_s2: Positive | None = None
    insertion_acceleration_m_s2: Positive | None = None
    roll_acceleration_deg_s2: Positive | None = None

    @property
    def accelerations(self) -> bool:
        """Whether any acceleration is limited, so that the speed along a path may not jump."""
        return any(
            value is not None
            for value in (
                self.tension_acceleration_n_s2,
                self.insertion_acceleration_m_s2,
                self.roll_acceleration_deg_s2,
            )
        )


class FrictionTable(FileModel):
    """How friction counts in verification.

    Attributes:
        verify: "all" for every friction state that is tried, whatever the motion before.
    """

    verify: Literal["all"] = "all"


class ScenarioFile(FileModel):
    """The content of a scenario file, as FORMATS has it."""

    format: Literal["tdcr-scenario/1"]
    robot: str
    shape_model: str | None = None
    gravity_m_s2: Loads = (0.0, 0.0, 0.0)
    tip_force_n: Loads = (0.0, 0.0, 0.0)
    meshes: Annotated[tuple[MeshEntry, ...], Field(max_length=MOST_MESHES)] = ()
    volumes: Annotated[tuple[VolumeEntry, ...], Field(max_length=MOST_MESHES)] = ()
    clouds: Annotated[tuple[CloudEntry, ...], Field(max_length=MOST_MESHES)] = ()
    base: Base = Base()
    start: Start
    goal: Goal | None = None
    goals: Annotated[tuple[Goal, ...], Field(max_length=MOST_GOALS)] | None = None
    goal_order: Literal["given", "best"] = "given"
    planner: PlannerSettings = PlannerSettings()
    limits: Limits = Limits()
    inspect: InspectTable | None = None
    tolerances: ToleranceTable | None = None
    friction: FrictionTable | None = None
    expected_status: Literal["verified", "unverified", "no_path", "invalid_start", "invalid_goal"] = "verified"
    title: str = ""

    @field_validator("start", mode="before")
    @classmethod
    def _check_start(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value != "straight":
                raise ValueError(f"expected a table with bending_n, or the word 'straight', got {value!r}")
            return {}
        return value

    @property
    def surfaces(self) -> tuple[SurfaceEntry, ...]:
        """Everything that the body must keep off: meshes, volumes and clouds, in this order."""
        return (*self.meshes, *self.volumes, *self.clouds)

    @model_validator(mode="after")
    def _check_surfaces(self) -> ScenarioFile:
        if not self.surfaces:
            raise ValueError("meshes: missing; expected one or more of [[meshes]], [[volumes]] and [[clouds]]")
        return self

    @model_validator(mode="after")
    def _check_goals(self) -> ScenarioFile:
        if self.goal is not None and self.goals is not None:
            raise ValueError("expected either one [goal] or a list of [[goals]]")
        if self.goal is None and self.goals is None and self.inspect is None:
            raise ValueError("expected one [goal] or a list of [[goals]], or what to [inspect]")
        if self.goals is not None and not self.goals:
            raise ValueError("goals: expected one or more, got none")
        validity = self.planner.validity
        if self.shape_model is None and SHAPE_MODELS.find(validity).needs_file:
            raise ValueError(f"shape_model: missing, and planner.validity = {validity!r} needs it")
        return self


@dataclass(frozen=True)
class Scenario:
    """A scenario whose robot is loaded and whose paths are absolute.

    Attributes:
        path: The scenario file, absolute.
        sha256: Hash of its bytes.
        file: Its content.
        robot: The robot that it names.
        surface_error: Largest distance of a surface as it is tested from the true one, m: of voxels, of a tessellated
            solid, of points with a radius. It is added to the clearance that the scenario asks for.
    """

    path: Path
    sha256: str
    file: ScenarioFile
    robot: RobotSpec
    surface_error: float = 0.0

    @property
    def planner(self) -> PlannerSettings:
        """How to search."""
        return self.file.planner

    @property
    def required_clearance(self) -> float:
        """Distance that the body keeps from every surface as it is tested, m."""
        return self.planner.clearance_m + self.surface_error

    @property
    def surfaces(self) -> list[tuple[SurfaceEntry, Path, str]]:
        """Each surface of the scene with its file, absolute, and its key in the scenario file."""
        entries = self.file.surfaces
        places = place_names(entries)
        return [(entry, self.resolve(entry.file), place) for entry, place in zip(entries, places, strict=True)]

    @property
    def goals(self) -> tuple[Goal, ...]:
        """The goals in the file's order; none where the scenario only says what to inspect."""
        if self.file.goals is not None:
            return self.file.goals
        return () if self.file.goal is None else (self.file.goal,)

    @property
    def gravity(self) -> FloatArray:
        """Gravity, shape (3,), m/s^2, world frame."""
        return np.asarray(self.file.gravity_m_s2, dtype=np.float64)

    @property
    def tip_force(self) -> FloatArray:
        """Force at the tip, shape (3,), N, world frame."""
        return np.asarray(self.file.tip_force_n, dtype=np.float64)

    @property
    def base_position(self) -> FloatArray:
        """Origin of the base frame at insertion 0, shape (3,), m, world frame."""
        return np.asarray(self.file.base.position_m, dtype=np.float64)

    @property
    def base_rotation(self) -> FloatArray:
        """world_from_base at roll 0, shape (3, 3)."""
        return self.file.base.rotation

    @property
    def shape_model_path(self) -> Path | None:
        """The shape model's file, absolute; None when the scenario names none."""
        return None if self.file.shape_model is None else self.resolve(self.file.shape_model)

    def resolve(self, relative: str) -> Path:
        """Returns the absolute path of a file that the scenario names."""
        return real_path(self.path.parent / relative)

    def with_planner(self, **changes: Any) -> Scenario:
        """Returns the scenario with some planner settings replaced, for example seed=3 or validity="reference".

        Raises:
            InputError: There is no such setting, or it cannot have that value.
        """
        try:
            settings = PlannerSettings.model_validate({**self.planner.model_dump(), **changes})
        except ValidationError as error:
            fault = error.errors()[0]
            name = ".".join(str(item) for item in fault["loc"])
            if fault["type"] == "extra_forbidden":
                raise UnknownNameError("planner", name, PlannerSettings.model_fields) from error
            expected = str(fault["msg"]).removeprefix("Input should be ").removeprefix("Value error, expected ")
            raise InputError(f"planner.{name}", expected.partition(", got ")[0], repr(fault["input"])) from error
        return replace(self, file=self.file.model_copy(update={"planner": settings}))


def load_scenario(path: str | Path) -> Scenario:
    """Returns the scenario that a TOML file describes, with its robot.

    Raises:
        FormatError: The file, the robot or a named file is missing or not what it should be.
    """
    file = real_path(path)
    content = parse_table(ScenarioFile, read_toml(path), path)
    if ":" in content.planner.name:
        # Importing a module runs it: who opens a scenario has not asked for that.
        problem = f"expected a planner's name, got {content.planner.name!r}: module:function goes on the command line"
        raise FormatError(path, problem, "planner.name")
    robot = load_robot(find_named_file(file.parent / content.robot, path, "robot"))
    scenario = Scenario(file, sha256_of_file(file), _sized_for(robot, content), robot)
    _check_against_robot(scenario)
    errors = [0.0]
    for surface, named, place in scenario.surfaces:
        _check_named(surface, named, path, place)
        errors.append(surface.error(named))
    if content.shape_model is not None:
        find_named_file(file.parent / content.shape_model, path, "shape_model", "; `tdcr train` makes one")
    return replace(scenario, surface_error=max(errors))


def _check_named(surface: SurfaceEntry, named: Path, path: str | Path, place: str) -> None:
    """Raises FormatError, naming the scenario's key, where a surface's file is missing."""
    if not named.is_dir():
        find_named_file(named, path, f"{place}.file")
    surface.check_file(named)


def _sized_for(robot: RobotSpec, content: ScenarioFile) -> ScenarioFile:
    """Returns a scenario's content with the lengths that it leaves open sized for its robot.

    What counts is how the lengths compare with the robot's thinnest disk: what is fine for a robot of 20 mm is most of
    the lumen for one of 3 mm.
    """
    radius = min(segment.disk_radius_m for segment in robot.segments)
    lengths = {
        "step_m": min(max(STEP_IN_RADII * radius, SHORTEST_STEP_M), LONGEST_STEP_M),
        "clearance_m": CLEARANCE_IN_RADII * radius,
    }
    open_lengths = {key: value for key, value in lengths.items() if key not in content.planner.model_fields_set}

    def sized(goal: Goal) -> Goal:
        if goal.tip_position_m is None or "tip_tolerance_m" in goal.model_fields_set:
            return goal
        return goal.model_copy(update={"tip_tolerance_m": TOLERANCE_IN_RADII * radius})

    return content.model_copy(
        update={
            "planner": content.planner.model_copy(update=open_lengths),
            "start": _filled_start(robot, content.start),
            "goal": None if content.goal is None else sized(content.goal),
            "goals": None if content.goals is None else tuple(sized(goal) for goal in content.goals),
        }
    )


def _filled_start(robot: RobotSpec, start: Start) -> Start:
    """Returns a start that states the robot's drive coordinates, zeros where it says nothing of the drive."""
    key = drive_key(robot)
    if any(getattr(start, name) for name in DRIVE_KEYS):
        return start
    rest = ((0.0, 0.0),) * robot.segment_count if key.startswith("bending") else (0.0,) * robot.tendon_count
    return start.model_copy(update={key: rest})


def _check_drive_key(scenario: Scenario, state: Start | Goal, place: str) -> None:
    """Refuses drive coordinates that are not the robot's, or not as many."""
    robot, key = scenario.robot, drive_key(scenario.robot)
    for name in DRIVE_KEYS:
        if name != key and getattr(state, name):
            driven = (
                f"driven by {robot.drive.kind} {'with' if key.startswith('bending') else 'without'} bending vectors"
            )
            problem = f"expected {key}, since robot {robot.name!r} is {driven}, got {name}"
            raise FormatError(scenario.path, problem, f"{place}.{name}")
    rows = getattr(state, key)
    kind, count = ("segment", robot.segment_count) if key.startswith("bending") else ("tendon", robot.tendon_count)
    if len(rows) != count:
        expected = f"expected {count} {'rows' if kind == 'segment' else 'numbers'}, one for each {kind} of robot"
        raise FormatError(scenario.path, f"{expected} {robot.name!r}, got {len(rows)}", f"{place}.{key}")


def _check_travel(scenario: Scenario) -> None:
    """Refuses a range of insertion that is far too long for the robot."""
    low, high = scenario.file.base.insertion_m or (0.0, 0.0)
    ratio = (high - low) / scenario.robot.length
    if ratio > LONGEST_TRAVEL:
        raise FormatError(
            scenario.path,
            f"a travel of {high - low:g} m is {ratio:.0f} times the robot's length of {scenario.robot.length:g} m, "
            f"expected {LONGEST_TRAVEL:g} times at most; metres are meant",
            "base.insertion_m",
        )


def _check_against_robot(scenario: Scenario) -> None:
    base = scenario.file.base
    _check_travel(scenario)
    states: list[tuple[str, Start | Goal]] = [("start", scenario.file.start)]
    for index, goal in enumerate(scenario.goals):
        if goal.is_configuration:
            states.append(("goal" if scenario.file.goals is None else f"goals[{index + 1}]", goal))
    for place, state in states:
        _check_drive_key(scenario, state, place)
        ranges = (("insertion_m", state.insertion_m, base.insertion_m), ("roll_deg", state.roll_deg, base.roll_deg))
        for key, value, allowed in ranges:
            low, high = allowed if allowed is not None else (0.0, 0.0)
            if not low <= snap(value, low, high) <= high:
                reason = f"the range of [base] {key} is [{low}, {high}]" if allowed else f"[base] has no {key} range"
                raise FormatError(scenario.path, f"got {value}, but {reason}", f"{place}.{key}")
