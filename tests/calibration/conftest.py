"""A small robot with displacement drive, a motion of it, and files of what a bench would have measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.data import MeasuredStates, read_measured_states
from tdcr_planner.calibration.simulate import smooth_motion, write_simulated
from tdcr_planner.robot import RobotSpec

SEGMENT = {"length_m": 0.06, "disks": 3, "disk_radius_m": 0.0055, "disk_thickness_m": 0.001}


def _make_robot(kind: str = "displacement", between: str = "straight", friction: float = 0.1) -> RobotSpec:
    angles = [(1, 90.0), (1, 210.0), (1, 330.0), (2, 50.0), (2, 170.0), (2, 290.0)]
    drive: dict[str, object] = {"kind": kind, "pretension_n": 1.0}
    if kind == "displacement":
        drive["transmission_stiffness_n_m"] = 7000.0
    return RobotSpec.model_validate(
        {
            "format": "tdcr-robot/2",
            "name": "small bench",
            "backbone": {"youngs_modulus_pa": 50e9, "poisson_ratio": 0.3, "radius_m": 0.0005},
            "segments": [SEGMENT, SEGMENT],
            "tendons": [
                {
                    "segment": segment,
                    "angle_deg": angle,
                    "radius_m": 0.0045,
                    "between_disks": between,
                    "max_tension_n": 30.0,
                    "friction_coefficient": friction,
                    "sheath_angle_deg": 90.0,
                }
                for segment, angle in angles
            ],
            "drive": drive,
        }
    )


@pytest.fixture(scope="session")
def make_robot() -> Callable[..., RobotSpec]:
    """Returns what makes a robot: by kind of drive, what tendons do between disks, and friction."""
    return _make_robot


@pytest.fixture(scope="session")
def robot() -> RobotSpec:
    return _make_robot()


@pytest.fixture(scope="session")
def bench_file(tmp_path_factory: pytest.TempPathFactory, robot: RobotSpec) -> Path:
    """Sixty states of the small robot, with half a millimetre of noise and zeros that are off."""
    random = np.random.default_rng(7)
    bench = replace(Bench.nominal(robot), zeros=np.array([3.0, -2.0, 1.0, 4.0, -1.0, 2.0]) * 1e-4)
    path = tmp_path_factory.mktemp("bench") / "bench.csv"
    return write_simulated(path, bench, smooth_motion(6, 60, 0.002, random), 5e-4, random)


@pytest.fixture(scope="session")
def states(bench_file: Path, robot: RobotSpec) -> MeasuredStates:
    return read_measured_states(bench_file, robot)


@pytest.fixture
def changed(bench_file: Path, tmp_path: Path) -> Callable[[str, str], Path]:
    """Returns a copy of the bench's file with a text replaced."""

    def change(old: str, new: str) -> Path:
        text = bench_file.read_text(encoding="utf-8")
        assert old in text
        path = tmp_path / "bench.csv"
        path.write_text(text.replace(old, new))
        return path

    return change
