"""The segments: lengths and disks, and in version 1 files the tendons that end with each segment."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, field_validator, model_validator

from tdcr_planner.arrays import FloatArray
from tdcr_planner.files import FileModel, NotNegative, Positive
from tdcr_planner.robot.backbone import Backbone

MOST_DISKS = 500


class Segment(FileModel):
    """A part of the robot with its disks. In version 1 its tendons all end at its last disk.

    Attributes:
        length_m: Arc length of the unloaded segment.
        disks: Number of disks; evenly spaced, the last at the segment's end, unless disk_positions_m places them.
        disk_radius_m: Outer radius of each disk.
        disk_thickness_m: Thickness of each disk.
        disk_mass_kg: Mass of each disk.
        tendon_circle_radius_m: Distance of this segment's tendons from the backbone. Version 1, required there.
        tendon_angles_deg: Angle of each tendon about z from the base x axis. Version 1, required there.
        max_tension_n: Largest tension of each tendon. Version 1, required there.
        pretension_n: Tension added to each tendon. Version 1.
        tendon_axial_stiffness_n: E A of each tendon, for its elastic stretch; None for inextensible tendons. Version 1.
        max_tendon_displacement_m: Largest pull or release of each tendon at the base, counted from the unloaded
            robot; None for no limit. Version 1.
        backbone: This segment's own backbone; None for the robot's.
        disk_positions_m: Where each disk stands, from the segment's start; None for even spacing. Version 2.
        disk_masses_kg: Mass of each disk in place of disk_mass_kg. Version 2.
        rigid: Whether the whole segment keeps its rest shape. Version 2.
    """

    only_version_1: ClassVar[Mapping[str, str]] = {
        "tendon_circle_radius_m": "`radius_m` of each [[tendons]] says it",
        "tendon_angles_deg": "`angle_deg` of each [[tendons]] says it",
        "max_tension_n": "`max_tension_n` of each [[tendons]] says it",
        "pretension_n": "`pretension_n` of [drive] says it",
        "tendon_axial_stiffness_n": "`axial_stiffness_n` of each [[tendons]] says it",
        "max_tendon_displacement_m": "`max_displacement_m` of [drive] says it",
    }
    required_in_version_1: ClassVar[tuple[str, ...]] = ("tendon_circle_radius_m", "tendon_angles_deg", "max_tension_n")
    only_version_2: ClassVar[tuple[str, ...]] = ("disk_positions_m", "disk_masses_kg", "rigid")

    length_m: Positive
    disks: Annotated[int, Field(ge=1, le=MOST_DISKS)]
    disk_radius_m: Positive
    disk_thickness_m: Positive
    disk_mass_kg: NotNegative = 0.0
    tendon_circle_radius_m: Positive | None = None
    tendon_angles_deg: tuple[float, ...] | None = None
    max_tension_n: Positive | None = None
    pretension_n: NotNegative = 0.0
    tendon_axial_stiffness_n: Positive | None = None
    max_tendon_displacement_m: Positive | None = None
    backbone: Backbone | None = None
    disk_positions_m: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=MOST_DISKS)] | None = None
    disk_masses_kg: tuple[NotNegative, ...] | None = None
    rigid: bool = False

    @model_validator(mode="before")
    @classmethod
    def _count_placed_disks(cls, content: Any) -> Any:
        """Counts the disks of disk_positions_m where the file leaves `disks` out."""
        if not isinstance(content, Mapping) or content.get("disk_positions_m") is None or "disks" in content:
            return content
        places = content["disk_positions_m"]
        count = len(places) if isinstance(places, list | tuple) else 1
        return {**content, "disks": min(max(count, 1), MOST_DISKS)}

    @field_validator("tendon_angles_deg")
    @classmethod
    def _check_angles(cls, angles: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if angles is None:
            return angles
        if len(angles) < 3:
            raise ValueError(f"expected three or more tendons, got {len(angles)}")
        gap = widest_gap(angles)
        if gap >= 180.0 - 1e-6:
            raise ValueError(
                f"tendons that only pull must surround the backbone: the widest gap between neighbours must be below "
                f"180 degrees, got {gap:g} in {list(angles)}"
                + ("; are these radians? degrees are expected" if np.abs(angles).max() <= 2.0 * math.pi else "")
            )
        return angles

    @model_validator(mode="after")
    def _check_sizes(self) -> Segment:
        circle, limit = self.tendon_circle_radius_m, self.max_tension_n
        if circle is not None and circle >= self.disk_radius_m:
            raise ValueError(f"tendon_circle_radius_m must be below disk_radius_m = {self.disk_radius_m}, got {circle}")
        if limit is not None and self.pretension_n >= limit:
            raise ValueError(f"pretension_n must be below max_tension_n = {limit}, got {self.pretension_n}")
        if self.disk_positions_m is None:
            spacing = self.length_m / self.disks
            if self.disk_thickness_m >= spacing:
                raise ValueError(
                    f"disk_thickness_m must be below the disk spacing length_m / disks = {spacing:g}, "
                    f"got {self.disk_thickness_m}"
                )
        return self

    @model_validator(mode="after")
    def _check_places(self) -> Segment:
        places = self.disk_positions_m
        if places is not None:
            if len(places) != self.disks:
                raise ValueError(f"disks must be left out, or count disk_positions_m = {len(places)}, got {self.disks}")
            gaps = np.diff(places, prepend=0.0)
            if gaps.min() <= 0.0:
                disk = int(np.argmin(gaps))
                raise ValueError(f"disk_positions_m must increase, got {places[disk]:g} m after {places[disk - 1]:g} m")
            if places[-1] > self.length_m * (1.0 + 1e-9):
                raise ValueError(
                    f"disk_positions_m must be at most length_m = {self.length_m:g}, got {places[-1]:g}: they count "
                    "from the segment's start"
                )
            if gaps.min() <= self.disk_thickness_m:
                raise ValueError(
                    f"disk_thickness_m must be below the least disk spacing {gaps.min():g}, got {self.disk_thickness_m}"
                )
        if self.disk_masses_kg is not None and len(self.disk_masses_kg) != self.disks:
            raise ValueError(
                f"disk_masses_kg: expected a mass for each of {self.disks} disks, got {len(self.disk_masses_kg)}"
            )
        if self.disk_masses_kg is not None and self.disk_mass_kg != 0.0:
            raise ValueError("disk_mass_kg and disk_masses_kg exclude one another; give one of them")
        return self

    @property
    def disk_places(self) -> FloatArray:
        """Arc length of each disk from the segment's start, shape (disks,), m."""
        if self.disk_positions_m is None:
            return self.length_m * np.arange(1, self.disks + 1) / self.disks
        places = np.array(self.disk_positions_m)
        return np.where(np.abs(places - self.length_m) <= 1e-9 * self.length_m, self.length_m, places)

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass of each disk, kg."""
        return self.disk_masses_kg or (self.disk_mass_kg,) * self.disks


def widest_gap(angles_deg: tuple[float, ...]) -> float:
    """Returns the widest gap between neighbouring angles about the whole turn, degrees."""
    ordered = np.sort(np.mod(angles_deg, 360.0))
    return float(np.diff(np.append(ordered, ordered[0] + 360.0)).max())
