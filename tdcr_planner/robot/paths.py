"""The path of a tendon along the unloaded backbone: straight, converging, winding, or through points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tdcr_planner.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


class TendonPath(Protocol):
    """Where a tendon runs: its offset (x, y) from the backbone in the body frame as a function of arc length."""

    @property
    def kinds(self) -> frozenset[str]:
        """Names of what makes this path other than straight; empty for a straight one."""
        ...

    def derivative(self, s: FloatArray, order: int) -> FloatArray:
        """Returns the derivative of the offset with respect to arc length.

        Args:
            s: Arc lengths, shape (n,), m.
            order: 0 for the offset itself, 1 or 2.

        Returns:
            Shape (n, 2), m^(1 - order).
        """
        ...


@dataclass(frozen=True)
class PolarPath:
    """Angle and radius linear in arc length: straight, converging and helical tendons.

    Attributes:
        start: Arc length at which angle and radius hold, m.
        angle: Angle about z from the base x axis at the start, rad.
        radius: Distance from the backbone at the start, m.
        winding: Slope of the angle, rad/m, right-handed about z.
        convergence: Slope of the radius, dimensionless.
    """

    start: float
    angle: float
    radius: float
    winding: float = 0.0
    convergence: float = 0.0

    @property
    def kinds(self) -> frozenset[str]:
        """Names of what makes this path other than straight."""
        names = {"helical tendons": self.winding != 0.0, "converging tendons": self.convergence != 0.0}
        return frozenset(name for name, holds in names.items() if holds)

    def derivative(self, s: FloatArray, order: int) -> FloatArray:
        """Returns the offset or its first or second derivative, shape (n, 2); see `TendonPath`."""
        travelled = np.asarray(s, dtype=np.float64) - self.start
        angle = self.angle + self.winding * travelled
        radius = self.radius + self.convergence * travelled
        along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        if order == 0:
            return np.asarray(radius[..., None] * along)
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        if order == 1:
            return np.asarray(self.convergence * along + (radius * self.winding)[..., None] * across)
        turned = 2.0 * self.convergence * self.winding
        return np.asarray(turned * across - (radius * self.winding**2)[..., None] * along)


@dataclass(frozen=True)
class SplinePath:
    """A cubic spline through points, not-a-knot at its ends; two points are a line, three a parabola.

    Attributes:
        spline: Offset (x, y) as a function of arc length.
    """

    spline: CubicSpline

    @classmethod
    def through(cls, points: FloatArray) -> SplinePath:
        """Returns the curve through points [s, x, y], shape (k, 3), m, with s increasing and k two or more."""
        from scipy.interpolate import CubicSpline  # takes as long to import as all the rest of a robot

        return cls(CubicSpline(points[:, 0], points[:, 1:]))

    @property
    def kinds(self) -> frozenset[str]:
        """Names of what makes this path other than straight."""
        return frozenset({"tendons through points"})

    def derivative(self, s: FloatArray, order: int) -> FloatArray:
        """Returns the offset or its first or second derivative, shape (n, 2); see `TendonPath`."""
        return np.asarray(self.spline(s, order))


def polar_path(
    start: float, end: float, angle_deg: float, radius_m: float, end_radius_m: float | None, turns: float
) -> PolarPath:
    """Returns the path of a tendon that runs from one arc length to another.

    Args:
        start: Arc length at which the tendon starts, m.
        end: Arc length at which it ends, m.
        angle_deg: Its angle at the start, degrees.
        radius_m: Its distance from the backbone at the start, m.
        end_radius_m: The same at the end; None for the same.
        turns: Turns about the backbone from start to end, right-handed about z.
    """
    length = end - start
    change = 0.0 if end_radius_m is None else end_radius_m - radius_m
    angle = float(np.deg2rad(angle_deg))
    return PolarPath(start, angle, radius_m, 2.0 * math.pi * turns / length, change / length)
