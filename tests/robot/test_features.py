"""Every feature of version 2 has its name, and what does not know it refuses it by that name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.robot import FEATURES, refuse_unknown
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape

TENDON = {
    "helical tendons": {"turns": 0.5},
    "converging tendons": {"end_radius_m": 0.006},
    "tendons through points": {
        "points_m": [[0.0, 0.008, 0.0], [0.1, 0.007, 0.0]],
        "angle_deg": None,
        "radius_m": None,
    },
    "straight tendons between disks": {"between_disks": "straight"},
    "tendons that start beyond the base": {"start_disk": 1},
    "tendons that end inside a segment": {"segment": None, "end_disk": 4},
    "tendons that do not surround the backbone on one circle": {"radius_m": 0.007},
    "friction": {"friction_coefficient": 0.1},
}
DRIVE = {
    "displacement drive": {"kind": "displacement"},
    "elastic transmission": {"transmission_stiffness_n_m": 1e4},
    "backlash": {"backlash_m": 1e-4},
    "uneven displacement limits": {"max_displacement_m": [-0.02, 0.01]},
}
ROD = {
    "taper": ("backbone", {"radius_points_m": [[0.0, 0.0005], [0.2, 0.0004]]}),
    "stiffness by axis": ("backbone", {"bending_stiffness_n_m2": [0.002, 0.003]}),
    "rigid stretches": ("backbone", {"rigid_stretches_m": [[0.1, 0.11]]}),
    "disks at given places": ("segments", {"disk_positions_m": [0.01, 0.03, 0.05, 0.07, 0.1]}),
    "payload off the last disk's centre": ("tip", {"mass_kg": 0.001, "offset_m": [0.0, 0.001, 0.0]}),
}


@pytest.mark.parametrize("name", FEATURES)
def test_each_feature_is_named_and_refused(plain, read, name):
    if name in TENDON:
        changed = plain["tendons"][0] | TENDON[name]
        plain["tendons"][0] = {key: value for key, value in changed.items() if value is not None}
    elif name in DRIVE:
        plain["drive"] = DRIVE[name]
    elif name in ROD:
        place, change = ROD[name]
        target = plain["segments"][0] if place == "segments" else plain.setdefault(place, {})
        target |= change
    elif name == "no tension limit":
        plain["drive"] = {"kind": "displacement"}
        del plain["tendons"][0]["max_tension_n"]
    else:
        plain["tendons"].reverse()
    robot = read(plain)
    assert name in robot.features
    with pytest.raises(InputError, match=f"robot 'plain': expected a robot that the planner knows .* got .*{name}"):
        refuse_unknown(robot, robot.features - {name}, "the planner")
    refuse_unknown(robot, robot.features, "the planner")
    with pytest.raises(InputError, match=f"constant curvature knows .*{name}"):
        ConstantCurvatureShape(robot)


def test_what_version_1_can_say_has_no_features(plain, read, any_robot):
    plain["drive"] = {"pretension_n": [0.1, 0.1, 0.1, 0.2, 0.2, 0.2], "max_displacement_m": [-0.02, 0.02]}
    plain["segments"][0] |= {"disk_mass_kg": 0.0, "disk_masses_kg": [0.001, 0.002, 0.001, 0.0, 0.001]}
    plain["camera"] = {"field_of_view_deg": 90.0, "range_m": [0.005, 0.05]}
    robot = read(plain)
    assert robot.features == frozenset()
    refuse_unknown(robot, (), "the planner")
    assert any_robot.features == frozenset()
    np.testing.assert_array_equal(robot.pretensions, [0.1, 0.1, 0.1, 0.2, 0.2, 0.2])


def test_planning_refuses_a_robot_beyond_version_1_before_it_loads_anything(make_scenario, table, read):
    scenario = make_scenario("paper")
    with pytest.raises(InputError, match="a robot that validity = .* knows .* got converging tendons, helical tendons"):
        PlanningSession(replace(scenario, robot=read(table("helical"))))
