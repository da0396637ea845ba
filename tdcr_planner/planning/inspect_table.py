"""The tables of a scenario file that say what is to be inspected."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from tdcr_planner.bounds import PLACE_M
from tdcr_planner.files import FileModel, Positive, Vector3
from tdcr_planner.robot import Camera

Place = Annotated[float, AfterValidator(PLACE_M.validate)]
Point = tuple[Place, Place, Place]
Length = Annotated[Positive, AfterValidator(PLACE_M.validate)]


def _check_direction(direction: Vector3 | None) -> Vector3 | None:
    if direction is not None and np.linalg.norm(direction) < 1e-9:
        raise ValueError(f"expected a direction of length above 0, got {list(direction)}")
    return direction


class Sphere(FileModel):
    """A ball that marks a part of a surface: center_m and radius_m, world frame."""

    center_m: Point
    radius_m: Length


class Marker(FileModel):
    """A closed mesh that marks a part of a surface: what lies inside of it; file and unit as of the scene's meshes."""

    file: Annotated[str, Field(min_length=1)]
    unit: Literal["m", "cm", "mm", "in"]


class SurfaceTable(FileModel):
    """A surface to be seen: a mesh of the scene, whole or what all the given marks have in common.

    Attributes:
        mesh: The mesh's name: its file's, as the scenario has it or without folders.
        box_m: Lower and upper corner of a box, world frame.
        sphere: A ball.
        within: A closed mesh.
        facing: A direction: only what faces it within 90 degrees, by the normal on the visible side.
        points_m: Points instead of an even spacing, world frame; each is moved onto the mesh.
    """

    mesh: Annotated[str, Field(min_length=1)]
    box_m: tuple[Point, Point] | None = None
    sphere: Sphere | None = None
    within: Marker | None = None
    facing: Vector3 | None = None
    points_m: Annotated[tuple[Point, ...], Field(min_length=1, max_length=1_000_000)] | None = None

    _check_facing = field_validator("facing")(_check_direction)

    @field_validator("box_m")
    @classmethod
    def _check_box(cls, value: tuple[Point, Point] | None) -> tuple[Point, Point] | None:
        if value is not None and any(low >= high for low, high in zip(*value, strict=True)):
            raise ValueError(f"expected [[low x, y, z], [high x, y, z]] with low below high, got {list(value)}")
        return value


def _named_surfaces(value: Any) -> Any:
    """Returns surfaces with names alone written out as tables."""
    if isinstance(value, list | tuple):
        return [{"mesh": item} if isinstance(item, str) else item for item in value]
    return value


class InspectTable(FileModel):
    """What is to be seen.

    Attributes:
        surfaces: Names of meshes, or tables of parts of them.
        spacing_m: Distance between neighbouring points of a surface that must be seen.
        coverage: Share of the surfaces, by area, that the path must see; None for as much as `of_visible` says.
        of_visible: Where no coverage is stated, the share of what can be seen at all that the path must see.
        back: Whether the path returns to the start.
        camera: The camera, in place of the robot file's.
    """

    surfaces: Annotated[tuple[SurfaceTable, ...], BeforeValidator(_named_surfaces), Field(min_length=1)]
    spacing_m: Length = 0.004
    coverage: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    of_visible: Annotated[float, Field(gt=0.0, le=1.0)] = 0.97
    back: bool = False
    camera: Camera | None = None

    @model_validator(mode="after")
    def _check_camera(self) -> InspectTable:
        low = None if self.camera is None else self.camera.range_m[1]
        if low is not None and self.spacing_m > 10.0 * low:
            raise ValueError(
                f"spacing_m = {self.spacing_m:g} is more than ten times the camera's largest working distance {low:g}"
            )
        return self
