"""Causes: why a point is not seen, told from the shapes that came nearest to seeing it."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.inspection.survey import Survey
from tdcr_planner.inspection.visibility import Visibility
from tdcr_planner.inspection.visibility_kernels import GRAZING, OCCLUDED, OUTSIDE_PICTURE, TOO_FAR, TOO_NEAR
from tdcr_planner.planning.validity import sample_within_tensions
from tdcr_planner.se3 import transform_points
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

_SEEN_BUT_FOR_ROBOT = 32
_MORE_TENSION = 2.0
_MORE_TRAVEL = (-0.5, -0.25, 0.25, 0.5)  # of the robot's length
_TRIED = 4_096


class Unseen(StrEnum):
    """Why no state that the start reaches sees a point."""

    NO_PATH = "no path"
    COLLIDES = "collides"
    OCCLUDED = "occluded"
    TOO_GRAZING = "too grazing"
    TOO_FAR = "too far"
    TOO_NEAR = "too near"
    OUT_OF_PICTURE = "out of the picture"
    TRAVEL = "out of reach (travel)"
    TENSION = "out of reach (tension)"
    OUT_OF_REACH = "out of reach"


# What stands first decides: the smallest change that would show the point.
_OF_FREE = (
    (_SEEN_BUT_FOR_ROBOT, Unseen.OCCLUDED),
    (GRAZING, Unseen.TOO_GRAZING),
    (OCCLUDED, Unseen.OCCLUDED),
    (TOO_FAR, Unseen.TOO_FAR),
    (TOO_NEAR, Unseen.TOO_NEAR),
)


def causes(visibility: Visibility, survey: Survey, reached: BoolArray) -> list[Unseen | None]:
    """Returns why each point cannot be seen; None where it can be.

    Valid states that do see it are without a way from the start. Else shapes that touch something may see it, else
    valid states may miss it for one reason alone: the angle, what stands between, or the distance. Else it is tried
    with more travel of the base, and with twice the tensions by the constant-curvature model.

    Args:
        visibility: What is seen.
        survey: The states that were looked from.
        reached: Points that are seen from a state that the start reaches, shape (p,).
    """
    found: list[Unseen | None] = [None] * len(reached)
    open_ = np.flatnonzero(~reached)
    if not len(open_):
        return found

    def settle(which: BoolArray, cause: Unseen) -> None:
        nonlocal open_
        for point in open_[which].tolist():
            found[point] = cause
        open_ = open_[~which]

    settle(survey.counts[open_] > 0, Unseen.NO_PATH)
    blocked, free = survey.poses_of_blocked, survey.poses_of_free
    settle(visibility.single_faults(*blocked, open_) & _SEEN_BUT_FOR_ROBOT != 0, Unseen.COLLIDES)
    bits = visibility.single_faults(*free, open_)
    for bit, cause in _OF_FREE:
        which = bits & bit != 0
        bits = bits[~which]
        settle(which, cause)
    settle(_with_more_travel(visibility, survey, open_), Unseen.TRAVEL)
    settle(_with_more_tension(visibility, survey, open_), Unseen.TENSION)
    bits = visibility.single_faults(*free, open_)
    settle(bits & OUTSIDE_PICTURE != 0, Unseen.OUT_OF_PICTURE)
    settle(np.ones(len(open_), dtype=np.bool_), Unseen.OUT_OF_REACH)
    return found


def _with_more_travel(visibility: Visibility, survey: Survey, which: IntArray) -> BoolArray:
    """Returns which points shapes would see whose base is moved beyond its range along its axis, shape (q,)."""
    space = survey.checker.space
    axis = space.world[1][:, 2]
    positions, rotations = (
        np.concatenate(pair) for pair in zip(survey.poses_of_blocked, survey.poses_of_free, strict=True)
    )
    bits = np.zeros(len(which), dtype=np.int64)
    for share in _MORE_TRAVEL:
        moved = positions + share * survey.checker.robot.length * axis
        bits |= visibility.single_faults(moved, rotations, which)
    return np.asarray(bits & _SEEN_BUT_FOR_ROBOT != 0)


def _with_more_tension(visibility: Visibility, survey: Survey, which: IntArray) -> BoolArray:
    """Returns which points shapes under too large tensions would see, shape (q,)."""
    if not len(which):
        return np.zeros(0, dtype=np.bool_)
    checker = survey.checker
    rows = sample_within_tensions(checker, _TRIED, np.random.default_rng(0))
    actuation = checker.space.actuate(rows)
    model = ConstantCurvatureShape(checker.robot)
    tensions: FloatArray = _MORE_TENSION * actuation.tensions
    poses = model.disk_poses(tensions, gravity=actuation.gravity, tip_force=actuation.tip_force)
    positions = transform_points(actuation.base_rotations, actuation.base_positions, poses.positions)
    rotations = actuation.base_rotations[:, None] @ poses.rotations
    bits = visibility.single_faults(positions[:, -1:], rotations[:, -1:], which)
    return np.asarray(bits & _SEEN_BUT_FOR_ROBOT != 0)
