"""A robot on its test bench: what its file says, how it stands, where the zeros of its drive and its marker are."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec, Tendon


@dataclass(frozen=True, eq=False)
class Bench:
    """A robot as it stood on the bench; t tendons.

    Attributes:
        robot: The robot, version 2.
        base_position: Origin of the base in the frame of the measurements, shape (3,), m.
        base_rotation: Rotation vector of the base there, shape (3,), rad.
        marker: Place of the marker in the last disk's frame, shape (3,), m.
        zeros: Displacement of each tendon where the drive reads 0, shape (t,), m.
        drift: Growth of all zeros with time, m/s; negative where tendons loosen.
        pretension_shift: Tension of each tendon beyond what the measurements' tension columns say, shape (t,), N;
            tension drive only.
    """

    robot: RobotSpec
    base_position: FloatArray
    base_rotation: FloatArray
    marker: FloatArray
    zeros: FloatArray
    drift: float = 0.0
    pretension_shift: FloatArray = field(default_factory=lambda: np.zeros(1))

    @classmethod
    def nominal(cls, robot: RobotSpec, marker: FloatArray | None = None) -> Bench:
        """Returns a robot that stands as its file says, with its base in the frame's origin."""
        tendons = robot.tendon_count
        place = np.zeros(3) if marker is None else np.array(marker, dtype=np.float64)
        return cls(
            as_version_2(robot), np.zeros(3), np.zeros(3), place, np.zeros(tendons),
            pretension_shift=np.zeros(tendons),
        )  # fmt: skip

    def with_robot(self, **changes: Any) -> Bench:
        """Returns the bench with some tables of the robot's file replaced."""
        return replace(self, robot=self.robot.model_copy(update=changes))

    @property
    def drives_displacement(self) -> bool:
        """Whether the drive sets displacements."""
        return self.robot.drive.kind == "displacement"


def as_version_2(robot: RobotSpec) -> RobotSpec:
    """Returns the same robot in version 2 of the file, which says more."""
    if robot.format == "tdcr-robot/2":
        return robot
    content = robot.model_dump()
    only = type(robot.segments[0]).only_version_1
    content["format"] = "tdcr-robot/2"
    content["segments"] = [
        {key: value for key, value in segment.items() if key not in only} for segment in content["segments"]
    ]
    content["tendons"] = [_table_of(tendon, robot) for tendon in robot.tendons]
    low, high = robot.drive.max_displacement
    content["drive"] = {"kind": "tension", "pretension_n": robot.drive.pretension.tolist()}
    if np.isfinite(high).all():
        content["drive"]["max_displacement_m"] = np.stack([low, high], axis=1).tolist()
    return RobotSpec.model_validate(content)


def _table_of(tendon: Tendon, robot: RobotSpec) -> dict[str, Any]:
    path = tendon.straight_path
    assert path is not None
    table: dict[str, Any] = {
        "segment": tendon.segment + 1,
        "angle_deg": float(np.rad2deg(path.angle)),
        "radius_m": path.radius,
        "between_disks": tendon.between_disks,
        "max_tension_n": float(robot.max_tensions.max() if np.isinf(tendon.max_tension) else tendon.max_tension),
    }
    if np.isfinite(tendon.axial_stiffness):
        table["axial_stiffness_n"] = tendon.axial_stiffness
    return table


def check_calibratable(robot: RobotSpec) -> None:
    """Raises InputError where a robot has what calibration does not know."""
    unknown = sorted(
        robot.features
        & {
            "helical tendons",
            "converging tendons",
            "tendons through points",
            "tendons that start beyond the base",
            "tendons that end inside a segment",
            "taper",
            "stiffness by axis",
            "rigid stretches",
            "disks at given places",
            "backlash",
        }
    )
    if unknown:
        raise InputError("robot", "a robot of straight tendons and one stiffness a segment", f"{', '.join(unknown)}")
