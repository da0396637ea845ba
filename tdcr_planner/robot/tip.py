"""What the tip carries: a payload, a camera."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from pydantic import Field, field_validator, model_validator

from tdcr_planner.files import FileModel, NotNegative, Vector3

OpeningAngle = Annotated[float, Field(gt=0.0, lt=180.0)]
Pixels = Annotated[int, Field(gt=0)]


class Tip(FileModel):
    """What the last disk carries.

    Attributes:
        mass_kg: Payload, a point load.
        offset_m: Its centre of mass in the last disk's frame. Version 2.
    """

    only_version_2: ClassVar[tuple[str, ...]] = ("offset_m",)

    mass_kg: NotNegative = 0.0
    offset_m: Vector3 = (0.0, 0.0, 0.0)


class Camera(FileModel):
    """A camera on the last disk, for inspection. Version 2.

    Attributes:
        position_m: Centre of projection in the last disk's frame.
        direction: Optical axis in the last disk's frame; its length does not count.
        up: Direction that is up in its picture, in the last disk's frame; by default the disk's x axis, or what is
            left of it at right angles to the optical axis.
        field_of_view_deg: Full angle of the cone of view, or [width, height] of a rectangular picture.
        range_m: Nearest and farthest distance at which a surface is seen.
        max_incidence_deg: Largest angle between the line of sight and a surface's normal.
        pixels: Width and height of the picture; None where the resolution does not matter.
    """

    position_m: Vector3 = (0.0, 0.0, 0.0)
    direction: Vector3 = (0.0, 0.0, 1.0)
    up: Vector3 | None = None
    field_of_view_deg: OpeningAngle | tuple[OpeningAngle, OpeningAngle]
    range_m: tuple[NotNegative, NotNegative]
    max_incidence_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 90.0
    pixels: tuple[Pixels, Pixels] | None = None

    @field_validator("direction", "up")
    @classmethod
    def _check_direction(cls, direction: Vector3 | None) -> Vector3 | None:
        if direction is not None and math.hypot(*direction) < 1e-9:
            raise ValueError(f"expected a vector that points somewhere, got {list(direction)}")
        return direction

    @model_validator(mode="after")
    def _check_range(self) -> Camera:
        near, far = self.range_m
        if far <= near:
            raise ValueError(
                f"range_m must be [nearest, farthest] with nearest below farthest, got [{near:g}, {far:g}]"
            )
        return self
