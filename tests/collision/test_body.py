"""Where the solids stand, what they cover, and when the body meets itself."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.collision.body import (
    PARALLEL,
    Kind,
    RobotBody,
    Shaft,
    largest_curvature,
    part_ball,
    place_solids,
    towards_rim,
)
from tdcr_planner.collision.scene import CollisionScene, Verdict
from tdcr_planner.errors import InputError
from tdcr_planner.se3 import rotation_from_vector
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape


def _arc(robot, curvature):
    """Poses of a robot bent into a circle towards x."""
    turn = robot.arc_lengths * curvature
    positions = np.stack([(1 - np.cos(turn)) / curvature, 0 * turn, np.sin(turn) / curvature], axis=1)
    return positions, rotation_from_vector(np.stack([0 * turn, turn, 0 * turn], axis=1))


def test_parts_stand_tip_first(paper, two_segment):
    body = RobotBody(paper, shaft=Shaft(0.004, (0, 0, -1)))
    assert body.part_names[:3] == ("disk 20", "gap 20", "disk 19")
    assert body.part_names[-3:] == ("disk 1", "gap 1", "shaft")
    assert np.bincount(body.arrays.kind).tolist() == [20, 20, 60, 0, 1]
    # Six tendons pass the first segment of the two, three the second.
    assert np.bincount(RobotBody(two_segment).arrays.kind).tolist() == [20, 20, 90]


def test_a_gap_takes_the_larger_margin_of_its_disks(paper):
    margins = np.linspace(0.0, 0.002, paper.disk_count)
    arrays = RobotBody(paper, margins).arrays
    for k in range(1, paper.disk_count):
        disk = (arrays.kind == Kind.DISK) & (arrays.station == k)
        tendons = (arrays.kind == Kind.TENDON) & (arrays.station == k)
        assert arrays.radius[disk] == pytest.approx(0.01 + margins[k])
        assert arrays.half[disk] == pytest.approx(0.001 + margins[k])
        np.testing.assert_allclose(arrays.radius[tendons], 0.0002 + margins[k])


@pytest.mark.parametrize("margins", [np.zeros(20), np.full(21, -1e-3), np.full(21, np.nan)])
def test_margins_are_checked(paper, margins):
    with pytest.raises(InputError, match="margins"):
        RobotBody(paper, margins)


def test_a_shaft_is_checked(paper):
    with pytest.raises(InputError, match=r"shaft\.radius_m"):
        RobotBody(paper, shaft=Shaft(0.0, (0, 0, 0)))
    with pytest.raises(InputError, match=r"shaft\.start"):
        RobotBody(paper, shaft=Shaft(0.01, (0, 0)))


def test_the_solids_hold_the_bent_backbone_and_its_tendons(paper):
    curvature = largest_curvature(paper, 0)
    positions, rotations = _arc(paper, curvature)
    arrays = RobotBody(paper).arrays
    centres, frames, halves = place_solids(arrays, positions, rotations)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), np.broadcast_to(np.eye(3), frames.shape), atol=1e-12)
    s = np.linspace(0.0, paper.length, 2001)
    arc = np.stack([(1 - np.cos(s * curvature)) / curvature, 0 * s, np.sin(s * curvature) / curvature], axis=1)

    def distance(index, points):
        local = (points - centres[index]) @ frames[index]
        over = np.maximum(np.abs(local[:, 2]) - halves[index], 0.0)
        return np.hypot(over, np.linalg.norm(local[:, :2], axis=1)) - arrays.radius[index]

    backbones = np.flatnonzero(arrays.kind == Kind.BACKBONE)
    nearest = np.min([distance(index, arc) for index in backbones], axis=0)
    # The whole rod of 0.5 mm lies in the capsules, up to the second order that the sagitta s^2 k / 8 leaves out.
    assert nearest.max() <= -0.0005 + 1e-6
    for index in np.flatnonzero(arrays.kind == Kind.TENDON):
        k = arrays.station[index]
        holes = np.stack([positions[j] + rotations[j] @ arrays.offset[index] for j in (k - 1, k)])
        np.testing.assert_allclose(distance(index, holes), -0.0002, atol=1e-12)


@pytest.mark.parametrize("between", ["backbone", "tendons", "sleeve"])
def test_the_ball_about_a_part_holds_its_solids(two_segment, draw_poses, between):
    robot = two_segment.model_copy(update={"body": two_segment.body.model_copy(update={"between_disks": between})})
    body = RobotBody(robot, np.linspace(0, 0.002, robot.disk_count))
    arrays = body.arrays
    positions, rotations = draw_poses(robot, np.random.default_rng(0), 20)
    middle = np.empty(3)
    for row in range(20):
        centres, frames, halves = place_solids(arrays, positions[row], rotations[row])
        for part in range(len(body.part_names)):
            reach = part_ball(arrays, part, positions[row], rotations[row], middle)
            for k in range(arrays.part_first[part], arrays.part_first[part + 1]):
                to_ends = [np.linalg.norm(centres[k] + e * halves[k] * frames[k, :, 2] - middle) for e in (-1, 1)]
                farthest = (
                    max(to_ends) + arrays.radius[k]
                    if arrays.round_ends[k]
                    else np.hypot(max(to_ends), arrays.radius[k])
                )
                assert farthest <= reach + 1e-12


def test_the_shaft_runs_from_its_start_to_the_base(paper):
    body = RobotBody(paper, shaft=Shaft(0.004, (0.0, 0.0, -0.1)))
    positions, rotations = _arc(paper, 0.01)
    centres, frames, halves = place_solids(body.arrays, positions, rotations)
    np.testing.assert_allclose(centres[-1], [0, 0, -0.05], atol=1e-15)
    np.testing.assert_allclose(frames[-1, :, 2], [0, 0, 1], atol=1e-15)
    assert halves[-1] == pytest.approx(0.05)
    behind = place_solids(body.arrays, positions - [0, 0, 0.2], rotations)[2]
    assert behind[-1] < 0.0


@pytest.mark.parametrize("name", ["paper", "two_segment"])
@pytest.mark.parametrize("between", ["tendons", "sleeve"])
def test_a_smoothly_bent_robot_never_meets_itself(name, between, request, draw_poses):
    robot = request.getfixturevalue(name)
    robot = robot.model_copy(update={"body": robot.body.model_copy(update={"between_disks": between})})
    scene = CollisionScene([], RobotBody(robot, np.full(robot.disk_count, 0.003), Shaft(0.01, (0, 0, -0.2))))
    assert (scene.check(*draw_poses(robot, np.random.default_rng(1), 300)) == Verdict.FREE).all()


def test_a_robot_that_comes_back_to_itself_is_found(paper):
    scene = CollisionScene([], RobotBody(paper, shaft=Shaft(0.01, (0.0, 0.0, -0.2))))
    verdicts, contacts = [], []
    for turns in (0.5, 0.75, 0.97):
        positions, rotations = _arc(paper, turns * 2 * np.pi / paper.length)
        verdicts.append(scene.check(positions[None], rotations[None])[0])
        contacts.append(scene.first_contact(positions, rotations))
        assert scene.touches_itself(positions[None], rotations[None])[0] == (verdicts[-1] == Verdict.SELF)
    assert verdicts == [Verdict.FREE, Verdict.FREE, Verdict.SELF]
    assert contacts[1] is None
    assert contacts[2].mesh == "robot"
    assert "touch each other" in str(contacts[2])


def test_disks_that_cross_are_found_by_distance_of_their_centres(paper):
    # A hairpin: up, over and down again 15 mm beside itself, less than two disk radii.
    k = np.arange(paper.disk_count)
    up = k <= 9
    positions = np.where(
        up[:, None], np.stack([0 * k, 0 * k, 0.01 * k], 1), np.stack([0 * k + 0.015, 0 * k, 0.1 - 0.01 * (k - 10)], 1)
    )
    rotations = np.where(up[:, None, None], np.eye(3), np.diag([1.0, -1.0, -1.0]))
    body = RobotBody(paper)
    assert CollisionScene([], body).check(positions[None], rotations[None]).tolist() == [Verdict.SELF]
    apart = positions + np.where(up[:, None], 0.0, [[0.02, 0.0, 0.0]])
    assert CollisionScene([], body).check(apart[None], rotations[None]).tolist() == [Verdict.FREE]


def test_the_largest_curvature_bounds_what_the_tendons_do(two_segment):
    bending = np.zeros((1, 2, 2))
    bending[0, :, 0] = [5.0, 4.0]
    tensions = np.minimum(two_segment.tensions_from_bending(bending), two_segment.max_tensions)
    rotations = ConstantCurvatureShape(two_segment).disk_poses(tensions).rotations[0]
    for segment, (first, last) in enumerate(((0, 10), (10, 20))):
        turn = np.arccos(np.clip(rotations[first][:, 2] @ rotations[last][:, 2], -1, 1))
        assert turn <= largest_curvature(two_segment, segment) * 0.1 + 1e-12


@pytest.mark.parametrize("tilt", [0.0, 1e-17, 1e-12, 1e-10, 3e-9, 1e-8, 1.5e-8, 1e-6, 1e-3, 1.0])
@pytest.mark.parametrize("turn", np.linspace(0.0, 2.0 * np.pi, 7, endpoint=False))
def test_the_way_to_the_rim_is_a_unit_vector_across_the_axis_however_near_the_normal_is_to_it(tilt, turn):
    axis = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    normal = np.array([0.0, 0.0, 1.0])
    rim = np.array(towards_rim(axis, *normal, float(axis @ normal)))
    if tilt < PARALLEL:
        np.testing.assert_array_equal(rim, np.zeros(3))
        return
    assert np.linalg.norm(rim) == pytest.approx(1.0, abs=1e-12)
    # Rounding of 1e-16 in a vector of length `tilt`.
    assert abs(rim @ axis) < 1e-15 / tilt + 1e-15
    assert rim @ normal >= -1e-15
