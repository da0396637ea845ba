from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from tdcr_planner.collision.body import place_solids
from tdcr_planner.inspection.visibility import Visibility
from tdcr_planner.inspection.visibility_kernels import GRAZING, OCCLUDED, SURFACE_M, TOO_FAR
from tdcr_planner.planning.validity import sample_within_tensions
from tdcr_planner.query.session import PlanningSession

Engine = Callable[..., tuple[PlanningSession, Visibility]]


def poses(session: PlanningSession, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    checker = session.checker()
    rows = sample_within_tensions(checker, count, np.random.default_rng(seed))
    positions, rotations, known = checker.world_poses(rows)
    return positions[known], rotations[known]


def in_picture(engine: Visibility, centre: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Which points lie in the cone, range and angle of incidence: written anew from the definitions."""
    camera, targets = engine.camera, engine.targets
    offset = targets.points - centre
    distance = np.linalg.norm(offset, axis=1)
    angle = np.degrees(np.arccos(np.clip(offset @ frame[:, 2] / distance, -1.0, 1.0)))
    cosine = -(offset * targets.normals).sum(axis=1) / distance
    incidence = np.degrees(np.arccos(np.clip(np.where(targets.two_sided, np.abs(cosine), cosine), -1.0, 1.0)))
    low, high = camera.range_m
    half = np.degrees(np.arctan(camera.tangents[0]))
    return np.asarray(
        (angle <= half) & (distance >= low) & (distance <= high) & (incidence <= camera.max_incidence_deg)
    )


def hits_some_triangle(start: np.ndarray, end: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether a segment crosses a triangle: signs of tetrahedra's volumes, every triangle."""

    def volume(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
        return np.einsum("...i,...i->...", np.cross(b - a, c - a), d - a)

    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    apart = volume(a, b, c, start) * volume(a, b, c, end) <= 0.0
    line = np.stack([volume(start, end, a, b), volume(start, end, b, c), volume(start, end, c, a)])
    inside = (line >= 0.0).all(axis=0) | (line <= 0.0).all(axis=0)
    return bool((apart & inside).any())


def test_it_agrees_with_every_point_and_every_triangle(make_engine: Engine) -> None:
    session, engine = make_engine(spacing_m=0.02)
    positions, rotations = poses(session, 120)
    seen = engine.seen(positions, rotations)
    triangles = np.concatenate([mesh.vertices[mesh.faces] for mesh in session.meshes])
    centres, frames = engine.camera.poses(positions, rotations)
    pairs = 0
    for state, (centre, frame) in enumerate(zip(centres, frames, strict=True)):
        possible = in_picture(engine, centre, frame)
        pairs += len(possible)
        expected = np.zeros(len(possible), dtype=np.bool_)
        for point in np.flatnonzero(possible):
            offset = engine.targets.points[point] - centre
            end = engine.targets.points[point] - SURFACE_M * offset / np.linalg.norm(offset)
            expected[point] = not hits_some_triangle(centre, end, triangles)
        np.testing.assert_array_equal(seen[state], expected)
    assert pairs > 10_000
    assert seen.any()
    # The post hides some of what would be in the picture.
    assert sum(in_picture(engine, c, f).sum() for c, f in zip(centres, frames, strict=True)) > seen.sum()


def test_it_agrees_with_embree(make_engine: Engine) -> None:
    session, engine = make_engine(spacing_m=0.006)
    positions, rotations = poses(session, 400, seed=1)
    seen = engine.seen(positions, rotations)
    scene = trimesh.util.concatenate([trimesh.Trimesh(mesh.vertices, mesh.faces) for mesh in session.meshes])
    centres, frames = engine.camera.poses(positions, rotations)
    states, points = np.nonzero(
        np.stack([in_picture(engine, centre, frame) for centre, frame in zip(centres, frames, strict=True)])
    )
    offset = engine.targets.points[points] - centres[states]
    distance = np.linalg.norm(offset, axis=1)
    places, rays, _ = scene.ray.intersects_location(centres[states], offset / distance[:, None], multiple_hits=False)
    first = np.full(len(states), np.inf)
    first[rays] = np.linalg.norm(places - centres[states][rays], axis=1)
    # Embree computes in single precision: 1e-7 of some decimetres, far below this.
    expected = first >= distance - 2.0 * SURFACE_M
    assert len(states) > 10_000
    assert (seen[states, points] != expected).mean() <= 1e-4


def test_the_robot_hides_what_is_behind_it(make_engine: Engine) -> None:
    """A camera beside the last disk that looks back along the body sees it instead of the plate behind."""
    session, engine = make_engine(
        camera={"position_m": [0.0, 0.0, 0.005], "direction": [0.0, 0.0, -1.0], "range_m": [0.001, 1.0]}
    )
    robot = session.scenario.robot
    positions = np.zeros((1, robot.disk_count, 3))
    # Upside down before the plate, which is then behind the camera's own disk.
    positions[0, :, 2] = 0.1 + robot.arc_lengths
    positions[0, :, 2] = 0.3 - robot.arc_lengths
    rotations = np.tile(np.diag([1.0, -1.0, -1.0]), (1, robot.disk_count, 1, 1))
    straight = engine.seen(positions, rotations)[0]
    centre = engine.camera.poses(positions, rotations)[0][0]
    offset = engine.targets.points - centre
    tangent = np.linalg.norm(offset[:, :2], axis=1) / offset[:, 2]
    front = engine.targets.normals[:, 2] < -0.5
    # The last disk, of 10 mm, starts 4 mm before the camera: it hides what is within its edge's line of sight.
    hidden = tangent < 0.010 / 0.006
    assert (front & hidden & (tangent < 1.0)).any()
    assert not straight[hidden].any()


def test_a_disk_that_carries_the_camera_hides_nothing(make_engine: Engine) -> None:
    session, engine = make_engine()
    centres, _, halves = place_solids(engine.body, *(item[0] for item in poses(session, 1)))
    assert len(centres) == len(halves)
    positions, rotations = poses(session, 50)
    assert engine.seen(positions, rotations).any()


def test_views_say_how_a_point_is_seen(make_engine: Engine) -> None:
    session, engine = make_engine()
    positions, rotations = poses(session, 60)
    views = engine.views(positions, rotations)
    np.testing.assert_array_equal(views.seen, engine.seen(positions, rotations))
    np.testing.assert_array_equal(np.isfinite(views.distances), views.seen)
    centres, _ = engine.camera.poses(positions, rotations)
    state, point = np.argwhere(views.seen)[0]
    offset = engine.targets.points[point] - centres[state]
    assert views.distances[state, point] == pytest.approx(np.linalg.norm(offset))
    cosine = -offset @ engine.targets.normals[point] / np.linalg.norm(offset)
    assert views.cosines[state, point] == pytest.approx(cosine)


def test_single_faults_name_what_is_in_the_way(make_engine: Engine) -> None:
    _, engine = make_engine()
    points, normals = engine.targets.points, engine.targets.normals
    front = normals[:, 2] < -0.5
    behind_post = int(np.flatnonzero(front)[np.abs(points[front] - [0.05, 0.0, 0.315]).sum(axis=1).argmin()])
    ahead = int(np.flatnonzero(front)[np.abs(points[front] - [-0.05, 0.0, 0.315]).sum(axis=1).argmin()])
    rotations = np.eye(3)[None, None]

    def fault(place: list[float], point: int) -> int:
        return int(engine.single_faults(np.array([[place]]), rotations, np.array([point]))[0])

    assert fault([-0.05, 0.0, 0.25], ahead) == 32
    assert fault([0.05, 0.0, 0.25], behind_post) == OCCLUDED
    assert fault([-0.05, 0.0, 0.0], ahead) == TOO_FAR
    back = int(np.flatnonzero(normals[:, 2] > 0.5)[0])
    assert fault([0.0, 0.0, 0.25], back) in (0, GRAZING)


@pytest.mark.parametrize("angle", [0.1, 44.9, 45.1])
def test_a_rectangle_ends_at_its_width_and_height(make_engine: Engine, angle: float) -> None:
    _, engine = make_engine(
        surfaces=[{"mesh": "plate.stl", "points_m": [[0.0, 0.0, 0.315]]}],
        camera={"field_of_view_deg": [90.0, 40.0], "range_m": [0.001, 1.0]},
    )
    # With x up the picture's width is along y.
    for axis, half in ((1, 45.0), (0, 20.0)):
        place = np.array([0.0, 0.0, 0.215])
        place[axis] = 0.1 * np.tan(np.radians(angle))
        fault = engine.single_faults(place[None, None] - [0.0, 0.0, 0.001], np.eye(3)[None, None], np.array([0]))[0]
        assert (fault == 32) == (angle < half)
