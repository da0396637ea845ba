"""The rod of a whole robot as a function of arc length, from the backbones of its segments."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray, check_array
from tdcr_planner.robot.backbone import Backbone
from tdcr_planner.robot.segments import Segment

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec


def along(robot: RobotSpec, s: ArrayLike, value: Callable[[Backbone, Segment, FloatArray], FloatArray]) -> FloatArray:
    """Returns a property of the rod at arc lengths; where it jumps, the side towards the base counts.

    Args:
        robot: The robot.
        s: Arc lengths from the base, shape (n,), m.
        value: The property from a rod, its segment and arc lengths as the rod counts them, shape (k,), m.

    Returns:
        Shape (n, ...) as `value` returns (k, ...).
    """
    places = check_array("s", s, (None,))
    owner = np.clip(np.searchsorted(robot.segment_ends, places, side="left"), 0, robot.segment_count - 1)
    parts = []
    for index, (segment, rod) in enumerate(zip(robot.segments, robot.segment_backbones, strict=True)):
        start = 0.0 if segment.backbone is None else robot.segment_starts[index]
        parts.append(value(rod, segment, places[owner == index] - start))
    found = np.concatenate(parts)
    result = np.empty_like(found)
    result[np.argsort(owner, kind="stable")] = found
    return result


def joins(robot: RobotSpec) -> FloatArray:
    """Returns the arc lengths at which the rod or the set of tendons changes; see `RobotSpec.joins`."""
    places = [*robot.segment_ends.tolist(), *robot.backbone.joins]
    for start, segment in zip(robot.segment_starts, robot.segments, strict=True):
        places += [float(start) + s for s in (segment.backbone.joins if segment.backbone else ())]
    for tendon in robot.tendons:
        places += [tendon.start_arc_length, tendon.end_arc_length]
    tolerance = 1e-12 * robot.length
    kept = [robot.length]
    for place in sorted(places, reverse=True):
        if tolerance < place < kept[-1] - tolerance:
            kept.append(place)
    return np.array(kept[::-1])


def backbone_mass(robot: RobotSpec) -> float:
    """Returns the mass of the whole backbone, kg."""
    starts = np.concatenate([[0.0], robot.joins[:-1]])
    half = 0.5 * (robot.joins - starts)
    # Two Gauss nodes are exact for the area of a radius linear in arc length.
    nodes = (starts + half)[:, None] + half[:, None] * np.array([-1.0, 1.0]) / math.sqrt(3.0)
    return float((half * robot.mass_per_length_at(nodes.reshape(-1)).reshape(-1, 2).sum(axis=1)).sum())
