"""A small robot, a model trained on it within seconds and shapes measured of it, for the tests of the training."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from tdcr_planner.learning.dataset import draw_cases
from tdcr_planner.learning.settings import DomainSettings, TrainSettings
from tdcr_planner.learning.train import train_model
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.learned import LearnedShape, load_shape_model
from tdcr_planner.statics.solver import solve_statics


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


@pytest.fixture(scope="session")
def write_csv():
    """A function that writes a header and rows to a path and returns it."""

    def write(path: Path, header: list[str], rows: Iterable[Iterable[object]]) -> Path:
        path.write_text("\n".join([",".join(header), *(",".join(str(value) for value in row) for row in rows)]) + "\n")
        return path

    return write


@pytest.fixture
def bench(small_robot: RobotSpec, write_csv, tmp_path: Path, random: np.random.Generator) -> Path:
    """50 shapes with 0.5 mm of noise of a robot 15 % stiffer than its file says, gravity down, three disks tracked."""
    domain = DomainSettings().for_robot(small_robot)
    cases = draw_cases(small_robot, domain, "planner", 50, random)
    gravity = np.broadcast_to([0.0, 0.0, -9.81], (50, 3))
    solution = solve_statics(small_robot.scaled(stiffness=1.15), cases.tensions, gravity=gravity)
    assert solution.converged.all()
    points = solution.positions[:, [2, 4, 6]] + random.normal(0.0, 5e-4, (50, 3, 3))
    header = [f"tension_{i}_n" for i in range(3)]
    header += [f"gravity_{axis}_m_s2" for axis in "xyz"]
    header += [f"disk_{disk}_{axis}_m" for disk in (2, 4, 6) for axis in "xyz"]
    rows = np.hstack([cases.tensions, gravity, points.reshape(50, 9)])
    return write_csv(tmp_path / "bench.csv", header, rows)
