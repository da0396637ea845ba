"""Tolerances: how far a robot, its drive, its mount and the scene's surfaces may be from what the files say."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from tdcr_planner.errors import InputError
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.robot import RobotSpec

_RELATIVE = ("youngs_modulus", "tension", "mass", "displacement", "friction", "length", "tendon_circle", "mesh_scale")
_LARGEST = {
    "base_angle_deg": 180.0,
    "tendon_angle_deg": 180.0,
    "mesh_angle_deg": 180.0,
    "base_position_m": 1e3,
    "mesh_position_m": 1e3,
    "displacement_offset_m": 1e3,
    "tension_offset_n": 1e6,
}


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of what differs from robot to robot and stays the same along a path.

    Factors are log-normal, the rest is normal. The defaults are of the size found on laboratory robots and no
    substitute for one's own.

    Attributes:
        youngs_modulus: Of the backbone's Young's modulus, relative.
        tension: Of each tendon's gain from commanded to real tension, relative.
        mass: Of backbone density, disk masses and payload, relative, one factor for all.
        base_position_m: Of the base's position, each axis.
        base_angle_deg: Of the base's orientation, about each axis.
        tension_offset_n: Of each tendon's real tension where none is commanded; never below zero.
        displacement: Of each tendon's gain from commanded to real displacement, relative; displacement drive.
        displacement_offset_m: Of each tendon's real displacement where none is commanded; displacement drive.
        friction: Of the tendons' friction coefficients, relative, one factor for all.
        length: Of each segment's length, relative.
        tendon_circle: Of the radius of each segment's tendon circle, relative.
        tendon_angle_deg: Of each tendon's angle on its circle.
        mesh_position_m: Of the place of all surfaces together, each axis: an error of registration.
        mesh_angle_deg: Of the orientation of all surfaces together about the middle of their box, about each axis.
        mesh_scale: Of the size of all surfaces together, relative, about the same point.
    """

    youngs_modulus: float = 0.05
    tension: float = 0.02
    mass: float = 0.02
    base_position_m: float = 0.0005
    base_angle_deg: float = 0.2
    tension_offset_n: float = 0.0
    displacement: float = 0.0
    displacement_offset_m: float = 0.0
    friction: float = 0.0
    length: float = 0.0
    tendon_circle: float = 0.0
    tendon_angle_deg: float = 0.0
    mesh_position_m: float = 0.0
    mesh_angle_deg: float = 0.0
    mesh_scale: float = 0.0

    def __post_init__(self) -> None:
        for name, value in self.items():
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(name, "a finite number of 0 or more", value)
            if name in _RELATIVE and value >= 1.0:
                raise InputError(name, "a relative deviation below 1 (0.05 is 5 %)", value)
            if value > _LARGEST.get(name, np.inf):
                raise InputError(name, f"{_LARGEST[name]:g} at most", value)

    def items(self) -> list[tuple[str, float]]:
        """Returns names and values."""
        return [(item.name, getattr(self, item.name)) for item in fields(self)]

    def varied(self) -> list[str]:
        """Returns the names of those above zero."""
        return [name for name, value in self.items() if value > 0.0]

    def only(self, name: str) -> Tolerances:
        """Returns these tolerances with all but one set to zero."""
        return Tolerances(**{other: value if other == name else 0.0 for other, value in self.items()})

    def without(self, name: str) -> Tolerances:
        """Returns these tolerances with one set to zero."""
        return replace(self, **{name: 0.0})

    def check_fit(self, robot: RobotSpec) -> Tolerances:
        """Returns the tolerances if the robot has all that they vary.

        Raises:
            InputError: It has not; names the tolerance.
        """
        kind = robot.drive.kind
        for names, needed in (
            (("tension", "tension_offset_n"), "tension"),
            (("displacement", "displacement_offset_m"), "displacement"),
        ):
            for name in names:
                if getattr(self, name) > 0.0 and kind != needed:
                    raise InputError(
                        f"tolerances.{name}", f"0, as robot {robot.name!r} has a {kind} drive", getattr(self, name)
                    )
        if self.friction > 0.0 and not any(tendon.friction_coefficient > 0.0 for tendon in robot.tendons):
            raise InputError("tolerances.friction", f"0, as robot {robot.name!r} has no friction", self.friction)
        if "tendons through points" in robot.features:
            for name in ("length", "tendon_circle", "tendon_angle_deg"):
                if getattr(self, name) > 0.0:
                    expected = f"0, as robot {robot.name!r} has tendons through points"
                    raise InputError(f"tolerances.{name}", expected, getattr(self, name))
        return self


def tolerances_of(scenario: Scenario) -> Tolerances:
    """Returns the tolerances of a scenario's table; the defaults that fit its drive where it has none.

    Raises:
        InputError: The robot lacks what the table varies.
    """
    table = scenario.file.tolerances
    if table is None:
        found = Tolerances()
        if scenario.robot.drive.kind != "tension":
            found = replace(found, tension=0.0, displacement=found.tension)
        return found
    return Tolerances(**table.model_dump()).check_fit(scenario.robot)
