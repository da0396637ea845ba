"""Fixtures shared by all tests: the shipped robots and the repository's folders."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.robot import RobotSpec, load_robot

ROOT = Path(__file__).resolve().parents[1]
ROBOT_NAMES = ("paper", "inspection", "two_segment")


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session", params=ROBOT_NAMES)
def any_robot(request: pytest.FixtureRequest) -> RobotSpec:
    return load_robot(ROOT / f"models/robots/{request.param}.toml")


@pytest.fixture(scope="session")
def paper_robot() -> RobotSpec:
    return load_robot(ROOT / "models/robots/paper.toml")


@pytest.fixture(scope="session")
def inspection_robot() -> RobotSpec:
    return load_robot(ROOT / "models/robots/inspection.toml")


@pytest.fixture(scope="session")
def two_segment_robot() -> RobotSpec:
    return load_robot(ROOT / "models/robots/two_segment.toml")


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(20240513)
