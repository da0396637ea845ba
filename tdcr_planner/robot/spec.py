"""The robot: what its file says, as one frozen object for both versions, and the arrays derived from it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.files import FileModel
from tdcr_planner.robot import bending as bending_maps
from tdcr_planner.robot import commands, variants
from tdcr_planner.robot import rod as rod_along
from tdcr_planner.robot.backbone import Backbone
from tdcr_planner.robot.body import Body
from tdcr_planner.robot.checks import check_robot
from tdcr_planner.robot.drive import Drive, DriveTable, drive_of_table
from tdcr_planner.robot.features import features_of
from tdcr_planner.robot.hashing import mechanics_hash
from tdcr_planner.robot.segments import Segment
from tdcr_planner.robot.tendon_list import tendons_of_segments, tendons_of_tables
from tdcr_planner.robot.tendons import Tendon, TendonTable
from tdcr_planner.robot.tip import Camera, Tip
from tdcr_planner.robot.versions import check_version, without_other_version


class RobotSpec(FileModel):
    """A tendon-driven continuum robot, base to tip. Disk 0 is the clamped base.

    What a file of either version says is found in `tendons` and `drive`; the fields `tendon_tables` and `drive_table`
    hold the tables of a version 2 file.

    Attributes:
        format: Version of the file.
        name: The robot's name.
        backbone: The rod of all segments that have none of their own.
        segments: Base to tip.
        tip: What the last disk carries.
        body: What stands between disks, for collision.
        tendon_tables: The tables [[tendons]]; empty in version 1.
        drive_table: The table [drive]; None in version 1.
        camera: The camera at the tip, or None.
    """

    format: Literal["tdcr-robot/1", "tdcr-robot/2"]
    name: Annotated[str, Field(min_length=1)]
    backbone: Backbone
    segments: Annotated[tuple[Segment, ...], Field(min_length=1)]
    tip: Tip = Tip()
    body: Body = Body()
    tendon_tables: tuple[TendonTable, ...] = Field(default=(), alias="tendons")
    drive_table: DriveTable | None = Field(default=None, alias="drive")
    camera: Camera | None = None

    @model_validator(mode="after")
    def _check(self) -> RobotSpec:
        check_version(self)
        check_robot(self)
        return self

    @model_serializer(mode="wrap")
    def _serialize(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Returns the content as its file has it: under the file's keys, without those of the other version."""
        return without_other_version(handler(self), self.format)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> RobotSpec:  # noqa: ARG002
        """Returns a copy with some keys of the file replaced, checked anew.

        The arrays derived from the fields are computed again, which pydantic's own copy would not do.
        """
        return RobotSpec.model_validate({**self.model_dump(), **(update or {})})

    def scaled(self, *, stiffness: float = 1.0, mass: float = 1.0) -> RobotSpec:
        """Returns a robot with all backbone stiffness, and all masses (backbone, disks, payload), times factors."""
        return variants.scaled(self, stiffness, mass)

    def with_tension_limits_times(self, factor: float) -> RobotSpec:
        """Returns a robot whose tension limits are multiplied by a factor."""
        return variants.with_tension_limits_times(self, factor)

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
        return len(self.tendons)

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
    def segment_starts(self) -> FloatArray:
        """Arc length at which each segment starts, shape (segments,), m."""
        return np.concatenate([[0.0], self.segment_ends[:-1]])

    @cached_property
    def segment_backbones(self) -> tuple[Backbone, ...]:
        """The backbone of each segment."""
        return tuple(segment.backbone or self.backbone for segment in self.segments)

    @cached_property
    def arc_lengths(self) -> FloatArray:
        """Arc length of each disk, base included, shape (d,), m."""
        places = [segment.disk_places for segment in self.segments]
        return np.concatenate([[0.0], *(start + own for start, own in zip(self.segment_starts, places, strict=True))])

    @cached_property
    def disk_segments(self) -> IntArray:
        """Index of the segment to which each disk belongs (the base to the first), shape (d,)."""
        return self._per_disk([float(i) for i in range(self.segment_count)], 0.0).astype(np.int64)

    @cached_property
    def disk_masses(self) -> FloatArray:
        """Mass of each disk without the payload, shape (d,), kg; the base has none."""
        return np.concatenate([[0.0], *(segment.masses for segment in self.segments)])

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
    def tendons(self) -> tuple[Tendon, ...]:
        """The tendons in the order of all arrays of tensions and displacements."""
        if self.format == "tdcr-robot/1":
            return tendons_of_segments(self)
        return tendons_of_tables(self)

    @cached_property
    def drive(self) -> Drive:
        """What moves the tendons."""
        if self.format == "tdcr-robot/2":
            return drive_of_table(self.drive_table or DriveTable(), len(self.tendon_tables))
        low, high = np.array([tendon.max_displacement for tendon in self.tendons]).T.copy()
        count = len(self.tendons)
        return Drive("tension", np.full(count, np.inf), self.pretensions, np.zeros(count), (low, high))

    @cached_property
    def tendon_segments(self) -> IntArray:
        """Index of the segment in which each tendon ends, shape (t,)."""
        return np.array([tendon.segment for tendon in self.tendons], dtype=np.int64)

    @cached_property
    def tendon_angles(self) -> FloatArray:
        """Angle of each tendon about z from the base x axis, shape (t,), rad; straight tendons only."""
        return np.array([path.angle for path in bending_maps.straight_paths(self)])

    @cached_property
    def tendon_radii(self) -> FloatArray:
        """Distance of each tendon from the backbone, shape (t,), m; straight tendons only."""
        return np.array([path.radius for path in bending_maps.straight_paths(self)])

    @cached_property
    def tendon_offsets(self) -> FloatArray:
        """Offset r_i of each tendon from the backbone in the disk frame, shape (t, 3), m; straight tendons only.

        The third component is zero.
        """
        radius, angle = self.tendon_radii, self.tendon_angles
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros_like(angle)], axis=1)

    @cached_property
    def max_tensions(self) -> FloatArray:
        """Largest tension of each tendon, shape (t,), N; infinite where the file states no limit."""
        return np.array([tendon.max_tension for tendon in self.tendons])

    @cached_property
    def pretensions(self) -> FloatArray:
        """Tension of each tendon in the straight unloaded robot; the bending map adds it. Shape (t,), N."""
        return np.array([tendon.pretension for tendon in self.tendons])

    @cached_property
    def tendon_stiffnesses(self) -> FloatArray:
        """Axial stiffness E A of each tendon, shape (t,), N; infinite for one that does not stretch."""
        return np.array([tendon.axial_stiffness for tendon in self.tendons])

    @cached_property
    def joins(self) -> FloatArray:
        """Arc lengths at which stiffness, weight, rest shape or the set of tendons jumps or has a kink, sorted, m.

        Ends of segments, taper points, ends of rigid stretches and the ends of tendons; shape (j,). Those of the base
        are left out; the last is the robot's length.
        """
        return rod_along.joins(self)

    def stiffness_at(self, s: ArrayLike) -> FloatArray:
        """Returns the diagonals of Kse (N) and Kbt (N m^2) at arc lengths s, (n,), m, shape (n, 6).

        At an arc length where a property jumps the side towards the base counts. Rigid stretches have the stiffness
        that the rod would have; `rigid_at` tells them.
        """
        return rod_along.along(self, s, lambda rod, _, place: rod.stiffness_at(place))

    def rest_strain_at(self, s: ArrayLike) -> FloatArray:
        """Returns v* and u* of the unloaded rod at arc lengths s, (n,), m, shape (n, 6), dimensionless and 1/m."""
        return rod_along.along(
            self, s, lambda rod, _, place: np.tile([0.0, 0.0, 1.0, *rod.rest_curvature_1_m], (len(place), 1))
        )

    def mass_per_length_at(self, s: ArrayLike) -> FloatArray:
        """Returns the backbone's mass per length at arc lengths s, (n,), m, shape (n,), kg/m."""
        return rod_along.along(self, s, lambda rod, _, place: rod.mass_per_length_at(place))

    def backbone_radius_at(self, s: ArrayLike) -> FloatArray:
        """Returns the backbone's outer radius at arc lengths s, (n,), m, shape (n,), m."""
        return rod_along.along(self, s, lambda rod, _, place: rod.radius_at(place))

    def rigid_at(self, s: ArrayLike) -> BoolArray:
        """Returns whether the rod keeps its rest shape at arc lengths s, (n,), m, shape (n,)."""
        rigid = rod_along.along(
            self, s, lambda rod, segment, place: (rod.rigid_at(place) | segment.rigid).astype(np.float64)
        )
        return rigid > 0.0

    @cached_property
    def backbone_mass(self) -> float:
        """Mass of the whole backbone, kg."""
        return rod_along.backbone_mass(self)

    @cached_property
    def segment_circles(self) -> tuple[tuple[IntArray, float], ...]:
        """The tendons that end in each segment, and the radius of the circle on which they stand, m.

        Asking for it raises InputError where tendons are not straight or do not surround the backbone on one circle.
        """
        return bending_maps.segment_circles(self)

    @cached_property
    def features(self) -> frozenset[str]:
        """Names of what this robot has that a version 1 file cannot say; empty for a version 1 file."""
        return features_of(self)

    @cached_property
    def mechanics_hash(self) -> str:
        """SHA-256 over all that decides the shape under given actuation and loads.

        Name, limits, camera and body are left out: changing them leaves a trained shape model valid. A version 2 file
        that only says what version 1 can say has the hash of its version 1 twin.
        """
        return mechanics_hash(self)

    def tensions_from_bending(self, bending: ArrayLike) -> FloatArray:
        """Returns the tensions of least sum that produce a bending vector, plus the pretension.

        All tendons of a segment stand on one circle, so the least sum uses the two neighbours between which the
        bending vector points. Tension limits are not applied here.

        Args:
            bending: Shape (n, segments, 2), N, equivalent tendon force at the tendon circle, base x and y.

        Returns:
            Shape (n, t), N.

        Raises:
            InputError: The shape is wrong, or tendons are not straight or do not surround the backbone on one circle.
        """
        return bending_maps.tensions_from_bending(self, bending)

    def bending_from_tensions(self, tensions: ArrayLike) -> FloatArray:
        """Returns bending vectors sum_i tau_i (cos a_i, sin a_i), shape (n, segments, 2), N, of tensions (n, t), N."""
        return bending_maps.bending_from_tensions(self, tensions)

    def displacements_from_bending(self, bending: ArrayLike, *, compensated: bool = False) -> FloatArray:
        """Returns the tendon displacements of a bending vector, q_i = b . (cos a_i, sin a_i); see `bending`.

        Args:
            bending: Shape (n, segments, 2), m at the tendon circle, base x and y.
            compensated: Whether a tendon follows the bending of the segments that it passes, too.

        Returns:
            Shape (n, t), m; released tendons are negative.
        """
        return bending_maps.displacements_from_bending(self, bending, compensated=compensated)

    def check_tensions(self, tensions: ArrayLike) -> FloatArray:
        """Returns tensions as shape (n, t), N, or raises InputError: one row a case, none negative, all finite.

        Negative by rounding counts as 0. Tension limits are not checked here: the statics are valid beyond them.
        """
        return commands.check_tensions(self, tensions)

    def check_displacements(self, displacements: ArrayLike) -> FloatArray:
        """Returns displacements as shape (n, t), m, or raises InputError: one row a case, all finite.

        A tendon cannot be pulled by its own length or more. Limits of the drive are not checked here.
        """
        return commands.check_displacements(self, displacements)

    @cached_property
    def rest_path_lengths(self) -> FloatArray:
        """Length of each tendon's way along the straight robot, shape (t,), m."""
        return np.array([tendon.rest_length(self.arc_lengths) for tendon in self.tendons])
