"""Disk poses of configurations in the world frame by the Cosserat reference, for what a picture shows of them."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.spaces import ConfigurationSpace


def reference_shapes(scenario: Scenario, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns disk poses in the world frame by the Cosserat reference, NaN where it found none.

    Args:
        scenario: Robot, loads and base.
        rows: Configurations, shape (n, dimension).

    Returns:
        Positions, shape (n, d, 3), m, and rotations, shape (n, d, 3, 3).
    """
    from tdcr_planner.shape.reference import ReferenceShape

    actuation = ConfigurationSpace(scenario).actuate(rows)
    poses = ReferenceShape(scenario.robot).disk_poses(
        actuation.tensions, gravity=actuation.gravity, tip_force=actuation.tip_force
    )
    positions, rotations = actuation.in_world(poses.positions, poses.rotations)
    positions[~poses.solved] = np.nan
    rotations[~poses.solved] = np.nan
    return positions, rotations


def reference_tensions(scenario: Scenario, rows: FloatArray) -> FloatArray:
    """Returns the tensions of configurations (n, dimension), shape (n, t), N: those set, or the reference's.

    NaN where the drive sets displacements and the reference found no shape.
    """
    from tdcr_planner.shape.reference import ReferenceShape

    actuation = ConfigurationSpace(scenario).actuate(rows)
    if scenario.robot.drive.kind == "tension":
        return actuation.tensions
    solution = ReferenceShape(scenario.robot).solve(
        actuation.tensions, gravity=actuation.gravity, tip_force=actuation.tip_force
    )
    return solution.tensions
