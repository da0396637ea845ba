"""A small robot and a model trained on it within seconds, shared by the tests of the training."""

from __future__ import annotations

from pathlib import Path

import pytest

from tdcr_planner.learning.settings import TrainSettings
from tdcr_planner.learning.train import train_model
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.learned import LearnedShape, load_shape_model


def make_settings(**changes: object) -> TrainSettings:
    """Returns settings of a training of a few seconds; keyword arguments replace whole tables."""
    tables = {
        "dataset": {"cases": 6000, "validation_cases": 300, "threads": 1},
        "shooting": {"hidden": [24, 24]},
        "optimiser": {"epochs": 8, "batch_size": 128, "learning_rate": 5e-3},
        "bound": {"alpha": 0.01, "cases": 1000},
    }
    return TrainSettings.model_validate(tables | changes)


@pytest.fixture(scope="session")
def small_settings():
    return make_settings


@pytest.fixture(scope="session")
def small_robot(inspection_robot: RobotSpec) -> RobotSpec:
    """The inspection robot with 6 disks of twice the mass."""
    content = inspection_robot.model_dump()
    segment = content["segments"][0] | {"disks": 6, "disk_mass_kg": 0.001}
    return RobotSpec.model_validate(content | {"name": "small", "segments": [segment]})


@pytest.fixture(scope="session")
def small_model(small_robot: RobotSpec, small_settings, tmp_path_factory: pytest.TempPathFactory) -> LearnedShape:
    path: Path = tmp_path_factory.mktemp("model") / "model.pt"
    train_model(small_robot, small_settings(), path)
    return load_shape_model(path, small_robot)
