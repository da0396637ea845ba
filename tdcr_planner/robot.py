"""The robot: what its TOML file says, as frozen objects and as the arrays that mechanics and planning need."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, field_validator, model_validator

from tdcr_planner.arrays import FloatArray, IntArray, check_array
from tdcr_planner.errors import InputError
from tdcr_planner.files import FileModel, NotNegative, Positive, Vector3, parse_table, read_toml, sha256_of_json
from tdcr_planner.limits import snap
from tdcr_planner.plausibility import doubts

logger = logging.getLogger(__name__)


class Backbone(FileModel):
    """An elastic rod of circular, possibly hollow, cross-section.

    Attributes:
        youngs_modulus_pa: Young's modulus E.
        poisson_ratio: Poisson's ratio nu; the shear modulus is G = E / (2 (1 + nu)).
        radius_m: Outer radius.
        inner_radius_m: Inner radius, 0 for a solid rod.
        density_kg_m3: Mass density; 0 for a massless rod.
        rest_curvature_1_m: Curvature and twist u* of the unloaded rod, body frame.
        max_strain: Largest bending strain allowed, radius x |u - u*| (dimensionless), or None for no limit.
    """

    youngs_modulus_pa: Positive
    poisson_ratio: Annotated[float, Field(gt=-1.0, le=0.5)]
    radius_m: Positive
    inner_radius_m: NotNegative = 0.0
    density_kg_m3: NotNegative = 0.0
    rest_curvature_1_m: Vector3 = (0.0, 0.0, 0.0)
    max_strain: Positive | None = None

    @model_validator(mode="after")
    def _check_wall(self) -> Backbone:
        if self.inner_radius_m >= self.radius_m:
            raise ValueError(f"inner_radius_m must be below radius_m = {self.radius_m}, got {self.inner_radius_m}")
        rest = math.hypot(*self.rest_curvature_1_m[:2])
        if rest * self.radius_m >= 1.0:
            raise ValueError(
                f"rest_curvature_1_m must be below 1 / radius_m = {1.0 / self.radius_m:g}, got {rest:g} 1/m: the "
                "backbone cannot be bent more sharply than its own radius; is it in 1/mm?"
            )
        return self

    @property
    def area(self) -> float:
        """Cross-section A, m^2."""
        return math.pi * (self.radius_m**2 - self.inner_radius_m**2)

    @property
    def second_moment(self) -> float:
        """Second moment of area I, m^4."""
        return math.pi / 4.0 * (self.radius_m**4 - self.inner_radius_m**4)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G, Pa."""
        return self.youngs_modulus_pa / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def stiffness_shear_extension(self) -> Vector3:
        """Diagonal of Kse = diag(GA, GA, EA), N (Rucker and Webster 2011, classical Cosserat rod)."""
        shear = self.shear_modulus * self.area
        return (shear, shear, self.youngs_modulus_pa * self.area)

    @property
    def stiffness_bending_torsion(self) -> Vector3:
        """Diagonal of Kbt = diag(EI, EI, GJ), N m^2, with J = 2 I (Rucker and Webster 2011, classical Cosserat rod)."""
        bending = self.youngs_modulus_pa * self.second_moment
        return (bending, bending, 2.0 * self.shear_modulus * self.second_moment)

    @property
    def weight_per_length_kg_m(self) -> float:
        """Mass of the rod per length, kg/m."""
        return self.density_kg_m3 * self.area


class Segment(FileModel):
    """A part of the robot whose tendons all end at its last disk.

    Attributes:
        length_m: Arc length of the unloaded segment.
        disks: Number of evenly spaced disks, the last at the segment's end.
        disk_radius_m: Outer radius of each disk.
        disk_thickness_m: Thickness of each disk.
        disk_mass_kg: Mass of each disk.
        tendon_circle_radius_m: Distance of this segment's tendons from the backbone.
        tendon_angles_deg: Angle of each tendon about z from the base x axis.
        max_tension_n: Largest tension of each tendon.
        pretension_n: Tension added to each tendon.
        tendon_axial_stiffness_n: E A of each tendon, for its elastic stretch; None for inextensible tendons.
        max_tendon_displacement_m: Largest pull or release of each tendon at the base, counted from the unloaded
            robot; None for no limit.
        backbone: This segment's own backbone; None for the robot's.
    """

    length_m: Positive
    disks: Annotated[int, Field(ge=1, le=500)]
    disk_radius_m: Positive
    disk_thickness_m: Positive
    disk_mass_kg: NotNegative = 0.0
    tendon_circle_radius_m: Positive
    tendon_angles_deg: tuple[float, ...]
    max_tension_n: Positive
    pretension_n: NotNegative = 0.0
    tendon_axial_stiffness_n: Positive | None = None
    max_tendon_displacement_m: Positive | None = None
    backbone: Backbone | None = None

    @field_validator("tendon_angles_deg")
    @classmethod
    def _check_angles(cls, angles: tuple[float, ...]) -> tuple[float, ...]:
        if len(angles) < 3:
            raise ValueError(f"expected three or more tendons, got {len(angles)}")
        ordered = np.sort(np.mod(angles, 360.0))
        gaps = np.diff(np.append(ordered, ordered[0] + 360.0))
        if gaps.max() >= 180.0 - 1e-6:
            raise ValueError(
                f"tendons that only pull must surround the backbone: the widest gap between neighbours must be below "
                f"180 degrees, got {gaps.max():g} in {list(angles)}"
                + ("; are these radians? degrees are expected" if np.abs(angles).max() <= 2.0 * math.pi else "")
            )
        return angles

    @model_validator(mode="after")
    def _check_sizes(self) -> Segment:
        if self.tendon_circle_radius_m >= self.disk_radius_m:
            raise ValueError(
                f"tendon_circle_radius_m must be below disk_radius_m = {self.disk_radius_m}, "
                f"got {self.tendon_circle_radius_m}"
            )
        if self.pretension_n >= self.max_tension_n:
            raise ValueError(
                f"pretension_n must be below max_tension_n = {self.max_tension_n}, got {self.pretension_n}"
            )
        spacing = self.length_m / self.disks
        if self.disk_thickness_m >= spacing:
            raise ValueError(
                f"disk_thickness_m must be below the disk spacing length_m / disks = {spacing:g}, "
                f"got {self.disk_thickness_m}"
            )
        return self


class Tip(FileModel):
    """What the last disk carries: mass_kg, a point load at its centre."""

    mass_kg: NotNegative = 0.0


class Body(FileModel):
    """What stands between two disks when collision is tested.

    Attributes:
        between_disks: "backbone", "tendons" (backbone and tendons) or "sleeve" (a tube of the disks' radius).
        tendon_radius_m: Radius of a tendon.
    """

    between_disks: Literal["backbone", "tendons", "sleeve"] = "tendons"
    tendon_radius_m: Positive = 0.0002


class RobotSpec(FileModel):
    """A tendon-driven continuum robot, base to tip. Disk 0 is the clamped base."""

    format: Literal["tdcr-robot/1"]
    name: Annotated[str, Field(min_length=1)]
    backbone: Backbone
    segments: Annotated[tuple[Segment, ...], Field(min_length=1)]
    tip: Tip = Tip()
    body: Body = Body()

    @model_validator(mode="after")
    def _check_cross_sections(self) -> RobotSpec:
        """Refuses a robot whose parts would stand in one another: backbone, tendons and the disks that they pass."""
        for index, (segment, backbone) in enumerate(zip(self.segments, self.segment_backbones, strict=True)):
            name = f"segments[{index + 1}]"
            if backbone.radius_m >= segment.disk_radius_m:
                raise ValueError(
                    f"{name}: the backbone's radius_m must be below disk_radius_m = {segment.disk_radius_m:g}, got "
                    f"{backbone.radius_m:g}: a backbone is narrower than its disks; is it in mm?"
                )
            for other, passing in enumerate(self.segments[index:], index):
                tendons, circle = f"segments[{other + 1}].tendon_circle_radius_m", passing.tendon_circle_radius_m
                if circle <= backbone.radius_m:
                    raise ValueError(
                        f"{tendons} must be above the backbone's radius_m = {backbone.radius_m:g} in {name}, got "
                        f"{circle:g}: tendons run outside of the backbone"
                    )
                if circle >= segment.disk_radius_m:
                    raise ValueError(
                        f"{tendons} must be below disk_radius_m = {segment.disk_radius_m:g} of {name}, got {circle:g}: "
                        "tendons pass the disks of all segments before their own"
                    )
            if self.body.tendon_radius_m >= segment.tendon_circle_radius_m:
                raise ValueError(
                    f"body.tendon_radius_m must be below tendon_circle_radius_m = {segment.tendon_circle_radius_m:g} "
                    f"of {name}, got {self.body.tendon_radius_m:g}: a tendon does not reach the backbone's axis"
                )
        return self

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> RobotSpec:  # noqa: ARG002
        """Returns a copy with some fields replaced, checked anew.

        The arrays derived from the fields are computed again, which pydantic's own copy would not do.
        """
        return RobotSpec.model_validate({**self.model_dump(), **(update or {})})

    def scaled(self, *, stiffness: float = 1.0, mass: float = 1.0) -> RobotSpec:
        """Returns a robot with all Young's moduli, and all masses (backbone, disks, payload), multiplied by factors."""

        def rod(backbone: Backbone) -> Backbone:
            changes = {
                "youngs_modulus_pa": stiffness * backbone.youngs_modulus_pa,
                "density_kg_m3": mass * backbone.density_kg_m3,
            }
            return backbone.model_copy(update=changes)

        segments = []
        for segment in self.segments:
            own = None if segment.backbone is None else rod(segment.backbone)
            changes = {"disk_mass_kg": mass * segment.disk_mass_kg, "backbone": own}
            segments.append(segment.model_copy(update=changes))
        tip = self.tip.model_copy(update={"mass_kg": mass * self.tip.mass_kg})
        return self.model_copy(update={"backbone": rod(self.backbone), "segments": segments, "tip": tip})

    def __eq__(self, other: object) -> bool:
        # Pydantic compares what is cached too, and arrays have no single truth value.
        return isinstance(other, RobotSpec) and self.model_dump() == other.model_dump()

    def __hash__(self) -> int:
        return hash(self.mechanics_hash)

    @property
    def segment_count(self) -> int:
        """Number of segments."""
        return len(self.segments)

    @property
    def tendon_count(self) -> int:
        """Number of tendons t of all segments."""
        return sum(len(segment.tendon_angles_deg) for segment in self.segments)

    @property
    def disk_count(self) -> int:
        """Number of disks d, the base included."""
        return 1 + sum(segment.disks for segment in self.segments)

    @property
    def length(self) -> float:
        """Arc length of the unloaded robot, m."""
        return sum(segment.length_m for segment in self.segments)

    @cached_property
    def segment_ends(self) -> FloatArray:
        """Arc length at which each segment ends, shape (segments,), m."""
        return np.cumsum([segment.length_m for segment in self.segments])

    @cached_property
    def segment_backbones(self) -> tuple[Backbone, ...]:
        """The backbone of each segment."""
        return tuple(segment.backbone or self.backbone for segment in self.segments)

    @cached_property
    def arc_lengths(self) -> FloatArray:
        """Arc length of each disk, base included, shape (d,), m."""
        starts = np.concatenate([[0.0], self.segment_ends[:-1]])
        parts = [
            start + segment.length_m * np.arange(1, segment.disks + 1) / segment.disks
            for start, segment in zip(starts, self.segments, strict=True)
        ]
        return np.concatenate([[0.0], *parts])

    @cached_property
    def disk_segments(self) -> IntArray:
        """Index of the segment to which each disk belongs (the base to the first), shape (d,)."""
        return self._per_disk([float(i) for i in range(self.segment_count)], 0.0).astype(np.int64)

    @cached_property
    def disk_masses(self) -> FloatArray:
        """Mass of each disk without the payload, shape (d,), kg; the base has none."""
        return self._per_disk([segment.disk_mass_kg for segment in self.segments], 0.0)

    @cached_property
    def disk_radii(self) -> FloatArray:
        """Radius of each disk, shape (d,), m."""
        return self._per_disk([segment.disk_radius_m for segment in self.segments], self.segments[0].disk_radius_m)

    @cached_property
    def disk_thicknesses(self) -> FloatArray:
        """Thickness of each disk, shape (d,), m."""
        values = [segment.disk_thickness_m for segment in self.segments]
        return self._per_disk(values, self.segments[0].disk_thickness_m)

    def _per_disk(self, values: list[float], base: float) -> FloatArray:
        return np.concatenate([[base], np.repeat(values, [segment.disks for segment in self.segments])])

    @cached_property
    def tendon_segments(self) -> IntArray:
        """Index of the segment at whose end each tendon ends, shape (t,)."""
        counts = [len(segment.tendon_angles_deg) for segment in self.segments]
        return np.repeat(np.arange(self.segment_count), counts)

    @cached_property
    def tendon_angles(self) -> FloatArray:
        """Angle of each tendon about z from the base x axis, shape (t,), rad."""
        return np.deg2rad(np.concatenate([segment.tendon_angles_deg for segment in self.segments]))

    @cached_property
    def tendon_offsets(self) -> FloatArray:
        """Offset r_i of each tendon from the backbone in the disk frame, shape (t, 3), m; the third is zero."""
        radius = self._per_tendon([segment.tendon_circle_radius_m for segment in self.segments])
        angle = self.tendon_angles
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros_like(angle)], axis=1)

    @cached_property
    def max_tensions(self) -> FloatArray:
        """Largest tension of each tendon, shape (t,), N."""
        return self._per_tendon([segment.max_tension_n for segment in self.segments])

    @cached_property
    def pretensions(self) -> FloatArray:
        """Tension that the bending map adds to each tendon, shape (t,), N."""
        return self._per_tendon([segment.pretension_n for segment in self.segments])

    def _per_tendon(self, values: list[float]) -> FloatArray:
        return np.asarray(values, dtype=np.float64)[self.tendon_segments]

    @cached_property
    def mechanics_hash(self) -> str:
        """SHA-256 over all that decides the shape under given tensions and loads.

        Name, limits and body are left out: changing them leaves a trained shape model valid.
        """
        left_out = {
            "disk_radius_m",
            "disk_thickness_m",
            "max_tension_n",
            "pretension_n",
            "tendon_axial_stiffness_n",
            "max_tendon_displacement_m",
        }
        content: dict[str, Any] = {
            "backbones": [backbone.model_dump(exclude={"max_strain"}) for backbone in self.segment_backbones],
            "segments": [segment.model_dump(exclude=left_out | {"backbone"}) for segment in self.segments],
            "tip": self.tip.model_dump(),
        }
        return sha256_of_json(content)

    def tensions_from_bending(self, bending: ArrayLike) -> FloatArray:
        """Returns the tensions of least sum that produce a bending vector, plus the pretension.

        All tendons of a segment stand on one circle, so the least sum uses the two neighbours between which the
        bending vector points. Tension limits are not applied here.

        Args:
            bending: Shape (n, segments, 2), N, equivalent tendon force at the tendon circle, base x and y.

        Returns:
            Shape (n, t), N.
        """
        array = check_array("bending", bending, (None, self.segment_count, 2))
        tensions = np.tile(self.pretensions, (len(array), 1))
        for index in range(self.segment_count):
            columns = np.flatnonzero(self.tendon_segments == index)
            order = columns[np.argsort(np.mod(self.tendon_angles[columns], 2.0 * np.pi), kind="stable")]
            angles = np.mod(self.tendon_angles[order], 2.0 * np.pi)
            x, y = array[:, index, 0], array[:, index, 1]
            direction = np.mod(np.arctan2(y, x), 2.0 * np.pi)
            left = (np.searchsorted(angles, direction, side="right") - 1) % len(order)
            right = (left + 1) % len(order)
            sine = np.sin(angles[right] - angles[left])
            first = (x * np.sin(angles[right]) - y * np.cos(angles[right])) / sine
            second = (y * np.cos(angles[left]) - x * np.sin(angles[left])) / sine
            rows = np.arange(len(array))
            np.add.at(tensions, (rows, order[left]), np.maximum(first, 0.0))
            np.add.at(tensions, (rows, order[right]), np.maximum(second, 0.0))
        return tensions

    def bending_from_tensions(self, tensions: ArrayLike) -> FloatArray:
        """Returns bending vectors sum_i tau_i (cos a_i, sin a_i), shape (n, segments, 2), N, of tensions (n, t), N."""
        array = self.check_tensions(tensions)
        directions = np.stack([np.cos(self.tendon_angles), np.sin(self.tendon_angles)], axis=1)
        bending = np.zeros((len(array), self.segment_count, 2))
        for index in range(self.segment_count):
            columns = self.tendon_segments == index
            bending[:, index] = array[:, columns] @ directions[columns]
        return bending

    def check_tensions(self, tensions: ArrayLike) -> FloatArray:
        """Returns tensions as shape (n, t), N, or raises InputError: one row a case, none negative, all finite.

        Negative by rounding counts as 0. Tension limits are not checked here: the statics are valid beyond them.
        """
        array = snap(check_array("tensions", tensions, (None, self.tendon_count)), 0.0, self.max_tensions)
        if (array < 0.0).any():
            row, column = (int(i) for i in np.argwhere(array < 0.0)[0])
            raise InputError(
                "tensions",
                "tensions of 0 N or more (tendons only pull)",
                f"{array[row, column]:g} in row {row}, tendon {column}",
            )
        return array


def load_robot(path: str | Path) -> RobotSpec:
    """Returns the robot that a TOML file describes.

    What no real robot has, as a value in the wrong unit does, is warned of; see `plausibility.doubts`.

    Raises:
        FormatError: The file is missing or not a robot; every fault is named with its key and what would be valid.
    """
    robot = parse_table(RobotSpec, read_toml(path), path)
    for doubt in doubts(robot):
        _warn_once(f"{path}: {doubt}")
    return robot


@cache
def _warn_once(text: str) -> None:
    """Logs a warning that this process has not seen yet: a robot's file is read once a query."""
    logger.warning(text)
