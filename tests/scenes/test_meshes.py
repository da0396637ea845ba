"""The shipped meshes: closed or open where they should be, of the size they claim, and what their generators make."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

MESHES = {
    "duct/duct.stl": 1,  # boundary loops
    "airway/airway.stl": 1,
    "blades/casing.stl": 0,
    "blades/blades.stl": 0,
    "blades/vanes.stl": 0,
}
# STL holds single precision: 24 bits of up to 330 mm is 2e-5 mm a coordinate.
STL_ROUNDING_MM = 4e-5


@pytest.mark.parametrize("name", MESHES)
def test_is_small_and_clean(name, scenes, shipped):
    mesh = shipped(name)
    assert (scenes / name).stat().st_size < 1.5e6
    assert 5_000 <= len(mesh.faces) <= 30_000
    assert mesh.is_winding_consistent
    assert mesh.area_faces.min() > 0.0


@pytest.mark.parametrize(("name", "loops"), MESHES.items())
def test_is_open_where_it_should_be(name, loops, shipped):
    mesh = shipped(name)
    edges, count = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    assert set(count) <= {1, 2}
    rim = edges[count == 1]
    assert len(trimesh.graph.connected_components(rim)) == loops
    if loops:
        assert np.abs(mesh.vertices[np.unique(rim)][:, 0]).max() < STL_ROUNDING_MM  # the mouth lies in the plane x = 0
    else:
        assert mesh.is_watertight


@pytest.mark.parametrize(
    ("name", "bodies"), [("blades/casing.stl", 1), ("blades/blades.stl", 7), ("blades/vanes.stl", 5)]
)
def test_solids_are_apart_and_outward(name, bodies, shipped):
    parts = shipped(name).split(only_watertight=True)
    assert len(parts) == bodies
    assert all(part.volume > 0.0 for part in parts)


def test_solids_of_the_stage_do_not_touch(shipped):
    manager = trimesh.collision.CollisionManager()
    for name in ("casing", "blades", "vanes"):
        for index, part in enumerate(shipped(f"blades/{name}.stl").split()):
            manager.add_object(f"{name} {index}", part)
    touching, pairs = manager.in_collision_internal(return_names=True)
    assert not touching, pairs


PORT = {
    "plate_thin": 4.8,
    "plate_thick": 3.9,
    "plates_offset": 6.0,
    "elbow": 6.0,
    "tube_blind": 4.2,
    "tube_curved": 4.8,
}


@pytest.mark.parametrize(("name", "width"), PORT.items())
def test_ports_are_clean_and_as_wide_as_they_say(name, width, shipped):
    mesh = shipped(f"port/{name}.stl")
    assert mesh.is_winding_consistent
    assert mesh.area_faces.min() > 0.0
    assert mesh.is_watertight == name.startswith("plate")
    mouth = mesh.vertices[np.abs(mesh.vertices[:, 0]) < STL_ROUNDING_MM]
    distance = np.linalg.norm(mouth[:, 1:], axis=1)
    # The polygon lies about the circle: its sides touch it, its corners stand out.
    corner = 0.5 * width / np.cos(np.pi / 64)
    np.testing.assert_allclose(distance[distance < width], corner, atol=STL_ROUNDING_MM)


@pytest.mark.parametrize("scene", ["duct", "blades", "port"])
def test_generator_makes_the_shipped_meshes(scene, scenes, generator, tmp_path):
    generator(scene).main(tmp_path)
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == sorted(path.name for path in (scenes / scene).glob("*.stl"))
    for name in made:
        new, old = (trimesh.load_mesh(folder / name, process=False) for folder in (tmp_path, scenes / scene))
        np.testing.assert_array_equal(new.faces, old.faces)
        # sines and cosines may differ in the last bit between machines
        np.testing.assert_allclose(new.vertices, old.vertices, rtol=0.0, atol=STL_ROUNDING_MM)


def test_generator_writes_the_same_bytes_each_time(generator, tmp_path):
    for run in ("first", "second"):
        (tmp_path / run).mkdir()
        generator("duct").main(tmp_path / run)
    assert (tmp_path / "first/duct.stl").read_bytes() == (tmp_path / "second/duct.stl").read_bytes()


def test_airway_lies_on_the_surface_that_its_generator_describes(generator, shipped):
    make = generator("airway")
    pieces = make.branch_pieces()
    mesh = shipped("airway/airway.stl")
    depth = np.array([make.depth_inside(pieces, *vertex) for vertex in mesh.vertices])
    # Vertices come from linear interpolation across cells of EDGE_LENGTH h: h² / (8 r) off a tube of radius r >= 12 mm,
    # and more in the creases of the smooth union, whose radius is about BLEND / 2.
    assert np.abs(depth).max() < make.EDGE_LENGTH**2 / (8.0 * make.BLEND / 2.0)
    assert np.median(np.abs(depth)) < make.EDGE_LENGTH**2 / (8.0 * 12.0)


def test_duct_is_as_wide_as_it_says(generator, shipped):
    make = generator("duct")
    mesh = shipped("duct/duct.stl")
    for arc_length, radius in (
        (60.0, make.PIPE_RADIUS),
        (make.NARROWING_AT, make.NARROWING_RADIUS),
        (make.ORIFICE_AT, make.ORIFICE_RADIUS),
    ):
        point, normal = make.axis_frame(arc_length)
        tangent = np.cross(normal, [0.0, 0.0, 1.0])
        rim = mesh.section(plane_origin=point, plane_normal=tangent).vertices - point
        rim = rim[np.linalg.norm(rim, axis=1) < 2.0 * make.PIPE_RADIUS]
        distance = np.linalg.norm(rim, axis=1)
        flat = 1.0 - np.cos(np.pi / make.SEGMENTS)  # a chord of the polygon lies this share inside the circle
        ring = radius * 0.005 + 0.05  # rings stand 3 mm apart, so the section may miss the throat by 1.5 mm
        assert radius * (1.0 - flat) - 1e-3 < distance.min() < radius + ring


def test_no_disk_of_its_robots_passes_the_orifice(generator, shipped, paper_robot, inspection_robot):
    """A disk whose centre passes the plate's plane is cut by it along a full diameter."""
    make = generator("duct")
    point, normal = make.axis_frame(make.ORIFICE_AT)
    tangent = np.cross(normal, [0.0, 0.0, 1.0])
    rim = shipped("duct/duct.stl").section(plane_origin=point, plane_normal=tangent).vertices
    near = rim[np.linalg.norm(rim - point, axis=1) < 2.0 * make.PIPE_RADIUS]
    widest = max(np.linalg.norm(near - vertex, axis=1).max() for vertex in near)
    for robot in (paper_robot, inspection_robot):
        assert widest < 2e3 * robot.disk_radii[1:].min()
