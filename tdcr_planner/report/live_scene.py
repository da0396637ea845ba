"""What one hand-set state of a robot looks like in its scene: its shape, what it touches, and what the planner says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.scene import CollisionScene, Contact, Verdict
from tdcr_planner.errors import DomainError
from tdcr_planner.planning.causes import CAUSES
from tdcr_planner.planning.robot_limits import RobotLimits
from tdcr_planner.planning.scenario import Validity
from tdcr_planner.planning.validity import planning_margins
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.robot import refuse_unknown
from tdcr_planner.shape.base import ShapeModel
from tdcr_planner.shape.registry import SHAPE_MODELS

_NAMED_CONTACTS = 6


@dataclass(frozen=True)
class Controls:
    """What a person sets by hand.

    Attributes:
        tensions: Shape (t,), N, in the robot file's order.
        insertion: Travel of the base along its z axis, m.
        roll: Turn of the base about its z axis, rad.
    """

    tensions: FloatArray
    insertion: float
    roll: float


@dataclass(frozen=True)
class Look:
    """What one state looks like.

    Attributes:
        positions: Disk centres, shape (d, 3), m, world frame; NaN where there is no shape.
        rotations: world_from_disk, shape (d, 3, 3).
        clearance: Of the body without margins, m; negative where it touches; NaN where there is no shape.
        asked_clearance: What the planner keeps with this model, m: the largest margin of any disk.
        contacts: What the body without margins touches, tip first.
        near: What keeps the planner away although nothing is touched: the first contact of the body with its margins.
        problem: Why there is no shape, or which limit of the robot the shape breaks; empty otherwise.
    """

    positions: FloatArray
    rotations: FloatArray
    clearance: float
    asked_clearance: float
    contacts: tuple[Contact, ...] = ()
    near: Contact | None = None
    problem: str = ""

    @property
    def has_shape(self) -> bool:
        """Whether there is a shape to draw."""
        return bool(np.isfinite(self.positions).all())

    @property
    def allowed(self) -> bool:
        """Whether the planner would accept the state."""
        return not (self.contacts or self.near or self.problem)


class LiveScene:
    """A scene in which single states are asked for, with any tensions and any of the shape models.

    Attributes:
        session: The scene, its robot and its models.
        models: Names of the shape models that the scenario can use.
    """

    def __init__(self, session: PlanningSession) -> None:
        """Prepares the scene; a shape model is loaded at its first use.

        Raises:
            InputError: The robot has what the live view's sliders do not know.
        """
        self.session = session
        self.robot = session.scenario.robot
        refuse_unknown(self.robot, (), "the live view")
        has_file = session.scenario.shape_model_path is not None
        self.models = tuple(name for name, kind in SHAPE_MODELS.usable() if has_file or not kind.needs_file)
        self._limits = RobotLimits(self.robot)
        self._bare = session.scene.with_margins(np.zeros(self.robot.disk_count))
        self._grown: dict[Validity, CollisionScene] = {}

    @property
    def start(self) -> Controls:
        """The scenario's start state."""
        start = self.session.scenario.file.start
        tensions = self.robot.tensions_from_bending(np.array([start.bending_n]))[0]
        return Controls(tensions, start.insertion_m, float(np.deg2rad(start.roll_deg)))

    def with_bending(self, controls: Controls, bending: FloatArray) -> Controls:
        """Returns the same base with the tensions of least sum for bending vectors (segments, 2), N, cut at the limits.

        Cutting at the limit leaves a shorter bending vector of a slightly other direction.
        """
        tensions = self.robot.tensions_from_bending(bending[None])[0]
        return Controls(np.minimum(tensions, self.robot.max_tensions), controls.insertion, controls.roll)

    def bending(self, controls: Controls) -> FloatArray:
        """Returns the bending vectors that tensions stand for, shape (segments, 2), N."""
        return self.robot.bending_from_tensions(controls.tensions[None])[0]

    def look(self, controls: Controls, name: Validity) -> Look:
        """Returns what a state looks like by one of the shape models, and what it touches."""
        model = self.session.model(name)
        positions, rotations, problem = self.shape(controls, name)
        asked = float(planning_margins(self.session.scenario, model).max())
        if problem:
            return Look(positions, rotations, float("nan"), asked, problem=problem)
        contacts = tuple(self._bare.contacts(positions, rotations))
        near = None if contacts else self._grown_scene(name, model).first_contact(positions, rotations)
        clearance = float(self._bare.clearance(positions[None], rotations[None])[0])
        problem = self._broken_limit(controls, rotations)
        return Look(positions, rotations, clearance, asked, contacts, near, problem)

    def shape(self, controls: Controls, name: Validity) -> tuple[FloatArray, FloatArray, str]:
        """Returns disk poses in the world frame by one of the shape models, or NaN poses and why there are none.

        Returns:
            Positions, shape (d, 3), m, rotations, shape (d, 3, 3), and a sentence, empty where there is a shape.
        """
        space = self.session.space
        straight = ((0.0, 0.0),) * self.robot.segment_count
        row = space.row(straight, controls.insertion, float(np.rad2deg(controls.roll)))[None]
        actuation = space.actuate(row)
        disks = self.robot.disk_count
        unknown = np.full((disks, 3), np.nan), np.full((disks, 3, 3), np.nan)
        try:
            poses = self.session.model(name).disk_poses(
                controls.tensions[None], gravity=actuation.gravity, tip_force=actuation.tip_force
            )
        except DomainError as error:
            return *unknown, f"outside of the {name.replace('_', ' ')} model's domain: {error}"
        if not poses.solved[0]:
            return *unknown, f"the {name.replace('_', ' ')} model finds no shape for these tensions and loads"
        positions, rotations = actuation.in_world(poses.positions, poses.rotations)
        return positions[0], rotations[0], ""

    def _grown_scene(self, name: Validity, model: ShapeModel) -> CollisionScene:
        if name not in self._grown:
            self._grown[name] = self.session.scene.with_margins(planning_margins(self.session.scenario, model))
        return self._grown[name]

    def _broken_limit(self, controls: Controls, rotations: FloatArray) -> str:
        code = int(self._limits.check(controls.tensions[None], rotations[None])[0])
        return "" if code == 0 else f"breaks a limit of the robot: {CAUSES[code - 1].value.replace('_', ' ')}"


def describe(look: Look) -> tuple[str, list[str]]:
    """Returns a state's verdict in a few words, and sentences on what is touched, what is broken and the clearance."""
    if not look.has_shape:
        return "no shape", [look.problem]
    head, lines = "free", []
    if look.contacts:
        first = look.contacts[0]
        head = "wrong side" if first.triangle < 0 else "touching"
        if first.verdict is Verdict.SELF:
            head = "touching itself"
        lines.append(str(first))
        others = [contact.part for contact in look.contacts[1:]]
        if others:
            more = f" and {len(others) - _NAMED_CONTACTS} more" if len(others) > _NAMED_CONTACTS else ""
            lines.append("also " + ", ".join(others[:_NAMED_CONTACTS]) + more)
    elif look.near is not None:
        head = "too near"
        lines.append(f"with the planner's margin {look.near}")
    if look.problem:
        head = head if head != "free" else "limit"
        lines.append(look.problem)
    if np.isfinite(look.clearance):
        lines.append(f"clearance {1e3 * look.clearance:.2f} mm; the planner keeps {1e3 * look.asked_clearance:.2f} mm")
    return head, lines
