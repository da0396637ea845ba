"""How hard loads press on a robot: what is far beyond bending it was stated in the wrong unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import Domain

LARGEST_LOAD_RATIO = 100.0
"""Loads of more than this many times E I / l^2 hold the robot like a hanging cable; stiffness hardly counts."""
LARGEST_GRAVITY_M_S2 = 100.0
"""Ten times the Earth's."""


def load_ratio(robot: RobotSpec, gravity: ArrayLike, tip_force: ArrayLike) -> FloatArray:
    """Returns (tip force + weight) l^2 / (E I), E I of the softest segment.

    Args:
        robot: The robot.
        gravity: Sizes, shape (n,), m/s^2.
        tip_force: Sizes, shape (n,), N.
    """
    backbones = list(zip(robot.segments, robot.segment_backbones, strict=True))
    mass = robot.disk_masses.sum() + robot.tip.mass_kg
    mass += sum(segment.length_m * backbone.weight_per_length_kg_m for segment, backbone in backbones)
    softest = min(backbone.stiffness_bending_torsion[0] for _, backbone in backbones)
    force = np.asarray(tip_force, dtype=np.float64) + mass * np.asarray(gravity, dtype=np.float64)
    return np.asarray(force * robot.length**2 / softest)


def check_domain(robot: RobotSpec, domain: Domain) -> None:
    """Refuses a domain whose loads no such robot meets, before hours go into solving them.

    Raises:
        InputError: Says which load is too large and in which unit it is expected.
    """
    if domain.gravity_m_s2 > LARGEST_GRAVITY_M_S2:
        raise InputError(
            "domain.gravity_m_s2", f"at most {LARGEST_GRAVITY_M_S2:g} m/s^2 (Earth: 9.81)", domain.gravity_m_s2
        )
    ratio = float(load_ratio(robot, domain.gravity_m_s2, domain.tip_force_n))
    if ratio > LARGEST_LOAD_RATIO:
        raise InputError(
            "domain",
            f"loads that robot {robot.name!r} can carry, (tip force + weight) l^2 / (E I) up to {LARGEST_LOAD_RATIO:g}",
            f"{ratio:.4g} with tip_force_n = {domain.tip_force_n:g} and gravity_m_s2 = {domain.gravity_m_s2:g}; is the "
            "unit of the force newton?",
        )
