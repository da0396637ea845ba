"""The tendons: what a [[tendons]] table says, and each tendon as mechanics needs it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from tdcr_planner.arrays import FloatArray
from tdcr_planner.files import FileModel, Positive, Vector3
from tdcr_planner.robot.paths import PolarPath, SplinePath, TendonPath, polar_path

BetweenDisks = Literal["channel", "straight"]
LARGEST_FRICTION = 2.0
MOST_POINTS = 10_000
# Of two points of a curve, relative to its length: nearer ones lose the slope between them to rounding.
LEAST_SPACING = 1e-6


class TendonTable(FileModel):
    """One [[tendons]] table of a version 2 file.

    Attributes:
        segment: Number (from 1) of the segment at whose last disk it ends; or
        end_disk: the disk at which it ends.
        start_disk: Disk at which it starts, 0 for the base.
        angle_deg: Angle about z from the base x axis, at its start.
        radius_m: Distance from the backbone, at its start.
        end_radius_m: Distance from the backbone at its end, linear in arc length; None for the same all along.
        turns: Turns about the backbone from start to end, right-handed about z.
        points_m: In place of angle and radius: two or more [s, x, y], s from the robot's base.
        between_disks: "channel": along the backbone at its path's offset; "straight": straight from disk to disk.
        max_tension_n: Largest tension. Required with tension drive.
        friction_coefficient: Coulomb friction along its path and in its sheath.
        sheath_angle_deg: Angle by which its way from drive to base bends.
        axial_stiffness_n: E A; None for a tendon that does not stretch.
    """

    segment: Annotated[int, Field(ge=1)] | None = None
    end_disk: Annotated[int, Field(ge=1)] | None = None
    start_disk: Annotated[int, Field(ge=0)] = 0
    angle_deg: Annotated[float, Field(ge=-1e6, le=1e6)] | None = None
    radius_m: Positive | None = None
    end_radius_m: Positive | None = None
    turns: Annotated[float, Field(ge=-1e3, le=1e3)] | None = None
    points_m: Annotated[tuple[Vector3, ...], Field(max_length=MOST_POINTS)] | None = None
    between_disks: BetweenDisks = "channel"
    max_tension_n: Positive | None = None
    friction_coefficient: Annotated[float, Field(ge=0.0, le=LARGEST_FRICTION)] = 0.0
    sheath_angle_deg: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0
    axial_stiffness_n: Positive | None = None

    @model_validator(mode="after")
    def _check_end(self) -> TendonTable:
        if (self.segment is None) == (self.end_disk is None):
            came = "neither" if self.segment is None else "both"
            raise ValueError(f"expected either segment or end_disk, to say where the tendon ends, got {came}")
        return self

    @model_validator(mode="after")
    def _check_path(self) -> TendonTable:
        polar = {name: getattr(self, name) for name in ("angle_deg", "radius_m", "end_radius_m", "turns")}
        given = [name for name, value in polar.items() if value is not None]
        points = self.points_m
        if points is None:
            missing = [name for name in ("angle_deg", "radius_m") if polar[name] is None]
            if missing:
                raise ValueError(
                    f"expected angle_deg and radius_m, or points_m, to say where the tendon runs; "
                    f"{' and '.join(missing)} missing"
                )
            return self
        if given:
            raise ValueError(f"points_m and {given[0]} exclude one another; give one of them")
        if len(points) < 2:
            raise ValueError(f"points_m: a curve needs two or more points [s, x, y], got {len(points)}")
        least = LEAST_SPACING * abs(points[-1][0] - points[0][0])
        for before, after in itertools.pairwise(points):
            if after[0] - before[0] <= least:
                raise ValueError(
                    f"points_m: a tendon must not double back: arc lengths must increase, got {after[0]:g} m after "
                    f"{before[0]:g} m"
                )
        return self

    def path(self, start: float, end: float) -> TendonPath:
        """Returns the path of this tendon, which runs from one arc length to another, m."""
        if self.points_m is not None:
            return SplinePath.through(np.array(self.points_m))
        assert self.angle_deg is not None
        assert self.radius_m is not None
        return polar_path(start, end, self.angle_deg, self.radius_m, self.end_radius_m, self.turns or 0.0)


@dataclass(frozen=True, eq=False)
class Tendon:
    """A tendon as mechanics needs it; the same for files of both versions.

    Attributes:
        segment: Index of the segment to which its last disk belongs.
        start_disk: Disk at which it starts, 0 for the base.
        end_disk: Disk at which it ends.
        start_arc_length: Arc length of the disk at which it starts, m.
        end_arc_length: Arc length of the disk at which it ends, m.
        path: Its path along the backbone.
        between_disks: "channel": the tendon follows its path between disks too; "straight": it meets its path at the
            disks and runs straight from one to the next.
        friction_coefficient: Coulomb friction.
        sheath_angle: Angle by which its way from drive to base bends, rad.
        axial_stiffness: E A, N; infinite for a tendon that does not stretch.
        max_tension: N; infinite where the file states no limit.
        max_displacement: Lowest and highest displacement by the drive, m; infinite where the file states no limit.
        pretension: Tension of the straight unloaded robot, N.
    """

    segment: int
    start_disk: int
    end_disk: int
    start_arc_length: float
    end_arc_length: float
    path: TendonPath
    between_disks: BetweenDisks
    friction_coefficient: float
    sheath_angle: float
    axial_stiffness: float
    max_tension: float
    max_displacement: tuple[float, float]
    pretension: float

    @property
    def straight_path(self) -> PolarPath | None:
        """Its path where it runs parallel to the backbone at angle and radius; None for any other path."""
        return self.path if isinstance(self.path, PolarPath) and not self.path.kinds else None

    def offsets(self, s: ArrayLike) -> FloatArray:
        """Returns its offset x, y from the backbone in the body frame, shape (n, 2), m, at arc lengths s, (n,), m."""
        return self.path.derivative(np.asarray(s, dtype=np.float64), 0)

    def slopes(self, s: ArrayLike) -> FloatArray:
        """Returns the first derivative of the offset with respect to arc length, shape (n, 2), dimensionless."""
        return self.path.derivative(np.asarray(s, dtype=np.float64), 1)

    def bends(self, s: ArrayLike) -> FloatArray:
        """Returns the second derivative of the offset with respect to arc length, shape (n, 2), 1/m."""
        return self.path.derivative(np.asarray(s, dtype=np.float64), 2)

    def rest_length(self, disk_arc_lengths: FloatArray) -> float:
        """Returns the length of its way along the straight robot from its first to its last disk, m.

        Args:
            disk_arc_lengths: Arc lengths of all disks, shape (d,), m.
        """
        stops = disk_arc_lengths[self.start_disk : self.end_disk + 1]
        if self.between_disks == "straight":
            chords = np.diff(np.column_stack([self.offsets(stops), stops]), axis=0)
            return float(np.linalg.norm(chords, axis=1).sum())
        nodes, weights = np.polynomial.legendre.leggauss(8)
        half = 0.5 * np.diff(stops)
        s = 0.5 * (stops[1:] + stops[:-1])[:, None] + half[:, None] * nodes
        speed = np.sqrt(1.0 + (self.slopes(s.reshape(-1)) ** 2).sum(axis=1)).reshape(s.shape)
        return float((half * (speed @ weights)).sum())


def infinite_if_none(value: float | None) -> float:
    """Returns a value, infinity for None."""
    return math.inf if value is None else value
