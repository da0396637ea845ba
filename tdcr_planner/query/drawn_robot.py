"""Drawn robots: robots within tolerances, mounted within tolerances, that carry out what the nominal one is told."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import Actuation, ConfigurationSpace
from tdcr_planner.query.environment import Environment
from tdcr_planner.query.tolerances import Tolerances
from tdcr_planner.query.verification import Verifier
from tdcr_planner.robot import RobotSpec

_TRIES = 20  # draws that give no possible robot, one after the other, before the tolerances are refused


@dataclass(frozen=True)
class Registration:
    """Where the surfaces really are: moved, turned and scaled about a point.

    Attributes:
        centre: Shape (3,), m, world frame.
        shift: Shape (3,), m.
        rotation: Shape (3, 3).
        scale: Factor on all lengths of the surfaces.
    """

    centre: FloatArray
    shift: FloatArray
    rotation: FloatArray
    scale: float = 1.0


@dataclass(frozen=True)
class _RegisteredActuation(Actuation):
    """Configurations whose shapes are told in the frame of the surfaces, as the scene's meshes have it."""

    registration: Registration | None = None

    def in_world(self, positions: FloatArray, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
        placed, frames = super().in_world(positions, rotations)
        found = self.registration
        assert found is not None  # made with one
        moved = (placed - found.centre - found.shift) @ found.rotation / found.scale + found.centre
        return moved, found.rotation.T @ frames


class DrawnRobot(ConfigurationSpace):
    """A scenario's configurations as one drawn robot carries them out: its own base, robot, gains and surfaces."""

    def __init__(
        self,
        nominal: Scenario,
        drawn: Scenario,
        gains: FloatArray,
        offsets: FloatArray,
        registration: Registration | None,
    ) -> None:
        """Prepares the space.

        Args:
            nominal: The scenario as its files have it: what is commanded follows from it.
            drawn: The scenario with the drawn robot and base.
            gains: From commanded to real tensions (displacements), shape (t,).
            offsets: Real tensions (displacements) where none are commanded, shape (t,), N (m).
            registration: Where the surfaces are; None for where the files have them.
        """
        super().__init__(drawn)
        self._commanded = ConfigurationSpace(nominal)
        self._gains, self._offsets, self._registration = gains, offsets, registration

    def actuate(self, rows: FloatArray) -> Actuation:
        """Returns what configurations mean for the drawn robot; see `ConfigurationSpace.actuate`."""
        real = self._commanded.actuate(rows).tensions * self._gains + self._offsets
        if self.robot.drive.kind == "tension":
            real = np.maximum(real, 0.0)
        found = replace(super().actuate(rows), tensions=real)
        if self._registration is None:
            return found
        parts = (found.tensions, found.gravity, found.tip_force, found.base_positions, found.base_rotations)
        return _RegisteredActuation(*parts, registration=self._registration)

    def verifier(self, environment: Environment, query: Scenario, *, measure: bool = True) -> Verifier:
        """Returns a verifier of this robot's paths in an environment, for a query in it.

        Surfaces of another size are judged as the files have them, everything else in proportion. The body's own
        radii are not resized but allowed for: in smaller surfaces by the whole radius of the largest disk.
        """
        scale = 1.0 if self._registration is None else self._registration.scale
        swollen = max(1.0 - scale, 0.0) * float(self.robot.disk_radii.max())
        return Verifier(
            self,
            environment.scene,
            step=query.planner.step_m / scale,
            clearance=(query.required_clearance + swollen) / scale,
            # A scene is grown once for each clearance: not for one a robot.
            measure=measure or scale != 1.0,
        )


def draw_robot(
    environment: Environment, tolerances: Tolerances, seed: tuple[int, ...], query: Scenario | None = None
) -> DrawnRobot:
    """Returns one robot within the tolerances, mounted within the tolerances.

    The same seed gives the same deviations in units of the tolerances, so that tolerances can be compared.

    Args:
        environment: The scene.
        tolerances: What to vary and how far.
        seed: Of the draw.
        query: A scenario in the scene; None for the environment's own.

    Raises:
        InputError: The tolerances are so large that hardly any robot is possible.
    """
    scenario = query or environment.scenario
    generator = np.random.default_rng(list(seed))
    for _ in range(_TRIES):
        try:
            return _draw(environment, scenario, tolerances, generator)
        except (ValidationError, InputError) as error:
            problem = error
    raise InputError("tolerances", f"tolerances that leave a robot possible ({problem})", dict(tolerances.items()))


def _draw(
    environment: Environment, scenario: Scenario, tolerances: Tolerances, generator: np.random.Generator
) -> DrawnRobot:
    normal, count = generator.standard_normal, scenario.robot.tendon_count
    stiffness = float(np.exp(tolerances.youngs_modulus * normal()))
    mass = float(np.exp(tolerances.mass * normal()))
    is_tension = scenario.robot.drive.kind == "tension"
    gain, offset = (
        (tolerances.tension, tolerances.tension_offset_n)
        if is_tension
        else (tolerances.displacement, tolerances.displacement_offset_m)
    )
    gains = np.exp(gain * normal(count))
    position = scenario.base_position + tolerances.base_position_m * normal(3)
    tilt = Rotation.from_rotvec(np.deg2rad(tolerances.base_angle_deg) * normal(3))
    x, y, z, w = (Rotation.from_matrix(scenario.base_rotation) * tilt).as_quat()
    moved = scenario.file.base.model_copy(
        update={"position_m": tuple(position), "quaternion_wxyz": (w, x, y, z), "look_along": None, "up": None}
    )
    offsets = offset * normal(count)
    segments = scenario.robot.segment_count
    sizes = np.exp(tolerances.length * normal(segments)), np.exp(tolerances.tendon_circle * normal(segments))
    angles = tolerances.tendon_angle_deg * normal(count)
    friction = float(np.exp(tolerances.friction * normal()))
    registration = _register(environment, tolerances, normal(7))
    robot = scenario.robot.scaled(stiffness=stiffness, mass=mass)
    if tolerances.length or tolerances.tendon_circle or tolerances.tendon_angle_deg or tolerances.friction:
        robot = _resized(robot, *sizes, angles, friction)
    # The limits bind the commands, whatever tensions come of them.
    if is_tension:
        real = scenario.robot.max_tensions * gains + np.maximum(offsets, 0.0)
        robot = robot.with_tension_limits_times(max(float((real / scenario.robot.max_tensions).max()), 1.0))
    file = scenario.file.model_copy(update={"base": moved})
    return DrawnRobot(scenario, replace(scenario, file=file, robot=robot), gains, offsets, registration)


def _register(environment: Environment, tolerances: Tolerances, normal: FloatArray) -> Registration | None:
    """Returns where the surfaces are, from seven normal numbers; None where that does not vary."""
    if not (tolerances.mesh_position_m or tolerances.mesh_angle_deg or tolerances.mesh_scale):
        return None
    points = np.concatenate([mesh.vertices for mesh in environment.meshes])
    return Registration(
        centre=0.5 * (points.min(axis=0) + points.max(axis=0)),
        shift=tolerances.mesh_position_m * normal[:3],
        rotation=Rotation.from_rotvec(np.deg2rad(tolerances.mesh_angle_deg) * normal[3:6]).as_matrix(),
        scale=float(np.exp(tolerances.mesh_scale * normal[6])),
    )


def _resized(
    robot: RobotSpec, lengths: FloatArray, circles: FloatArray, angles: FloatArray, friction: float
) -> RobotSpec:
    """Returns a robot with segments' lengths and tendon circles, and friction, times factors, and angles turned.

    Args:
        robot: The robot.
        lengths: A factor a segment, shape (segments,).
        circles: A factor a segment, shape (segments,).
        angles: Added to each tendon's angle, shape (t,), degrees.
        friction: Factor on the friction coefficients.
    """
    segments, first = [], 0
    for segment, length, circle in zip(robot.segments, lengths.tolist(), circles.tolist(), strict=True):
        changes: dict[str, Any] = {"length_m": length * segment.length_m}
        if segment.disk_positions_m is not None:
            changes["disk_positions_m"] = tuple(length * place for place in segment.disk_positions_m)
        if segment.tendon_angles_deg is not None and segment.tendon_circle_radius_m is not None:
            last = first + len(segment.tendon_angles_deg)
            changes["tendon_circle_radius_m"] = circle * segment.tendon_circle_radius_m
            changes["tendon_angles_deg"] = tuple((np.array(segment.tendon_angles_deg) + angles[first:last]).tolist())
            first = last
        segments.append(segment.model_copy(update=changes))
    update: dict[str, Any] = {"segments": segments}
    if robot.tendon_tables:
        update["tendons"] = [
            table.model_copy(
                update={
                    "angle_deg": None if table.angle_deg is None else table.angle_deg + float(turn),
                    "radius_m": None if table.radius_m is None else table.radius_m * float(circles[tendon.segment]),
                    "friction_coefficient": table.friction_coefficient * friction,
                }
            )
            for table, tendon, turn in zip(robot.tendon_tables, robot.tendons, angles, strict=True)
        ]
    return robot.model_copy(update=update)
