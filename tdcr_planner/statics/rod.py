"""The rod as the kernels see it: a robot's stiffness, tendons, masses and integration steps as plain arrays."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec

DEFAULT_STEPS = 20


class RodArrays(NamedTuple):
    """What the kernels need of a robot; k segments, t tendons, d disks, c steps.

    Attributes:
        stiffness: Diagonals of Kse and Kbt, shape (k, 6), N and N m^2.
        rest_strain: v* and u*, shape (k, 6), dimensionless and 1/m.
        first_tendon: Index of the first tendon still present in each segment, shape (k,); those after it pass too.
        offsets: x and y of each tendon in the disk frame, shape (t, 2), m.
        weight_per_length: Mass per length of each segment's backbone, shape (k,), kg/m.
        disk_masses: Mass at each disk, the payload included at the last, shape (d,), kg.
        step_lengths: Shape (c,), m.
        step_segments: Segment of each step, shape (c,).
        step_disks: Disk at the end of each step, -1 where there is none, shape (c,).
        length: Arc length of the unloaded robot, shape (1,), m.
    """

    stiffness: FloatArray
    rest_strain: FloatArray
    first_tendon: IntArray
    offsets: FloatArray
    weight_per_length: FloatArray
    disk_masses: FloatArray
    step_lengths: FloatArray
    step_segments: IntArray
    step_disks: IntArray
    length: FloatArray


def rod_arrays(robot: RobotSpec, steps_per_gap: int | None = None) -> RodArrays:
    """Returns a robot's arrays for the kernels.

    Args:
        robot: The robot.
        steps_per_gap: Integration steps between neighbouring disks; None for as many as keep every step at or below
            1/20 of the robot's length.

    Raises:
        InputError: steps_per_gap is below 1.
    """
    if steps_per_gap is not None and steps_per_gap < 1:
        raise InputError("steps_per_gap", "a whole number of 1 or more, or None", steps_per_gap)
    return _cached_rod_arrays(robot, steps_per_gap)


@lru_cache(maxsize=64)
def _cached_rod_arrays(robot: RobotSpec, steps_per_gap: int | None) -> RodArrays:
    lengths: list[float] = []
    segments: list[int] = []
    disks: list[int] = []
    disk = 0
    for index, segment in enumerate(robot.segments):
        gap = segment.length_m / segment.disks
        steps = steps_per_gap or max(1, math.ceil(gap * DEFAULT_STEPS / robot.length - 1e-9))
        for _ in range(segment.disks):
            disk += 1
            lengths += [gap / steps] * steps
            segments += [index] * steps
            disks += [-1] * (steps - 1) + [disk]
    masses = robot.disk_masses.copy()
    masses[-1] += robot.tip.mass_kg
    backbones = robot.segment_backbones
    return RodArrays(
        stiffness=np.array([[*b.stiffness_shear_extension, *b.stiffness_bending_torsion] for b in backbones]),
        rest_strain=np.array([[0.0, 0.0, 1.0, *b.rest_curvature_1_m] for b in backbones]),
        first_tendon=np.searchsorted(robot.tendon_segments, np.arange(robot.segment_count)).astype(np.int64),
        offsets=np.ascontiguousarray(robot.tendon_offsets[:, :2]),
        weight_per_length=np.array([b.weight_per_length_kg_m for b in backbones]),
        disk_masses=masses,
        step_lengths=np.array(lengths),
        step_segments=np.array(segments, dtype=np.int64),
        step_disks=np.array(disks, dtype=np.int64),
        length=np.array([robot.length]),
    )
