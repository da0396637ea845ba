"""The backbone: an elastic rod, its stiffness and mass at every arc length."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.files import FileModel, NotNegative, Positive, Vector3
from tdcr_planner.robot.fields import BothAxes, Stretches

_MEASURED = ("bending_stiffness_n_m2", "torsional_stiffness_n_m2", "axial_stiffness_n", "shear_stiffness_n")


class Backbone(FileModel):
    """An elastic rod of circular, possibly hollow, cross-section.

    Arc lengths of a segment's own backbone count from the segment's start, those of the robot's from the base.

    Attributes:
        youngs_modulus_pa: Young's modulus E.
        poisson_ratio: Poisson's ratio nu; the shear modulus is G = E / (2 (1 + nu)).
        radius_m: Outer radius; the largest one of a rod that tapers.
        inner_radius_m: Inner radius, 0 for a solid rod.
        density_kg_m3: Mass density; 0 for a massless rod.
        rest_curvature_1_m: Curvature and twist u* of the unloaded rod, body frame.
        max_strain: Largest bending strain allowed, radius x |u - u*| (dimensionless), or None for no limit.
        radius_points_m: Taper: arc length and outer radius of two or more points, linear between them, constant
            before the first and after the last; None for a rod of one radius. Version 2.
        bending_stiffness_n_m2: Measured EI about the body's x and y axis, in place of E I. Version 2.
        torsional_stiffness_n_m2: Measured GJ. Version 2.
        axial_stiffness_n: Measured EA. Version 2.
        shear_stiffness_n: Measured GA along the body's x and y axis. Version 2.
        rigid_stretches_m: Start and end of stretches that keep their rest shape. Version 2.
    """

    only_version_2: ClassVar[tuple[str, ...]] = ("radius_points_m", *_MEASURED, "rigid_stretches_m")

    youngs_modulus_pa: Positive
    poisson_ratio: Annotated[float, Field(gt=-1.0, le=0.5)]
    radius_m: Positive
    inner_radius_m: NotNegative = 0.0
    density_kg_m3: NotNegative = 0.0
    rest_curvature_1_m: Vector3 = (0.0, 0.0, 0.0)
    max_strain: Positive | None = None
    radius_points_m: tuple[tuple[NotNegative, Positive], ...] | None = None
    bending_stiffness_n_m2: BothAxes | None = None
    torsional_stiffness_n_m2: Positive | None = None
    axial_stiffness_n: Positive | None = None
    shear_stiffness_n: BothAxes | None = None
    rigid_stretches_m: Stretches = ()

    @model_validator(mode="before")
    @classmethod
    def _take_largest_radius(cls, content: Any) -> Any:
        """Takes the largest radius of a taper as radius_m where the file leaves that out."""
        if not isinstance(content, Mapping) or content.get("radius_points_m") is None or "radius_m" in content:
            return content
        points = content["radius_points_m"]
        rows = [row for row in points if isinstance(row, list | tuple)] if isinstance(points, list | tuple) else []
        radii = [row[1] for row in rows if len(row) == 2 and isinstance(row[1], int | float)]
        return {**content, "radius_m": max(radii, default=1.0)}

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

    @model_validator(mode="after")
    def _check_taper(self) -> Backbone:
        points = self.radius_points_m
        if points is None:
            return self
        if len(points) < 2:
            raise ValueError(f"radius_points_m: expected two or more points [arc length, radius], got {len(points)}")
        for before, after in itertools.pairwise(points):
            if after[0] <= before[0]:
                raise ValueError(
                    f"radius_points_m: arc lengths must increase, got {after[0]:g} m after {before[0]:g} m"
                )
        largest, smallest = max(radius for _, radius in points), min(radius for _, radius in points)
        if self.radius_m != largest:
            raise ValueError(
                f"radius_m must be left out, or be the largest radius of radius_points_m = {largest:g}, "
                f"got {self.radius_m:g}"
            )
        if self.inner_radius_m >= smallest:
            raise ValueError(
                f"inner_radius_m must be below the smallest radius of radius_points_m = {smallest:g}, "
                f"got {self.inner_radius_m:g}"
            )
        measured = [key for key in _MEASURED if getattr(self, key) is not None]
        if measured:
            raise ValueError(
                f"radius_points_m and {measured[0]} exclude one another: a measured stiffness holds for a rod of one "
                "radius; give each segment its own [segments.backbone]"
            )
        return self

    @model_validator(mode="after")
    def _check_rigid_stretches(self) -> Backbone:
        end_before = 0.0
        for start, end in sorted(self.rigid_stretches_m):
            if end <= start:
                raise ValueError(f"rigid_stretches_m: a stretch must end after its start, got [{start:g}, {end:g}]")
            if start < end_before:
                raise ValueError(
                    f"rigid_stretches_m: stretches must not overlap, got one from {start:g} m and one that ends at "
                    f"{end_before:g} m"
                )
            end_before = end
        return self

    @model_validator(mode="after")
    def _check_stiffness(self) -> Backbone:
        ends = np.array([s for s, _ in self.radius_points_m or ((0.0, 0.0),)])
        least = float(self.stiffness_at(ends).min())
        if not least > 0.0:
            raise ValueError(
                f"radius_m = {self.radius_m:g} and inner_radius_m = {self.inner_radius_m:g} leave so thin a wall that "
                f"a stiffness is {least:g}; are they in m?"
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
        shear_x, shear_y = self.shear_stiffness_n or (shear, shear)
        return (shear_x, shear_y, self.axial_stiffness_n or self.youngs_modulus_pa * self.area)

    @property
    def stiffness_bending_torsion(self) -> Vector3:
        """Diagonal of Kbt = diag(EI, EI, GJ), N m^2, with J = 2 I (Rucker and Webster 2011, classical Cosserat rod)."""
        bending = self.youngs_modulus_pa * self.second_moment
        bending_x, bending_y = self.bending_stiffness_n_m2 or (bending, bending)
        return (bending_x, bending_y, self.torsional_stiffness_n_m2 or 2.0 * self.shear_modulus * self.second_moment)

    @property
    def weight_per_length_kg_m(self) -> float:
        """Mass of the rod per length, kg/m."""
        return self.density_kg_m3 * self.area

    @property
    def is_isotropic(self) -> bool:
        """Whether the rod is as stiff about every axis across it."""
        return self.stiffness_bending_torsion[0] == self.stiffness_bending_torsion[1] and (
            self.stiffness_shear_extension[0] == self.stiffness_shear_extension[1]
        )

    def radius_at(self, s: FloatArray) -> FloatArray:
        """Returns the outer radius at arc lengths s, shape (n,), m."""
        if self.radius_points_m is None:
            return np.full(len(s), self.radius_m)
        arc_lengths, radii = np.transpose(self.radius_points_m)
        return np.asarray(np.interp(s, arc_lengths, radii))

    def stiffness_at(self, s: FloatArray) -> FloatArray:
        """Returns the diagonals of Kse (N) and Kbt (N m^2) at arc lengths s, shape (n, 6)."""
        if self.radius_points_m is None:
            return np.tile([*self.stiffness_shear_extension, *self.stiffness_bending_torsion], (len(s), 1))
        radius = self.radius_at(s)
        area = math.pi * (radius**2 - self.inner_radius_m**2)
        second = math.pi / 4.0 * (radius**4 - self.inner_radius_m**4)
        shear, bending = self.shear_modulus * area, self.youngs_modulus_pa * second
        axial, torsion = self.youngs_modulus_pa * area, 2.0 * self.shear_modulus * second
        return np.stack([shear, shear, axial, bending, bending, torsion], axis=1)

    def mass_per_length_at(self, s: FloatArray) -> FloatArray:
        """Returns the mass of the rod per length at arc lengths s, shape (n,), kg/m."""
        if self.radius_points_m is None:
            return np.full(len(s), self.weight_per_length_kg_m)
        return np.asarray(self.density_kg_m3 * math.pi * (self.radius_at(s) ** 2 - self.inner_radius_m**2))

    def rigid_at(self, s: FloatArray) -> BoolArray:
        """Returns whether arc lengths s lie in a rigid stretch, shape (n,)."""
        rigid = np.zeros(len(s), dtype=np.bool_)
        for start, end in self.rigid_stretches_m:
            rigid |= (s > start) & (s <= end)
        return rigid

    @property
    def joins(self) -> tuple[float, ...]:
        """Arc lengths at which a property of the rod, or its slope, jumps, m."""
        points = [s for s, _ in self.radius_points_m or ()]
        return tuple(points + [s for stretch in self.rigid_stretches_m for s in stretch])

    def scaled(self, stiffness: float, mass: float) -> Backbone:
        """Returns a rod with its modulus and all measured stiffness, and with its density, multiplied by factors."""
        changes: dict[str, Any] = {
            "youngs_modulus_pa": stiffness * self.youngs_modulus_pa,
            "density_kg_m3": mass * self.density_kg_m3,
        }
        for key in _MEASURED:
            value = getattr(self, key)
            if value is not None:
                changes[key] = (
                    tuple(stiffness * item for item in value) if isinstance(value, tuple) else (stiffness * value)
                )
        return self.model_copy(update=changes)
