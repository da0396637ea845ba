"""How hard loads press on a robot: what is far beyond bending it was stated in the wrong unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.card import Domain
from tdcr_planner.statics.solver import solve_statics

LARGEST_LOAD_RATIO = 100.0
"""Loads of more than this many times E I / l^2 hold the robot like a hanging cable; stiffness hardly counts."""
LARGEST_GRAVITY_M_S2 = 100.0
"""Ten times the Earth's."""


def tip_compliance(robot: RobotSpec) -> float:
    """Returns how far a small lateral force at the tip moves the straight, unactuated robot there, m/N.

    The integral of (l - s)^2 / (E I) over the length (Gere and Goodno, Mechanics of Materials, ch. 9).
    """
    compliance, remaining = 0.0, robot.length
    for segment, backbone in zip(robot.segments, robot.segment_backbones, strict=True):
        beyond = remaining - segment.length_m
        compliance += (remaining**3 - beyond**3) / (3.0 * backbone.stiffness_bending_torsion[0])
        remaining = beyond
    return compliance


@dataclass(frozen=True)
class TipMotion:
    """How far the largest loads of a domain move the tip of the unactuated robot, m; NaN where it cannot carry them.

    Attributes:
        gravity_m: By gravity.
        tip_force_m: By the tip force.
    """

    gravity_m: float
    tip_force_m: float

    def describe(self, robot: RobotSpec, domain: Domain) -> str:
        """Returns the loads with what they do, one line a load."""

        def line(name: str, size: str, motion: float) -> str:
            if not np.isfinite(motion):
                return f"{name} up to {size}: more than the unactuated robot carries"
            return f"{name} up to {size}: moves the unactuated tip by {1e3 * motion:.3g} mm, " + (
                f"{motion / robot.length:.0%} of the length"
            )

        return "\n".join(
            [
                line("gravity", f"{domain.gravity_m_s2:g} m/s^2", self.gravity_m),
                line("tip force", f"{domain.tip_force_n:g} N", self.tip_force_m),
            ]
        )


def tip_motion(robot: RobotSpec, domain: Domain) -> TipMotion:
    """Returns how far the domain's largest loads, each alone and across the base axes, move the unactuated tip."""
    sides = np.concatenate([np.eye(3)[:2], -np.eye(3)[:2]])
    none = np.zeros((4, 3))
    gravity = np.concatenate([none[:1], domain.gravity_m_s2 * sides, none])
    tip_force = np.concatenate([none[:1], none, domain.tip_force_n * sides])
    tensions = np.minimum(robot.pretensions, domain.max_tension_n)
    solution = solve_statics(robot, np.tile(tensions, (9, 1)), gravity=gravity, tip_force=tip_force)
    tips = np.where((solution.converged & solution.stable)[:, None], solution.positions[:, -1], np.nan)
    moved = np.linalg.norm(tips[1:] - tips[0], axis=1)
    return TipMotion(float(moved[:4].max()), float(moved[4:].max()))


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
