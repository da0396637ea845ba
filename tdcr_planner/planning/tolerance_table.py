"""The table of a scenario file that says how far robots, drives and mounts differ from their files."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tdcr_planner.files import FileModel

Relative = Annotated[float, Field(ge=0.0, lt=1.0)]
Angle = Annotated[float, Field(ge=0.0, le=180.0)]
Shift = Annotated[float, Field(ge=0.0, le=1e3)]
Force = Annotated[float, Field(ge=0.0, le=1e6)]


class ToleranceTable(FileModel):
    """Standard deviations, as `query.tolerances.Tolerances` has them; what is left out does not vary."""

    youngs_modulus: Relative = 0.0
    tension: Relative = 0.0
    mass: Relative = 0.0
    base_position_m: Shift = 0.0
    base_angle_deg: Angle = 0.0
    tension_offset_n: Force = 0.0
    displacement: Relative = 0.0
    displacement_offset_m: Shift = 0.0
    friction: Relative = 0.0
    length: Relative = 0.0
    tendon_circle: Relative = 0.0
    tendon_angle_deg: Angle = 0.0
    mesh_position_m: Shift = 0.0
    mesh_angle_deg: Angle = 0.0
    mesh_scale: Relative = 0.0
