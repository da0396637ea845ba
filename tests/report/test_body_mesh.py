from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.body import Kind, RobotBody, Shaft
from tdcr_planner.report.body_mesh import (
    cylinder_meshes,
    has_solids,
    part_mesh,
    shaft_mesh,
    sleeve_mesh,
    solid_ends,
)
from tdcr_planner.report.picture import gather_picture

START = np.array([0.0, 0.0, -0.1])


@pytest.fixture
def bodies(paper_robot):
    """The same robot with tendons and with a sleeve between its disks, both with a shaft."""
    sleeved = paper_robot.model_copy(update={"body": paper_robot.body.model_copy(update={"between_disks": "sleeve"})})
    return [RobotBody(robot, None, Shaft(0.004, START)) for robot in (paper_robot, sleeved)]


@pytest.fixture
def straight(paper_robot):
    """Disk poses along z with the base in the origin."""
    positions = paper_robot.arc_lengths[:, None] * np.array([0.0, 0.0, 1.0])
    return positions, np.tile(np.eye(3), (paper_robot.disk_count, 1, 1))


def solid(mesh):
    return trimesh.Trimesh(*mesh, process=False)


def test_sleeve_is_as_wide_as_the_disks_and_covers_every_gap(bodies, straight, paper_robot):
    tendons, sleeved = bodies
    assert not has_solids(tendons, Kind.SLEEVE)
    assert len(sleeve_mesh(tendons, *straight)[1]) == 0
    vertices, _ = sleeve_mesh(sleeved, *straight, sides=64)
    assert np.linalg.norm(vertices[:, :2], axis=1).max() == pytest.approx(paper_robot.disk_radii.max())
    ends, radii = solid_ends(sleeved, Kind.SLEEVE, *straight)
    assert len(ends) == paper_robot.disk_count - 1
    np.testing.assert_allclose(radii, paper_robot.disk_radii[1:])
    # what is tested reaches over the chord at both ends by the overhang of leaning rims
    chords = np.diff(paper_robot.arc_lengths)
    overhang = sleeved.arrays.half[sleeved.arrays.kind == Kind.SLEEVE][::-1]
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), chords + 2.0 * overhang)


def test_shaft_goes_from_where_it_starts_to_the_base_or_is_one_point(bodies, straight):
    body, (positions, rotations) = bodies[0], straight
    shaft = solid(shaft_mesh(body, positions, rotations, sides=64))
    assert shaft.is_watertight
    np.testing.assert_allclose(shaft.bounds[:, 2], [-0.1, 0.0], atol=1e-12)
    # 64 corners lack 0.16 % of the circle
    assert shaft.volume == pytest.approx(np.pi * 0.004**2 * 0.1, rel=2e-3)
    # inserted behind its start: the shaft is not out
    hidden, _ = shaft_mesh(body, positions + 2.0 * START, rotations)
    np.testing.assert_allclose(hidden, np.tile(2.0 * START, (len(hidden), 1)), atol=1e-12)


def test_cylinders_of_no_length_have_no_size():
    vertices, faces = cylinder_meshes(np.ones((1, 2, 3)), np.array([0.01]), 8, closed=True)
    np.testing.assert_array_equal(vertices, 1.0)
    assert faces.max() < len(vertices)
    assert cylinder_meshes(np.zeros((0, 2, 3)), np.zeros(0), 8)[1].shape == (0, 3)


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize(("part", "middle"), [("disk 7", 7.0), ("gap 3", 2.5)])
def test_a_part_covers_what_is_drawn_of_it(bodies, straight, paper_robot, which, part, middle):
    mesh = part_mesh(bodies[which], *straight, part, 1e-4)
    low, high = mesh[0].min(axis=0), mesh[0].max(axis=0)
    spacing = paper_robot.arc_lengths[1]
    assert 0.5 * (low + high)[2] == pytest.approx(middle * spacing)
    wide = part == "disk 7" or which == 1
    radius = paper_robot.disk_radii[1] + 1e-4
    reach = high[:2].max()
    assert (reach == pytest.approx(radius)) if wide else (0.5 * radius < reach < radius)


def test_the_shaft_is_a_part_and_what_the_body_lacks_is_none(bodies, straight, paper_robot):
    assert np.ptp(part_mesh(bodies[0], *straight, "shaft", 1e-4)[0][:, 2]) == pytest.approx(0.1)
    bare = RobotBody(paper_robot)
    for name in ("shaft", "disk 99", "gap 0", "disk x", ""):
        assert part_mesh(bare, *straight, name, 1e-4) is None


def test_the_picture_has_the_body_that_is_tested(make_result):
    picture = gather_picture(make_result())
    assert not has_solids(picture.body, Kind.SHAFT)
    file = picture.scenario.file
    base = file.base.model_copy(update={"shaft_radius_m": 0.003})
    scenario = replace(picture.scenario, file=file.model_copy(update={"base": base}))
    assert has_solids(replace(picture, scenario=scenario).body, Kind.SHAFT)
    assert (picture.body.margins == 0.0).all()
