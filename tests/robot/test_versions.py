"""Version 1 stays what it was; its twin in version 2 is the same robot; neither takes keys of the other."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.errors import FormatError
from tdcr_planner.files import parse_table, sha256_of_json
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.plausibility import doubts
from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

# Shape models, roadmaps and results that users have hold these: another value would make their files useless.
HASHES = {
    "borescope": ("7850c06448c4dc49542a2f08aaaf638b99d99c64676c40b8836e4e016f0f2125", "14376e19d535c568"),
    "inspection": ("1de1160536ff79c37954aa86f8c4b7edccd078dcec23e3c1bdccc6be50ce66cb", "0baf80a8934c7bca"),
    "paper": ("f646638dd9a8f1c65c8ecc534bc208c6531823d05cffd1a3580645e13ada480d", "98186491c378e33e"),
    "two_segment": ("45042a8b0e56a6070367f3a913c6d74371693d9566bff4599eaef41961a497f4", "558d9236bb6648a4"),
}


@pytest.mark.parametrize("name", HASHES)
def test_version_1_robots_keep_their_hashes_and_their_content(root, name):
    robot = load_robot(root / f"models/robots/{name}.toml")
    mechanics, content = HASHES[name]
    assert robot.mechanics_hash == mechanics
    assert sha256_of_json(robot.model_dump()).startswith(content)
    assert RobotSpec.model_validate_json(robot.model_dump_json()) == robot


ARRAYS = ["arc_lengths", "disk_segments", "disk_masses", "disk_radii", "disk_thicknesses", "segment_ends", "joins"]
ARRAYS += ["tendon_segments", "tendon_angles", "tendon_radii", "tendon_offsets", "max_tensions", "pretensions"]
ARRAYS += ["tendon_stiffnesses", "rest_path_lengths"]


@pytest.mark.parametrize("name", HASHES)
def test_a_version_2_file_that_says_the_same_is_the_same_robot(root, name, twin, random):
    robot = load_robot(root / f"models/robots/{name}.toml")
    other = twin(robot)
    assert other.features == frozenset()
    assert other.mechanics_hash == robot.mechanics_hash
    for array in ARRAYS:
        np.testing.assert_array_equal(getattr(other, array), getattr(robot, array))
    bending = random.uniform(-2.0, 2.0, (20, robot.segment_count, 2))
    tensions = robot.tensions_from_bending(bending)
    np.testing.assert_array_equal(other.tensions_from_bending(bending), tensions)
    mine, theirs = (ConstantCurvatureShape(each).disk_poses(tensions) for each in (robot, other))
    np.testing.assert_array_equal(mine.positions, theirs.positions)


def test_a_version_2_twin_spans_the_same_configurations(twin, make_scenario):
    scenario = make_scenario("two_segment")
    space = ConfigurationSpace(scenario)
    other = ConfigurationSpace(replace(scenario, robot=twin(scenario.robot)))
    np.testing.assert_array_equal(space.upper, other.upper)
    rows = space.sample(20, np.random.default_rng(1))
    np.testing.assert_array_equal(rows, other.sample(20, np.random.default_rng(1)))
    np.testing.assert_array_equal(space.actuate(rows).tensions, other.actuate(rows).tensions)


@pytest.mark.parametrize("name", ["bench", "helical"])
def test_version_2_robots_survive_copies_json_and_pickling(table, read, name):
    robot = read(table(name))
    assert robot.model_copy() == robot
    assert RobotSpec.model_validate_json(robot.model_dump_json()) == robot
    copied = pickle.loads(pickle.dumps(robot))
    assert copied == robot
    assert hash(copied) == hash(robot)
    np.testing.assert_array_equal(copied.tendons[0].offsets([0.01]), robot.tendons[0].offsets([0.01]))
    heavier = robot.scaled(mass=2.0)
    assert heavier.tip.mass_kg == 2.0 * robot.tip.mass_kg
    assert heavier.backbone_mass == pytest.approx(2.0 * robot.backbone_mass)
    assert heavier.mechanics_hash != robot.mechanics_hash
    assert robot.with_tension_limits_times(3.0).max_tensions.tolist() == (3.0 * robot.max_tensions).tolist()


@pytest.mark.parametrize(
    ("place", "key", "value", "message"),
    [
        (("segments", 0), "rigid", False, 'segments[1].rigid: a key of format = "tdcr-robot/2", and this file says'),
        (
            ("segments", 0),
            "disk_positions_m",
            [0.01 * i for i in range(1, 21)],
            "segments[1].disk_positions_m: a key of format",
        ),
        (("backbone",), "axial_stiffness_n", 1e4, 'backbone.axial_stiffness_n: a key of format = "tdcr-robot/2"'),
        (("tip",), "offset_m", [0.0, 0.0, 0.01], 'tip.offset_m: a key of format = "tdcr-robot/2"'),
        (
            (),
            "drive",
            {"kind": "tension"},
            'drive: a key of format = "tdcr-robot/2", and this file says "tdcr-robot/1"',
        ),
        ((), "camera", {"field_of_view_deg": 90.0, "range_m": [0.0, 0.1]}, "camera: a key of format"),
        ((), "tendons", [{"segment": 1, "angle_deg": 0.0, "radius_m": 0.008}], "tendons: a key of format"),
        (("segments", 0), "tendon_angles_deg", None, "segments[1].tendon_angles_deg: missing, and it is required"),
    ],
)
def test_version_1_files_do_not_take_keys_of_version_2(table, read, place, key, value, message):
    content = table("paper") | {"tip": {}}
    target: Any = content
    for step in place:
        target = target[step]
    target[key] = value
    if value is None:
        del target[key]
    with pytest.raises(FormatError, match=re.escape(message)):
        read(content)


def test_version_2_files_do_not_take_keys_of_version_1_and_say_what_replaces_them(table, read):
    content = table("paper") | {"format": "tdcr-robot/2"}
    with pytest.raises(FormatError) as caught:
        read(content)
    for words in (
        'segments[1].tendon_angles_deg: a key of format = "tdcr-robot/1"; in this version `angle_deg` of each',
        "segments[1].pretension_n: a key of",
        "`pretension_n` of [drive] says it",
    ):
        assert words in str(caught.value)


def test_an_unknown_version_is_named(table, read):
    with pytest.raises(FormatError, match="is a tdcr-robot/3 file, expected tdcr-robot/1 or tdcr-robot/2"):
        read(table("paper") | {"format": "tdcr-robot/3"})


def test_hash_of_version_2_follows_mechanics_and_nothing_else(table, read):
    original = read(table("bench")).mechanics_hash
    for changes in (
        {"name": "other"},
        {"camera": {"field_of_view_deg": 50.0, "range_m": [0.0, 0.1]}},
        {"body": {"between_disks": "sleeve"}},
    ):
        assert read(table("bench") | changes).mechanics_hash == original
    for key, value, same in (
        ("max_displacement_m", [-0.01, 0.01], True),
        ("spool_radius_m", 0.01, True),
        ("pretension_n", 2.0, False),
        ("backlash_m", 1e-3, False),
        ("transmission_stiffness_n_m", 8000.0, False),
    ):
        content = table("bench")
        content["drive"][key] = value
        assert (read(content).mechanics_hash == original) is same, key
    for key, value, same in (
        ("max_tension_n", 30.0, True),
        ("turns", 0.0, True),
        ("friction_coefficient", 0.2, False),
        ("axial_stiffness_n", 2e4, False),
        ("angle_deg", 91.0, False),
    ):
        content = table("bench")
        content["tendons"][0][key] = value
        assert (read(content).mechanics_hash == original) is same, key
    content = table("bench")
    del content["tendons"][3]["segment"]
    content["tendons"][3]["end_disk"] = 12
    assert read(content).mechanics_hash == original


ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 600),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -1.0, 1e-300, 1e30, 1e-3, 0.05, 0.1, "channel", "straight", "tension", "x", {}, {"x": 1}]),
    st.lists(st.floats(-1.0, 1.0), max_size=4),
    st.lists(st.lists(st.floats(-0.2, 0.2), max_size=3), max_size=4),
)
PLACES = [
    *(("backbone", key) for key in ("radius_m", "radius_points_m", "bending_stiffness_n_m2", "shear_stiffness_n")),
    *(("backbone", key) for key in ("rigid_stretches_m", "inner_radius_m", "rest_curvature_1_m", "axial_stiffness_n")),
    *(("segments", 0, key) for key in ("disks", "disk_positions_m", "disk_masses_kg", "rigid", "length_m")),
    *(("segments", 1, key) for key in ("disk_radius_m", "disk_thickness_m", "backbone", "max_tension_n")),
    *(("tendons", 0, key) for key in ("segment", "end_disk", "start_disk", "angle_deg", "radius_m", "points_m")),
    *(("tendons", 4, key) for key in ("end_radius_m", "turns", "between_disks", "max_tension_n", "sheath_angle_deg")),
    *(("tendons", 5, key) for key in ("friction_coefficient", "axial_stiffness_n")),
    *(("drive", key) for key in ("kind", "transmission_stiffness_n_m", "pretension_n", "backlash_m")),
    *(("drive", key) for key in ("max_displacement_m", "spool_radius_m")),
    *(("camera", key) for key in ("position_m", "direction", "field_of_view_deg", "range_m", "max_incidence_deg")),
    *(("tip", key) for key in ("mass_kg", "offset_m")),
    *((key,) for key in ("tendons", "drive", "camera", "segments", "name", "body", "format")),
]


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.sampled_from(PLACES), ODD), min_size=1, max_size=3))
def test_any_values_are_a_robot_or_named_faults(changes: list[tuple[tuple[str | int, ...], Any]]) -> None:
    content: dict[str, Any] = _plain() | {
        "drive": {},
        "camera": {"field_of_view_deg": 90, "range_m": [0, 1]},
        "tip": {},
    }
    for place, value in changes:
        _put(content, place, value)
    try:
        robot = parse_table(RobotSpec, content, "robot.toml")
    except FormatError:
        return
    assert np.isfinite(robot.stiffness_at(robot.arc_lengths)).all()
    assert all(np.isfinite(tendon.offsets(robot.arc_lengths)).all() for tendon in robot.tendons)
    assert robot.mechanics_hash
    assert all(isinstance(doubt, str) for doubt in doubts(robot))
    assert RobotSpec.model_validate(robot.model_dump()) == robot


def _put(content: dict[str, Any], place: tuple[str | int, ...], value: Any) -> None:
    """Puts a value at a place, unless an earlier change has taken that place away."""
    target: Any = content
    for step in place[:-1]:
        inside = isinstance(target, dict) and step in target
        inside = inside or (isinstance(target, list) and isinstance(step, int) and step < len(target))
        if not inside:
            return
        target = target[step]
    if isinstance(target, dict):
        target[place[-1]] = value


def _plain() -> dict[str, Any]:
    segment = {"length_m": 0.1, "disks": 5, "disk_radius_m": 0.01, "disk_thickness_m": 0.002}
    tendon = {"radius_m": 0.008, "max_tension_n": 5.0}
    return {
        "format": "tdcr-robot/2",
        "name": "plain",
        "backbone": {"youngs_modulus_pa": 60e9, "poisson_ratio": 0.3, "radius_m": 0.0005},
        "segments": [dict(segment), dict(segment)],
        "tendons": [
            {"segment": number, "angle_deg": angle, **tendon} for number in (1, 2) for angle in (0.0, 120.0, 240.0)
        ],
    }
