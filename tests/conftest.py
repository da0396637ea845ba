"""Fixtures shared by all tests: the shipped robots, the repository's folders, scenarios made on the spot."""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tdcr_planner.planning.scenario import Scenario, load_scenario
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


@pytest.fixture(scope="session")
def networks() -> Any:
    """`benchmarks/foreign_networks.py`: networks as other people write them."""
    return _benchmark("foreign_networks")


@pytest.fixture(scope="session")
def attacks() -> Any:
    """`benchmarks/foreign_attacks.py`: modules that do more than to compute."""
    return _benchmark("foreign_attacks")


def _benchmark(name: str) -> Any:
    # TorchScript looks for a class's source by the name of its module, so that it must be one that can be imported.
    if str(ROOT / "benchmarks") not in sys.path:
        sys.path.append(str(ROOT / "benchmarks"))
    return importlib.import_module(name)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(20240513)


def to_toml(table: dict[str, Any]) -> str:
    """Returns a table as TOML, nested tables as inline ones."""
    return "".join(f"{key} = {_value(value)}\n" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return json.dumps(value)


def base_table(robot: str = "paper") -> dict[str, Any]:
    """Returns a small valid scenario: a box beside the robot, constant curvature as validity."""
    rows = 2 if robot == "two_segment" else 1
    return {
        "format": "tdcr-scenario/1",
        "robot": str(ROOT / f"models/robots/{robot}.toml"),
        "meshes": [{"file": "box.stl", "unit": "mm", "role": "obstacle"}],
        "start": {"bending_n": [[0.0, 0.0]] * rows},
        "goal": {"bending_n": [[1.0, 0.0]] * rows},
        "planner": {"validity": "constant_curvature"},
    }


@pytest.fixture
def write_scenario(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Returns a function that writes a scenario table beside a 100 mm box 300 mm off the robot and gives its path."""

    def write(table: dict[str, Any]) -> Path:
        box = trimesh.creation.box((100.0, 100.0, 100.0))
        box.apply_translation((300.0, 0.0, 0.0))
        box.export(tmp_path / "box.stl")
        path = tmp_path / "scenario.toml"
        path.write_text(to_toml(table))
        return path

    return write


@pytest.fixture
def make_scenario(write_scenario: Callable[[dict[str, Any]], Path]) -> Callable[..., Scenario]:
    """Returns a function that gives a loaded scenario: the base table of a robot with some keys replaced."""

    def make(robot: str = "paper", **changes: Any) -> Scenario:
        return load_scenario(write_scenario({**base_table(robot), **changes}))

    return make


@pytest.fixture
def as_in_a_terminal() -> Iterator[None]:
    """Lets Ctrl-C raise, as it does in a terminal: a test run in the background inherits an ignored SIGINT."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class Cluster:
    """A scheduler and workers of one thread each, processes of this machine, loopback only."""

    def __init__(self, folder: Path, imports: Path | None) -> None:
        self._folder = folder
        self._stack = ExitStack()
        self._environment = {
            **os.environ,
            **({} if imports is None else {"PYTHONPATH": str(imports)}),
            "DASK_DISTRIBUTED__WORKER__MEMORY__TERMINATE": "false",
            "DASK_DISTRIBUTED__SCHEDULER__WORK_STEALING": "true",
        }
        file = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show", "--scheduler-file", file
        )
        deadline = time.monotonic() + 60.0
        while not file.exists() or not file.stat().st_size:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        self.address = json.loads(file.read_text(encoding="utf-8"))["address"]
        self.workers: list[subprocess.Popen[bytes]] = []

    def add_worker(self) -> None:
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        self.workers.append(self._start("worker", self.address, *options, "--local-directory", self._folder))

    def _start(self, *arguments: object) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", *(str(argument) for argument in arguments)]
        log = self._stack.enter_context((self._folder / f"{arguments[0]}.log").open("ab"))
        process = self._stack.enter_context(
            subprocess.Popen(command, stdout=log, stderr=log, env=self._environment, cwd=self._folder)
        )
        self._stack.callback(process.kill)
        return process

    def close(self) -> None:
        self._stack.close()


@pytest.fixture
def start_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Cluster]]:
    """Returns a function that starts a Dask scheduler without workers, which may import from a folder."""
    with ExitStack() as running:

        def start(imports: Path | None = None) -> Cluster:
            cluster = Cluster(tmp_path_factory.mktemp("dask"), imports)
            running.callback(cluster.close)
            return cluster

        yield start
