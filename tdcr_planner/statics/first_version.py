"""Temporary."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np


class Tendon:
    between_disks = "channel"
    friction_coefficient = 0.0
    sheath_angle = 0.0
    start_disk = 0
    start_arc_length = 0.0

    def __init__(self, offset, end, end_disk, axial, limit):
        self.offset, self.end_arc_length, self.axial_stiffness, self.max_tension = offset, end, axial, limit
        self.end_disk = end_disk

    def offsets(self, s):
        return np.tile(self.offset, (len(s), 1))

    def slopes(self, s):
        return np.zeros((len(s), 2))

    bends = slopes


def mechanics(robot):
    if hasattr(robot, "tendons"):
        return robot
    ends = robot.segment_ends
    of = lambda s: np.clip(np.searchsorted(ends, s), 0, len(ends) - 1)
    st = np.array([[*b.stiffness_shear_extension, *b.stiffness_bending_torsion] for b in robot.segment_backbones])
    rest = np.array([[0, 0, 1.0, *b.rest_curvature_1_m] for b in robot.segment_backbones])
    mass = np.array([b.weight_per_length_kg_m for b in robot.segment_backbones])
    tendons = []
    for i in range(robot.tendon_count):
        seg = robot.tendon_segments[i]
        tendons.append(
            Tendon(
                robot.tendon_offsets[i, :2],
                float(ends[seg]),
                int(np.flatnonzero(robot.disk_segments == seg)[-1]),
                robot.segments[seg].tendon_axial_stiffness_n or np.inf,
                robot.max_tensions[i],
            )
        )
    return SimpleNamespace(
        tendons=tuple(tendons),
        stiffness_at=lambda s: st[of(s)],
        rest_strain_at=lambda s: rest[of(s)],
        mass_per_length_at=lambda s: mass[of(s)],
        rigid_at=lambda s: np.zeros(len(s), bool),
        joins=tuple(ends),
        drive=SimpleNamespace(
            kind="tension", transmission_stiffness=np.inf, pretension=0.0, backlash=0.0, max_displacement=None
        ),
        tip=SimpleNamespace(mass_kg=robot.tip.mass_kg, offset_m=(0.0, 0.0, 0.0)),
        arc_lengths=robot.arc_lengths,
        disk_masses=robot.disk_masses,
        length=robot.length,
        name=robot.name,
    )
