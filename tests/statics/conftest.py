"""Robots made on the spot and random loads for the tests of the statics."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdcr_planner.robot import RobotSpec
from tdcr_planner.statics.solver import SolverSettings


def make_robot(
    *,
    length: float = 0.2,
    disks: int = 20,
    radius: float = 0.0005,
    density: float = 0.0,
    disk_mass: float = 0.0,
    tip_mass: float = 0.0,
    modulus: float = 60e9,
    circles: Sequence[float] = (0.008,),
    angles: Sequence[float] = (90.0, -30.0, 210.0),
    backbone: dict[str, Any] | None = None,
    segments: Sequence[dict[str, Any]] = (),
) -> RobotSpec:
    """Returns a robot of equal segments, one for each tendon circle; `segments` overrides keys of single segments."""
    parts = []
    for index, circle in enumerate(circles):
        part = {
            "length_m": length / len(circles),
            "disks": disks // len(circles),
            "disk_radius_m": 0.02,
            "disk_thickness_m": 1e-4,
            "disk_mass_kg": disk_mass,
            "tendon_circle_radius_m": circle,
            "tendon_angles_deg": list(angles),
            "max_tension_n": 10.0,
        }
        parts.append(part | (segments[index] if index < len(segments) else {}))
    table = {
        "format": "tdcr-robot/1",
        "name": "made on the spot",
        "backbone": {
            "youngs_modulus_pa": modulus,
            "poisson_ratio": 0.3,
            "radius_m": radius,
            "density_kg_m3": density,
        }
        | (backbone or {}),
        "segments": parts,
        "tip": {"mass_kg": tip_mass},
    }
    return RobotSpec.model_validate(table)


@pytest.fixture(scope="session")
def robot_of() -> Callable[..., RobotSpec]:
    return make_robot


@pytest.fixture(scope="session")
def general_robot() -> RobotSpec:
    """Three segments, each with its own backbone: hollow, precurved, with other tendon numbers, angles and circles."""
    base = {"youngs_modulus_pa": 60e9, "poisson_ratio": 0.3, "radius_m": 0.0006, "density_kg_m3": 8000.0}
    return make_robot(
        length=0.24,
        disks=24,
        circles=(0.009, 0.007, 0.005),
        density=8000.0,
        disk_mass=0.0003,
        tip_mass=0.001,
        segments=(
            {"backbone": base | {"inner_radius_m": 0.0003}},
            {"tendon_angles_deg": [0.0, 80.0, 190.0, 275.0], "disks": 5},
            {"backbone": base | {"radius_m": 0.0004, "rest_curvature_1_m": [2.0, -1.0, 3.0]}},
        ),
    )


@pytest.fixture(scope="session")
def tight() -> SolverSettings:
    """As exact as the arithmetic allows, with steps whose error is below the tolerances of the tests."""
    return SolverSettings(tolerance=1e-12, steps_per_gap=4)


def random_vectors(random: np.random.Generator, count: int, largest: float) -> np.ndarray:
    """Returns vectors of random direction, of size 0 to `largest`, shape (count, 3)."""
    vector = random.normal(size=(count, 3))
    return vector / np.linalg.norm(vector, axis=1)[:, None] * random.uniform(0.0, largest, (count, 1))


@pytest.fixture(scope="session")
def loads_of() -> Callable[..., tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Random tensions within `share` of the limits with gravity and tip force, and on request every other load."""

    def loads(
        robot: RobotSpec,
        random: np.random.Generator,
        count: int,
        *,
        force: float = 0.1,
        share: float = 1.0,
        everything: bool = False,
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        tensions = random.uniform(0.0, share, (count, robot.tendon_count)) * robot.max_tensions
        outside = {
            "gravity": random_vectors(random, count, 9.81),
            "tip_force": random_vectors(random, count, force),
        }
        if everything:
            outside["tip_moment"] = random_vectors(random, count, 0.002)
            outside["distributed_force"] = random_vectors(random, count, 0.1)
            outside["disk_forces"] = random_vectors(random, count * robot.disk_count, 0.01).reshape(count, -1, 3)
        return tensions, outside

    return loads


@pytest.fixture(scope="session")
def extrapolated() -> Callable[..., tuple[np.ndarray, float]]:
    """The solver of another kind, `chain.extrapolated`."""
    specification = importlib.util.spec_from_file_location("statics_chain", Path(__file__).parent / "chain.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module.extrapolated


def make_routed_robot(
    tendons: Sequence[dict[str, Any]],
    *,
    disks: int = 20,
    length: float = 0.2,
    backbone: dict[str, Any] | None = None,
    segments: Sequence[dict[str, Any]] | None = None,
    drive: dict[str, Any] | None = None,
    tip: dict[str, Any] | None = None,
    disk_mass: float = 0.0003,
) -> RobotSpec:
    """Returns a version 2 robot; `segments` replaces the one segment."""
    one = {
        "length_m": length,
        "disks": disks,
        "disk_radius_m": 0.012,
        "disk_thickness_m": 1e-4,
        "disk_mass_kg": disk_mass,
    }
    default = {"max_tension_n": 10.0, "segment": len(segments or [{}])}
    table = {
        "format": "tdcr-robot/2",
        "name": "routed",
        "backbone": {
            "youngs_modulus_pa": 60e9,
            "poisson_ratio": 0.3,
            "radius_m": 0.0005,
            "density_kg_m3": 8000.0,
        }
        | (backbone or {}),
        "segments": [one | segment for segment in segments or [{}]],
        "tendons": [
            {key: value for key, value in (default | tendon).items() if value is not None} for tendon in tendons
        ],
        "tip": tip or {},
    }
    if "radius_points_m" in table["backbone"]:
        del table["backbone"]["radius_m"]
    if drive is not None:
        table["drive"] = drive
    return RobotSpec.model_validate(table)


@pytest.fixture(scope="session")
def routed() -> Callable[..., RobotSpec]:
    return make_routed_robot
