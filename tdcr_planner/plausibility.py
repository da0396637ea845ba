"""Plausibility of a robot: values that no robot has, each with the unit in which it was probably given."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tdcr_planner.robot import Backbone, RobotSpec, Segment, Tendon

# Young's modulus from the softest silicone to diamond, Pa; density from foam to osmium, kg/m^3.
SOFTEST_PA, STIFFEST_PA = 1e4, 1.3e12
LIGHTEST_KG_M3, DENSEST_KG_M3 = 100.0, 2.5e4
# A disk may carry some more than itself; a robot is longer than a grain and shorter than a house.
DENSEST_DISK_KG_M3 = 2.0 * DENSEST_KG_M3
SHORTEST_M, LONGEST_M = 1e-3, 20.0
# Full tension bends a segment by some radians; its own weight, times l^2 / (E I), is some units at most.
MOST_TURNS = 10.0
LARGEST_WEIGHT_RATIO = 100.0
LARGEST_STRAIN_LIMIT = 0.5
# A tendon that leans from the backbone by more than this slope (63 degrees) turns the robot rather than bending it.
STEEPEST_ROUTING = 2.0
SOFTEST_TRANSMISSION_N_M, THINNEST_TENDON_N = 20.0, 1.0


def doubts(robot: RobotSpec) -> list[str]:
    """Returns a sentence on every value of a robot that is far outside of any real robot's; none for a plausible one.

    Each names the key, the value and the unit that was probably meant.
    """
    found = [*_doubt_sizes(robot)]
    for place, backbone in _backbones(robot):
        found += _doubt_backbone(place, backbone)
    for index, (segment, backbone) in enumerate(zip(robot.segments, robot.segment_backbones, strict=True)):
        found += _doubt_segment(f"segments[{index + 1}]", segment, backbone)
    found += [*_doubt_tendons(robot), *_doubt_drive_and_tip(robot)]
    if not found:
        found += _doubt_weight(robot)
    return found


def _backbones(robot: RobotSpec) -> Iterator[tuple[str, Backbone]]:
    yield "backbone", robot.backbone
    for index, segment in enumerate(robot.segments):
        if segment.backbone is not None:
            yield f"segments[{index + 1}].backbone", segment.backbone


def _doubt_sizes(robot: RobotSpec) -> Iterator[str]:
    if robot.length > LONGEST_M:
        yield f"segments: a robot of {robot.length:g} m is longer than any; is length_m in mm?"
    if robot.length < SHORTEST_M:
        yield f"segments: a robot of {robot.length:g} m is shorter than any; length_m is in metres"
    widest = max(segment.disk_radius_m for segment in robot.segments)
    if widest > robot.length:
        yield f"segments: disk_radius_m = {widest:g} is more than its length of {robot.length:g} m; is it in mm?"


def _doubt_backbone(place: str, backbone: Backbone) -> Iterator[str]:
    modulus, density = backbone.youngs_modulus_pa, backbone.density_kg_m3
    if modulus < SOFTEST_PA:
        yield (
            f"{place}.youngs_modulus_pa = {modulus:g} is softer than any rubber; is it in GPa? "
            f"{modulus:g} GPa is {modulus * 1e9:g} Pa"
        )
    if modulus > STIFFEST_PA:
        yield f"{place}.youngs_modulus_pa = {modulus:g} is stiffer than diamond; steel has 2.1e11 Pa"
    if 0.0 < density < LIGHTEST_KG_M3:
        yield (
            f"{place}.density_kg_m3 = {density:g} is lighter than any rod; is it in g/cm^3? "
            f"{density:g} g/cm^3 is {density * 1e3:g} kg/m^3"
        )
    if density > DENSEST_KG_M3:
        yield f"{place}.density_kg_m3 = {density:g} is denser than any metal; steel has 7850 kg/m^3"
    if backbone.max_strain is not None and backbone.max_strain > LARGEST_STRAIN_LIMIT:
        yield (
            f"{place}.max_strain = {backbone.max_strain:g} is more than any backbone bears; is it in %? "
            f"{backbone.max_strain:g} % is {backbone.max_strain / 100.0:g}"
        )


def _doubt_segment(place: str, segment: Segment, backbone: Backbone) -> Iterator[str]:
    volume = math.pi * segment.disk_radius_m**2 * segment.disk_thickness_m
    mass = segment.disk_mass_kg
    if mass > DENSEST_DISK_KG_M3 * volume:
        yield (
            f"{place}.disk_mass_kg = {mass:g} makes a disk of {1e6 * volume:.2g} cm^3 denser than any metal; "
            f"is it in g? {mass:g} g is {mass * 1e-3:g} kg"
        )
    rest = float(np.hypot(*backbone.rest_curvature_1_m[:2]))
    if rest * segment.disk_radius_m > 1.0:
        yield f"{place}: a rest_curvature_1_m of {rest:g} 1/m makes neighbouring disks meet; it is expected in 1/m"


def _doubt_tendons(robot: RobotSpec) -> Iterator[str]:
    """Doubts tensions that would wind up the robot, displacements of many lengths, and steep routings."""
    told: set[int] = set()
    for index, tendon in enumerate(robot.tendons):
        place, key = f"tendons[{index + 1}]", "max_displacement_m of [drive]"
        if robot.format == "tdcr-robot/1":
            if tendon.segment in told:
                continue
            told.add(tendon.segment)
            place, key = f"segments[{tendon.segment + 1}]", "max_tendon_displacement_m"
        segment, backbone = robot.segments[tendon.segment], robot.segment_backbones[tendon.segment]
        limit = tendon.max_displacement[1]
        if 10.0 * segment.length_m < limit < math.inf:
            yield f"{place}.{key} = {limit:g} is many times the segment's length; is it in mm?"
        yield from _doubt_tension(place, tendon, segment, backbone)
        steepest = float(
            np.linalg.norm(tendon.slopes(robot.arc_lengths[tendon.start_disk : tendon.end_disk + 1]), axis=1).max()
        )
        if steepest > STEEPEST_ROUTING:
            yield (
                f"{place}: its path leans from the backbone by up to {math.degrees(math.atan(steepest)):.0f} degrees; "
                "are turns or points_m as they should be?"
            )


def _doubt_tension(place: str, tendon: Tendon, segment: Segment, backbone: Backbone) -> Iterator[str]:
    tension = tendon.max_tension
    if math.isinf(tension):
        return
    radius = float(np.linalg.norm(tendon.offsets([tendon.end_arc_length])))
    curvature = tension * radius / min(backbone.stiffness_bending_torsion[:2])
    turns = curvature * segment.length_m / (2.0 * math.pi)
    modulus = backbone.youngs_modulus_pa
    if modulus >= SOFTEST_PA and (turns > MOST_TURNS or curvature * backbone.radius_m > 1.0):
        question = (
            f"is youngs_modulus_pa = {modulus:g} in MPa? {modulus:g} MPa is {modulus * 1e6:g} Pa"
            if modulus < 1e7
            else f"is it in mN? {tension:g} mN is {tension * 1e-3:g} N"
        )
        yield f"{place}.max_tension_n = {tension:g} would bend the segment by {turns:.3g} turns; {question}"


def _doubt_drive_and_tip(robot: RobotSpec) -> Iterator[str]:
    softest = float(robot.drive.transmission_stiffness.min())
    if softest < SOFTEST_TRANSMISSION_N_M:
        yield (
            f"drive.transmission_stiffness_n_m = {softest:g} is softer than a rubber band; is it in N/mm? "
            f"{softest:g} N/mm is {softest * 1e3:g} N/m"
        )
    thinnest = float(robot.tendon_stiffnesses.min())
    if robot.format == "tdcr-robot/2" and thinnest < THINNEST_TENDON_N:
        yield f"tendons: axial_stiffness_n = {thinnest:g} is softer than a thread of rubber; it is E A, in N"
    offset = math.hypot(*robot.tip.offset_m)
    if offset > robot.length:
        yield f"tip.offset_m: {offset:g} m is more than the robot's length; is it in mm?"
    if robot.camera is not None and robot.camera.range_m[1] > LONGEST_M:
        yield f"camera.range_m: a camera that sees {robot.camera.range_m[1]:g} m far is no endoscope; is it in mm?"


def _doubt_weight(robot: RobotSpec) -> Iterator[str]:
    mass = robot.disk_masses.sum() + robot.tip.mass_kg + robot.backbone_mass
    softest = min(min(backbone.stiffness_bending_torsion[:2]) for backbone in robot.segment_backbones)
    ratio = 9.81 * mass * robot.length**2 / softest
    if ratio > LARGEST_WEIGHT_RATIO:
        what = "tip.mass_kg" if robot.tip.mass_kg > 0.5 * mass else "disk_mass_kg and density_kg_m3"
        yield (
            f"the robot weighs {mass:g} kg, {ratio:.3g} times what bends it ((weight) l^2 / (E I)): it hangs like a "
            f"cable; is {what} in g, or youngs_modulus_pa in MPa?"
        )
