from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.errors import FormatError
from tdcr_planner.inspection.targets import MOST_POINTS, Targets, make_targets
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.scene import load_scene_meshes

Make = Callable[..., Scenario]


def targets_of(scenario: Scenario) -> Targets:
    return make_targets(scenario, load_scene_meshes(scenario))


def test_points_are_evenly_spread_and_stand_for_the_whole_area(make_inspection: Make) -> None:
    scenario = make_inspection()
    found = targets_of(scenario)
    # A box of 0.3 x 0.3 x 0.01 m.
    area = 2.0 * 0.3 * 0.3 + 4.0 * 0.3 * 0.01
    assert found.areas.sum() == pytest.approx(area, rel=1e-6)
    apart, _ = cKDTree(found.points).query(found.points, k=2)
    assert apart[:, 1].min() >= 0.012 * (1.0 - 1e-9)
    # Samples are a quarter of the spacing apart at most, so no place is farther than that from one of them.
    grid = np.stack(np.meshgrid(*[np.linspace(-0.15, 0.15, 61)] * 2), axis=-1).reshape(-1, 2)
    distance, _ = cKDTree(found.points).query(np.column_stack([grid, np.full(len(grid), 0.315)]))
    assert distance.max() < 1.5 * 0.012


def test_normals_point_to_the_outside_of_an_obstacle(make_inspection: Make) -> None:
    found = targets_of(make_inspection())
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0, atol=1e-12)
    outward = (found.points - [0.0, 0.0, 0.32]) * found.normals
    assert (outward.sum(axis=1) > 0.0).all()
    assert not found.two_sided.any()


def test_normals_point_into_a_cavity(make_inspection: Make) -> None:
    scenario = make_inspection()
    ball = trimesh.creation.icosphere(radius=0.2)
    for faces in (ball.faces, ball.faces[:, ::-1]):
        meshes = load_scene_meshes(scenario)
        meshes[0] = SceneMesh.from_arrays("plate.stl", ball.vertices, faces, "cavity")
        found = make_targets(scenario, meshes)
        assert ((found.points * found.normals).sum(axis=1) < 0.0).all()


def test_an_open_surface_may_be_seen_from_both_sides(make_inspection: Make) -> None:
    scenario = make_inspection()
    meshes = load_scene_meshes(scenario)
    square = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]])
    meshes[0] = SceneMesh.from_arrays("plate.stl", square, [[0, 1, 2], [0, 2, 3]], "obstacle")
    assert make_targets(scenario, meshes).two_sided.all()


@pytest.mark.parametrize(
    ("part", "holds"),
    [
        ({"box_m": [[0.0, -1.0, 0.0], [1.0, 1.0, 1.0]]}, lambda points: points[:, 0] >= 0.0),
        (
            {"sphere": {"center_m": [0.0, 0.0, 0.315], "radius_m": 0.05}},
            lambda points: np.linalg.norm(points - [0.0, 0.0, 0.315], axis=1) <= 0.05,
        ),
        ({"facing": [0.0, 0.0, -1.0]}, lambda points: np.abs(points[:, 2] - 0.315) < 1e-6),
        ({"within": {"file": "marker.stl", "unit": "m"}}, lambda points: np.abs(points[:, 0] - 0.1) <= 0.02),
    ],
)
def test_a_part_is_what_its_mark_holds(
    make_inspection: Make, tmp_path: Path, part: dict[str, object], holds: Callable[[np.ndarray], np.ndarray]
) -> None:
    marker = trimesh.creation.box(extents=(0.04, 1.0, 1.0))
    marker.apply_translation((0.1, 0.0, 0.3))
    marker.export(tmp_path / "marker.stl")
    found = targets_of(make_inspection(surfaces=[{"mesh": "plate.stl", **part}]))
    assert holds(found.points).all()
    assert 0 < len(found) < len(targets_of(make_inspection()))


def test_given_points_are_moved_onto_the_surface(make_inspection: Make) -> None:
    surface = {"mesh": "plate.stl", "points_m": [[0.01, 0.02, 0.30], [0.0, 0.0, 0.35]]}
    found = targets_of(make_inspection(surfaces=[surface]))
    np.testing.assert_allclose(found.points, [[0.01, 0.02, 0.315], [0.0, 0.0, 0.325]], atol=1e-6)


def test_the_same_table_gives_the_same_points(make_inspection: Make) -> None:
    first, second = (targets_of(make_inspection()) for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)


@pytest.mark.parametrize(
    ("inspect", "words"),
    [
        ({"surfaces": ["plaet.stl"]}, "did you mean 'plate.stl'"),
        ({"surfaces": [{"mesh": "plate.stl", "box_m": [[1.0, 1.0, 1.0], [2.0, 2.0, 2.0]]}]}, "no part of plate.stl"),
        ({"surfaces": [{"mesh": "plate.stl", "sphere": {"center_m": [9, 9, 9], "radius_m": 0.1}}]}, "no part of"),
        ({"spacing_m": 0.0001}, r"makes about [\d,]{9,} points"),
    ],
)
def test_what_makes_no_points_or_too_many_is_refused(
    make_inspection: Make, inspect: dict[str, object], words: str
) -> None:
    with pytest.raises(FormatError, match=words) as caught:
        targets_of(make_inspection(**inspect))
    assert "inspect." in str(caught.value)


def test_a_spacing_that_is_too_fine_names_one_that_is_not(make_inspection: Make) -> None:
    with pytest.raises(FormatError, match="makes about") as caught:
        targets_of(make_inspection(spacing_m=0.0001))
    suggested = float(str(caught.value).rpartition("; ")[2].split(" ")[0])
    assert 100 < len(targets_of(make_inspection(spacing_m=suggested))) < MOST_POINTS


@pytest.mark.parametrize(
    ("inspect", "words"),
    [
        ({"surfaces": []}, "surfaces"),
        ({"coverage": 1.2}, "coverage"),
        ({"spacing_m": -1.0}, "spacing_m"),
        ({"spacing": 0.1}, "spacing_m"),
        ({"surfaces": [{"mesh": "plate.stl", "box_m": [[1, 1, 1], [0, 2, 2]]}]}, "low below high"),
    ],
)
def test_bad_tables_are_refused_with_their_key(make_inspection: Make, inspect: dict[str, object], words: str) -> None:
    with pytest.raises(FormatError, match=words):
        make_inspection(**inspect)
