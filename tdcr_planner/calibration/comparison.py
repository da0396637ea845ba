"""Models beside which a calibrated robot is judged: the robot as its file says, and constant curvature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.data import MeasuredStates
from tdcr_planner.calibration.forward import Shapes, place_points, tensions_of
from tdcr_planner.calibration.unloaded import poses_of_arcs
from tdcr_planner.se3 import rotation_from_vector


def constant_curvature_shapes(bench: Bench, states: MeasuredStates) -> Shapes:
    """Returns shapes of one arc a segment without mechanics of slack, friction or stretch.

    With displacement drive the bend of each segment is the least-squares solution of its tendons' lengths, less what
    they lose in the segments before (Webster and Jones 2010, sec. 4); with tension drive it is the moment of the
    tendons over EI.
    """
    robot = bench.robot
    offsets = robot.tendon_offsets[:, :2]
    bends = np.zeros((len(states), 3 * robot.segment_count))
    left = states.displacements.copy()
    tensions = tensions_of(bench, states)
    for index, segment in enumerate(robot.segments):
        ends = robot.tendon_segments == index
        if bench.drives_displacement:
            own = offsets[ends]
            inverse = np.linalg.pinv(np.column_stack([own, np.ones(len(own))]))[:2]
            bend = left[:, ends] @ inverse.T / segment.length_m
        else:
            passing = robot.tendon_segments >= index
            stiffness = robot.segment_backbones[index].stiffness_bending_torsion[0]
            bend = tensions[:, passing] @ offsets[passing] / stiffness
        bends[:, 3 * index : 3 * index + 2] = bend
        left -= segment.length_m * bend @ offsets.T
    positions, rotations = poses_of_arcs(robot, bends)
    return Shapes(positions, rotations, tensions, np.ones(len(states), dtype=np.bool_), bends)


def align_base(bench: Bench, states: MeasuredStates, shapes: Shapes, chosen: BoolArray) -> Bench:
    """Returns the bench with the base placed so that shapes lie nearest to what was measured.

    Args:
        bench: The bench to start from.
        states: The measured states.
        shapes: Shapes of all states.
        chosen: Which states count, shape (n,).
    """
    seen = np.isfinite(states.positions).all(axis=2) & shapes.solved[:, None] & chosen[:, None]
    points = place_points(replace(bench, base_position=np.zeros(3), base_rotation=np.zeros(3)), states, shapes)[seen]
    measured = states.positions[seen]
    if len(points) < 3:
        return bench
    size = float(np.median(np.abs(measured - points))) + 1e-9

    def cost(values: FloatArray) -> FloatArray:
        placed = points @ rotation_from_vector(values[3:]).T + values[:3]
        return np.asarray((placed - measured).ravel() / size)

    start = np.concatenate([bench.base_position, bench.base_rotation])
    found = least_squares(cost, start, loss="soft_l1", x_scale=np.repeat([0.01, 0.1], 3)).x
    return replace(bench, base_position=found[:3], base_rotation=found[3:])
