"""Version 2 robots as tables: the shipped ones, and the twins of version 1 robots."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tdcr_planner.files import parse_table
from tdcr_planner.robot import RobotSpec

Table = dict[str, Any]
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def table() -> Callable[[str], Table]:
    """Returns a shipped robot's table, to be changed."""
    return lambda name: tomllib.loads((ROOT / f"models/robots/{name}.toml").read_text(encoding="utf-8"))


@pytest.fixture
def read() -> Callable[[Table], RobotSpec]:
    """Reads a table as a robot file named robot.toml."""
    return lambda content: parse_table(RobotSpec, content, "robot.toml")


@pytest.fixture
def plain() -> Table:
    """Returns the table of a version 2 robot with all defaults: two segments of 0.1 m, three tendons each."""
    segment = {"length_m": 0.1, "disks": 5, "disk_radius_m": 0.01, "disk_thickness_m": 0.002, "disk_mass_kg": 0.001}
    return {
        "format": "tdcr-robot/2",
        "name": "plain",
        "backbone": {"youngs_modulus_pa": 60e9, "poisson_ratio": 0.3, "radius_m": 0.0005, "density_kg_m3": 8000.0},
        "segments": [dict(segment), dict(segment)],
        "tendons": [
            {"segment": number, "angle_deg": angle + 60.0 * number, "radius_m": 0.008, "max_tension_n": 5.0}
            for number in (1, 2)
            for angle in (0.0, 120.0, 240.0)
        ],
    }


@pytest.fixture
def twin() -> Callable[[RobotSpec], RobotSpec]:
    """Returns the version 2 file that says what a version 1 robot says."""

    def of(robot: RobotSpec) -> RobotSpec:
        content = robot.model_dump()
        tendons, pretensions = [], []
        for index, segment in enumerate(content["segments"]):
            of_tendon = {"segment": index + 1, "radius_m": segment.pop("tendon_circle_radius_m")}
            of_tendon["max_tension_n"] = segment.pop("max_tension_n")
            of_tendon["axial_stiffness_n"] = segment.pop("tendon_axial_stiffness_n")
            angles = segment.pop("tendon_angles_deg")
            tendons += [of_tendon | {"angle_deg": angle} for angle in angles]
            pretensions += [segment.pop("pretension_n")] * len(angles)
            assert segment.pop("max_tendon_displacement_m") is None
        content |= {"format": "tdcr-robot/2", "tendons": tendons, "drive": {"pretension_n": pretensions}}
        return RobotSpec.model_validate(content)

    return of
