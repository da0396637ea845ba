"""The rod as arrays, a row an integration step: stiffness, rest shape, tendon paths and masses along the arc length."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec

DEFAULT_STEPS = 20
STAGE_POINTS = 3
"""Points of a step at which quantities are given: start, middle and end."""
POINT_OF_STAGE = (0, 1, 1, 2)
"""The stage point of each of the four Runge-Kutta stages."""
# Where a quantity may jump at a step's end, it is read this fraction of the step inside.
_INSIDE = 1e-9


class GapColumn(IntEnum):
    """Columns of a gap table: a row from one disk to the next of a rod that is uniform in between.

    Stiffnesses in N m^2 (bending, twist) and N (shear, axial); rest curvature in 1/m; lengths in m, masses in kg.
    """

    LENGTH = 0
    BENDING_X = 1
    BENDING_Y = 2
    TWIST = 3
    SHEAR_X = 4
    SHEAR_Y = 5
    AXIAL = 6
    REST_X = 7
    REST_Y = 8
    REST_TWIST = 9
    MASS_PER_LENGTH = 10
    DISK_MASS = 11


class RodArrays(NamedTuple):
    """All that the mechanics need of a robot: c steps of 3 stage points each (start, middle, end), t tendons, d disks.

    Tendons of a step stand in its first `tendon_counts` columns; other columns are zero.

    Attributes:
        step_lengths: Shape (c,), m.
        joins: Whether something may jump where the step starts (stiffness, tendons, rest shape), shape (c,).
        rigid: Whether the step does not deform, shape (c,).
        repeats: Whether the step is in all that follows as the one before, and the same all along, shape (c,).
        stiffness: Diagonals of Kse and Kbt, shape (c, 3, 6), N and N m^2.
        rest_strain: v* and u*, shape (c, 3, 6), dimensionless and 1/m.
        tendon_counts: Number of tendons in the step, shape (c,).
        tendons: Index of each tendon in the step, shape (c, t).
        places: Column of each tendon in the step, -1 where it does not run, shape (c, t).
        offsets: r, x and y of each tendon in the backbone's frame, shape (c, 3, t, 2), m. For tendons that run straight
            from disk to disk these are the offsets in the rest shape.
        slopes: r', derivative of the offsets by arc length, shape (c, 3, t, 2), dimensionless.
        chords: Half the distance of the disks between which the tendons run straight, and the arc length of the point
            from their middle, shape (c, 3, 2), m; zero where the tendons run in channels.
        step_masses: Mass of the backbone from the step's start to its middle and to its end, shape (c, 2), kg.
        step_disks: Disk at the end of the step, -1 where there is none, shape (c,).
        disk_masses: Mass at each disk, the payload included at the last, shape (d,), kg.
        payload: Mass of the payload (kg) and its place in the last disk's frame (m), shape (4,).
        length: Arc length of the unloaded robot, shape (1,), m.
    """

    step_lengths: FloatArray
    joins: BoolArray
    rigid: BoolArray
    repeats: BoolArray
    stiffness: FloatArray
    rest_strain: FloatArray
    tendon_counts: IntArray
    tendons: IntArray
    places: IntArray
    offsets: FloatArray
    slopes: FloatArray
    chords: FloatArray
    step_masses: FloatArray
    step_disks: IntArray
    disk_masses: FloatArray
    payload: FloatArray
    length: FloatArray

    @property
    def ends(self) -> FloatArray:
        """Arc length of the end of each step, shape (c,), m."""
        return np.cumsum(self.step_lengths)

    @property
    def stage_lengths(self) -> FloatArray:
        """Arc length of each Runge-Kutta stage, shape (c, 4), m."""
        ends = self.ends
        starts = ends - self.step_lengths
        middles = 0.5 * (starts + ends)
        return np.stack([starts, middles, middles, ends], axis=1)

    def steps_of(self, tendon: int) -> tuple[IntArray, IntArray]:
        """Returns the steps that a tendon runs through and its column in each of them."""
        columns = np.arange(self.tendons.shape[1])
        steps, places = np.nonzero((self.tendons == tendon) & (columns < self.tendon_counts[:, None]))
        return steps.astype(np.int64), places.astype(np.int64)


def rod_arrays(robot: RobotSpec, steps_per_gap: int | None = None) -> RodArrays:
    """Returns a robot's arrays.

    Steps end at every disk and wherever stiffness, rest shape or tendons may jump.

    Args:
        robot: The robot.
        steps_per_gap: Integration steps between neighbouring such places; None for as many as keep every step at or
            below 1/20 of the robot's length.

    Raises:
        InputError: steps_per_gap is below 1.
    """
    if steps_per_gap is not None and steps_per_gap < 1:
        raise InputError("steps_per_gap", "a whole number of 1 or more, or None", steps_per_gap)
    return _cached_rod_arrays(robot, steps_per_gap)


@lru_cache(maxsize=64)
def _cached_rod_arrays(robot: RobotSpec, steps_per_gap: int | None) -> RodArrays:
    stops = _stops(robot)
    lengths: list[float] = []
    starts: list[float] = []
    for start, stop in pairwise(stops.tolist()):
        gap = stop - start
        steps = steps_per_gap or max(1, math.ceil(gap * DEFAULT_STEPS / robot.length - 1e-9))
        lengths += [gap / steps] * steps
        starts += [start + gap / steps * i for i in range(steps)]
    h, s = np.array(lengths), np.array(starts)
    middles = s + 0.5 * h
    inside = s[:, None] + h[:, None] * np.array([_INSIDE, 0.5, 1.0 - _INSIDE])
    points = s[:, None] + h[:, None] * np.array([0.0, 0.5, 1.0])
    near = 1e-9 * robot.length
    counts, tendons, offsets, slopes, chords = _tendon_paths(robot, points, middles)
    masses = robot.disk_masses.copy()
    masses[-1] += robot.tip.mass_kg
    places = np.full_like(tendons, -1)
    for column in range(tendons.shape[1]):
        present = np.flatnonzero(counts > column)
        places[present, tendons[present, column]] = column
    stiffness, rest = _at_points(robot.stiffness_at, inside), _at_points(robot.rest_strain_at, inside)
    rigid = np.ascontiguousarray(robot.rigid_at(middles), dtype=np.bool_)
    alike = np.abs(np.diff(h, prepend=np.inf)) <= near
    for values in (rigid, counts, tendons, stiffness, rest, offsets, slopes, chords):
        alike &= _repeated(values)
    return RodArrays(
        step_lengths=h,
        joins=np.abs(s[:, None] - np.array([0.0, *robot.joins])[None, :]).min(axis=1) <= near,
        rigid=rigid,
        repeats=alike,
        stiffness=stiffness,
        rest_strain=rest,
        tendon_counts=counts,
        tendons=tendons,
        places=places,
        offsets=offsets,
        slopes=slopes,
        chords=chords,
        step_masses=_step_masses(robot, s, h),
        step_disks=_disks_at(robot, s + h),
        disk_masses=masses,
        payload=np.array([robot.tip.mass_kg, *robot.tip.offset_m], dtype=np.float64),
        length=np.array([robot.length]),
    )


def gap_table(rod: RodArrays) -> FloatArray:
    """Returns the rows of a rod that has one uniform step from disk to disk, columns as in `GapColumn`.

    The mass of a disk includes the payload at the last one. Where the rod tapers, the middle of each gap counts.
    """
    table = np.empty((len(rod.step_lengths), len(GapColumn)))
    table[:, GapColumn.LENGTH] = rod.step_lengths
    table[:, GapColumn.BENDING_X : GapColumn.TWIST + 1] = rod.stiffness[:, 1, 3:]
    table[:, GapColumn.SHEAR_X : GapColumn.AXIAL + 1] = rod.stiffness[:, 1, :3]
    table[:, GapColumn.REST_X : GapColumn.REST_TWIST + 1] = rod.rest_strain[:, 1, 3:]
    table[:, GapColumn.MASS_PER_LENGTH] = rod.step_masses[:, 1] / rod.step_lengths
    table[:, GapColumn.DISK_MASS] = np.where(rod.step_disks >= 0, rod.disk_masses[rod.step_disks], 0.0)
    return table


def _repeated(values: NDArray[Any]) -> BoolArray:
    """Returns for each step whether its values are those of the step before, and the same at its stage points."""
    same = np.concatenate([[False], (values[1:] == values[:-1]).reshape(len(values) - 1, -1).all(axis=1)])
    if values.ndim > 2:
        same &= (values == values[:, :1]).reshape(len(values), -1).all(axis=1)
    return same


def _stops(robot: RobotSpec) -> FloatArray:
    """Returns the disks and the joins by arc length; joins within rounding of a disk are that disk."""
    disks = np.asarray(robot.arc_lengths)
    joins = np.asarray(robot.joins, dtype=np.float64)
    apart = np.abs(joins[:, None] - disks[None, :]).min(axis=1, initial=np.inf) > 1e-9 * robot.length
    return np.unique(np.concatenate([disks, joins[apart]]))


def _at_points(function: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    values = function(points.ravel())
    return np.ascontiguousarray(values.reshape(*points.shape, 6))


def _step_masses(robot: RobotSpec, starts: FloatArray, lengths: FloatArray) -> FloatArray:
    """Returns the mass from each step's start to its middle and to its end, by Simpson's rule on each half."""
    fractions = np.array([_INSIDE, 0.25, 0.5, 0.75, 1.0 - _INSIDE])
    points = starts[:, None] + lengths[:, None] * fractions
    density = np.asarray(robot.mass_per_length_at(points.ravel()), dtype=np.float64).reshape(points.shape)
    halves = np.stack([density[:, :3] @ np.array([1.0, 4.0, 1.0]), density[:, 2:] @ np.array([1.0, 4.0, 1.0])], axis=1)
    return np.ascontiguousarray(np.cumsum(halves * (lengths / 12.0)[:, None], axis=1))


def _disks_at(robot: RobotSpec, ends: FloatArray) -> IntArray:
    distance = np.abs(ends[:, None] - np.asarray(robot.arc_lengths)[None, 1:])
    return np.where(distance.min(axis=1) <= 1e-9 * robot.length, distance.argmin(axis=1) + 1, -1).astype(np.int64)


def _tendon_paths(
    robot: RobotSpec, points: FloatArray, middles: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Returns which tendons run through each step, and their paths: the last five kinds of `RodArrays`' tendon arrays.

    A tendon that runs straight from disk to disk has, in the rest shape, offsets linear between its holes.
    """
    steps, total = len(points), len(robot.tendons)
    counts, tendons = np.zeros(steps, dtype=np.int64), np.zeros((steps, total), dtype=np.int64)
    offsets, slopes = np.zeros((steps, 3, total, 2)), np.zeros((steps, 3, total, 2))
    chords = np.zeros((steps, 3, 2))
    disks = np.asarray(robot.arc_lengths)
    owner = np.clip(np.searchsorted(disks, middles) - 1, 0, len(disks) - 2)
    first, last = disks[owner], disks[owner + 1]
    straight = any(tendon.between_disks == "straight" for tendon in robot.tendons)
    if straight:
        if not all(tendon.between_disks == "straight" for tendon in robot.tendons):
            raise InputError("robot", "all tendons in channels, or all straight between disks", "a mixture of both")
        chords[..., 0] = 0.5 * (last - first)[:, None]
        chords[..., 1] = points - 0.5 * (first + last)[:, None]
    for index, tendon in enumerate(robot.tendons):
        present = np.flatnonzero((middles > tendon.start_arc_length) & (middles < tendon.end_arc_length))
        columns = counts[present]
        tendons[present, columns] = index
        if straight:
            ends = [np.asarray(tendon.offsets(end[present])) for end in (first, last)]
            slope = (ends[1] - ends[0]) / (last - first)[present, None]
            along = points[present] - first[present, None]
            offsets[present, :, columns] = ends[0][:, None] + along[..., None] * slope[:, None]
            slopes[present, :, columns] = slope[:, None]
        else:
            inside = np.clip(points[present], tendon.start_arc_length, tendon.end_arc_length)
            shape = (*inside.shape, 2)
            offsets[present, :, columns] = np.asarray(tendon.offsets(inside.ravel())).reshape(shape)
            slopes[present, :, columns] = np.asarray(tendon.slopes(inside.ravel())).reshape(shape)
        counts[present] += 1
    return counts, tendons, offsets, slopes, chords
