"""The suite: which scenarios, planners, shape models and seeds a sweep combines, read from TOML."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from tdcr_planner.bounds import JOBS, SEARCH_SEED, TIME_S
from tdcr_planner.collision.mesh_files.registry import mesh_sha256
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.files import (
    FileModel,
    find_named_file,
    parse_table,
    read_toml,
    real_path,
    sha256_of_file,
    sha256_of_json,
)
from tdcr_planner.planning.planners import check_planner_name, find_planner
from tdcr_planner.planning.scenario import Scenario, Validity, load_scenario
from tdcr_planner.shape.registry import SHAPE_MODELS

_LEVELS = ("easy", "medium", "hard")
_SHOWN = 10  # names in a message


class SuiteEntry(FileModel):
    """A scenario of a suite.

    Attributes:
        file: The scenario file, relative to the suite file; also the scenario's name in tables.
        difficulty: A level by which results are grouped, for example "easy", "medium" or "hard".
    """

    file: Annotated[str, Field(min_length=1)]
    difficulty: Annotated[str, Field(min_length=1)]


class SuiteFile(FileModel):
    """The content of a suite file.

    Attributes:
        scenarios: The scenarios.
        planners: Planners by their names in `planning.planners`, or "module:function" for one's own.
        models: Shape models that the search asks.
        seeds: Seeds of the search, each above 0.
        time_limit_s: Time for each query in place of the scenarios' own.
        title: What the suite is called.
    """

    format: Literal["tdcr-suite/1"]
    scenarios: tuple[SuiteEntry, ...]
    planners: tuple[str, ...]
    models: tuple[Validity, ...]
    seeds: tuple[Annotated[int, AfterValidator(SEARCH_SEED.validate)], ...]
    time_limit_s: Annotated[float, AfterValidator(TIME_S.validate)] | None = None
    title: str = ""

    @field_validator("scenarios", "planners", "models", "seeds")
    @classmethod
    def _check_list(cls, value: tuple[Any, ...]) -> tuple[Any, ...]:
        if not value:
            raise ValueError("expected one or more, got none: there would be nothing to do")
        names = [item.file if isinstance(item, SuiteEntry) else item for item in value]
        twice = sorted(str(name) for name, count in Counter(names).items() if count > 1)
        if twice:
            raise ValueError(f"expected each once, got more than one of {', '.join(twice[:_SHOWN])}")
        return value

    @model_validator(mode="after")
    def _check_jobs(self) -> SuiteFile:
        JOBS.validate(math.prod(len(items) for items in (self.scenarios, self.planners, self.models, self.seeds)))
        return self


@dataclass(frozen=True)
class SweepJob:
    """One query of a sweep, complete in itself: any process that sees the files can run it.

    Attributes:
        index: Its place in the sweep, from 0.
        scenario: The scenario's name: its file as the suite writes it.
        path: The scenario file, absolute.
        sha256: Hash of the scenario file that was meant.
        difficulty: The scenario's level.
        planner: Planner.
        model: Shape model that the search asks.
        seed: Seed of the search.
        time_limit_s: Time for the query, s.
    """

    index: int
    scenario: str
    path: str
    sha256: str
    difficulty: str
    planner: str
    model: Validity
    seed: int
    time_limit_s: float

    @property
    def name(self) -> str:
        """The job for a person."""
        return f"{self.scenario}, {self.planner}, {self.model}, seed {self.seed}"


@dataclass(frozen=True)
class Suite:
    """A suite whose scenarios are loaded.

    Attributes:
        path: The suite file, absolute.
        file: Its content.
        jobs: What there is to do, scenario by scenario.
        sha256: Hash of everything that decides the results: the suite and the files that it names, one by one.
    """

    path: Path
    file: SuiteFile
    jobs: tuple[SweepJob, ...]
    sha256: str

    @property
    def title(self) -> str:
        """What the suite is called."""
        return self.file.title or self.path.stem

    @property
    def difficulties(self) -> tuple[str, ...]:
        """The levels that occur, easy to hard, others after them in the suite's order."""
        found = list(dict.fromkeys(entry.difficulty for entry in self.file.scenarios))
        return tuple(sorted(found, key=lambda name: _LEVELS.index(name) if name in _LEVELS else len(_LEVELS)))


def load_suite(path: str | Path, *, import_planners: bool = True) -> Suite:
    """Returns the suite that a TOML file describes.

    Args:
        path: The suite file.
        import_planners: Whether planners "module:function" are imported, which runs the module; without it only their
            form is checked.

    Raises:
        FormatError: The suite, one of its scenarios or a file that they name is missing or not what it should be; a
            planner or model is unknown; there is nothing to do.
    """
    file = real_path(path)
    content = parse_table(SuiteFile, read_toml(path), path)
    for index, planner in enumerate(content.planners):
        try:
            find_planner(planner) if import_planners else check_planner_name(planner)
        except InputError as error:
            raise FormatError(path, f"expected {error.expected}; got {error.got}", f"planners[{index + 1}]") from error
    scenarios = [_load_entry(file, entry, index, content) for index, entry in enumerate(content.scenarios)]
    jobs = []
    combinations = itertools.product(
        zip(content.scenarios, scenarios, strict=True), content.planners, content.models, content.seeds
    )
    for index, ((entry, scenario), planner, model, seed) in enumerate(combinations):
        limit = content.time_limit_s or scenario.planner.time_limit_s
        job = SweepJob(
            index, entry.file, str(scenario.path), scenario.sha256, entry.difficulty, planner, model, seed, limit
        )
        jobs.append(job)
    return Suite(file, content, tuple(jobs), _hash(content, scenarios))


def _load_entry(suite: Path, entry: SuiteEntry, index: int, content: SuiteFile) -> Scenario:
    place = f"scenarios[{index + 1}].file"
    target = find_named_file(suite.parent / entry.file, suite, place)
    scenario = load_scenario(target)
    if scenario.shape_model_path is None:
        needing = [name for name in content.models if SHAPE_MODELS.find(name).needs_file]
        if needing:
            raise FormatError(suite, f"models has {needing[0]!r}, but {target} names no shape_model", place)
    return scenario


def _hash(content: SuiteFile, scenarios: Iterable[Scenario]) -> str:
    table = content.model_dump(exclude={"title"})
    inputs = []
    for scenario in scenarios:
        model = scenario.shape_model_path
        inputs.append(
            {
                "scenario": scenario.sha256,
                "robot": scenario.robot.model_dump(mode="json"),  # whole: its body and limits decide paths, too
                "model": None if model is None else sha256_of_file(model),
                "meshes": [mesh_sha256(scenario.resolve(mesh.file)) for mesh in scenario.file.meshes],
            }
        )
    return sha256_of_json({"suite": table, "inputs": inputs})
