import numpy as np
import pytest
import trimesh

from tdcr_planner.report.robot_mesh import (
    backbone_curve,
    disk_mesh,
    merge_meshes,
    simplify_mesh,
    tendon_lines,
    tube_mesh,
)
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape


@pytest.fixture
def bent(two_segment_robot):
    """Poses of a robot whose both segments bend."""
    tensions = two_segment_robot.tensions_from_bending(np.array([[[1.0, 0.5], [-0.6, 0.8]]]))
    poses = ConstantCurvatureShape(two_segment_robot).disk_poses(tensions)
    return two_segment_robot, poses.positions[0], poses.rotations[0]


def test_disks_have_the_volume_of_cylinders(bent):
    robot, positions, rotations = bent
    mesh = trimesh.Trimesh(*disk_mesh(robot, positions, rotations, sides=60), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    # a polygon of n corners has n / 2 sin(2 pi / n) of the circle's r^2
    corner = 60 / 2 * np.sin(2 * np.pi / 60)
    assert mesh.volume == pytest.approx((corner * robot.disk_radii**2 * robot.disk_thicknesses).sum())
    assert mesh.body_count == robot.disk_count


def test_backbone_curve_follows_the_arc(paper_robot):
    tensions = paper_robot.tensions_from_bending(np.array([[[1.5, 0.0]]]))
    poses = ConstantCurvatureShape(paper_robot).disk_poses(tensions)
    line = backbone_curve(poses.positions[0], poses.rotations[0], paper_robot.arc_lengths, per_gap=8)
    assert len(line) == 20 * 8 + 1
    curvature = 1.5 * 0.008 / paper_robot.backbone.stiffness_bending_torsion[0]
    radius = 1.0 / curvature
    distance = np.hypot(line[:, 0] - radius, line[:, 2])
    # cubic Hermite interpolation of an arc of angle a misses by r a^4 / 384
    assert np.abs(distance - radius).max() < 2.0 * radius * (0.01 * curvature) ** 4 / 384


def test_tendons_end_with_their_segment_and_keep_their_distance(bent):
    robot, positions, rotations = bent
    lines = tendon_lines(robot, positions, rotations)
    assert [len(line) for line in lines] == [11] * 3 + [21] * 3
    for line, offset in zip(lines, robot.tendon_offsets, strict=True):
        distance = np.linalg.norm(line - positions[: len(line)], axis=1)
        np.testing.assert_allclose(distance, np.linalg.norm(offset), rtol=1e-12)


def test_tube_is_closed_and_as_thick_as_asked(bent):
    _, positions, rotations = bent
    line = backbone_curve(positions, rotations, bent[0].arc_lengths)
    tube = trimesh.Trimesh(*tube_mesh(line, 0.001, sides=32), process=False)
    assert tube.is_watertight
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    # 32 corners lack 0.6 % of the circle; the bends' sections overlap less than that
    assert tube.volume == pytest.approx(np.pi * 0.001**2 * length, rel=0.012)


def test_merged_meshes_keep_their_faces():
    box, ball = trimesh.creation.box(), trimesh.creation.icosphere(subdivisions=1)
    vertices, faces = merge_meshes([(box.vertices, box.faces), (ball.vertices, ball.faces)])
    merged = trimesh.Trimesh(vertices, faces, process=False)
    assert merged.volume == pytest.approx(box.volume + ball.volume)
    assert merge_meshes([])[1].shape == (0, 3)


@pytest.mark.parametrize("most", [300, 2000, 10_000])
def test_simplified_mesh_is_small_and_stays_in_place(most):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    vertices, faces = simplify_mesh(np.asarray(ball.vertices), np.asarray(ball.faces), most)
    assert most / 6 < len(faces) <= most
    # an equal share of the sphere's area a triangle: edges of about this length, and their sagitta
    edge = np.sqrt(4.0 * np.pi * 0.05**2 / len(faces) * 4.0 / np.sqrt(3.0))
    assert np.abs(np.linalg.norm(vertices, axis=1) - 0.05).max() < edge**2 / 0.05
    assert trimesh.Trimesh(vertices, faces).area == pytest.approx(ball.area, rel=0.15)


def test_a_small_mesh_stays_as_it_is():
    box = trimesh.creation.box()
    vertices, faces = simplify_mesh(np.asarray(box.vertices), np.asarray(box.faces), 12)
    np.testing.assert_array_equal(vertices, box.vertices)
    np.testing.assert_array_equal(faces, box.faces)
