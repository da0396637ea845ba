"""Robots that differ from another by a factor: stiffer, heavier, with other limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec


def scaled(robot: RobotSpec, stiffness: float, mass: float) -> RobotSpec:
    """Returns a robot with all backbone stiffness and all masses multiplied; see `RobotSpec.scaled`."""
    segments = []
    for segment in robot.segments:
        changes: dict[str, Any] = {
            "disk_mass_kg": mass * segment.disk_mass_kg,
            "backbone": None if segment.backbone is None else segment.backbone.scaled(stiffness, mass),
        }
        if segment.disk_masses_kg is not None:
            changes["disk_masses_kg"] = tuple(mass * item for item in segment.disk_masses_kg)
        segments.append(segment.model_copy(update=changes))
    tip = robot.tip.model_copy(update={"mass_kg": mass * robot.tip.mass_kg})
    return robot.model_copy(
        update={"backbone": robot.backbone.scaled(stiffness, mass), "segments": segments, "tip": tip}
    )


def with_tension_limits_times(robot: RobotSpec, factor: float) -> RobotSpec:
    """Returns a robot whose tension limits are multiplied by a factor; none stays none."""

    def times(table: Any) -> Any:
        limit = table.max_tension_n
        return table if limit is None else table.model_copy(update={"max_tension_n": factor * limit})

    if robot.format == "tdcr-robot/1":
        return robot.model_copy(update={"segments": [times(segment) for segment in robot.segments]})
    return robot.model_copy(update={"tendons": [times(table) for table in robot.tendon_tables]})
