"""The study file: which numbers of a robot to vary, in which scene, and what to judge a design by."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from tdcr_planner.bounds import SEED, TIME_S
from tdcr_planner.errors import FormatError, nearest_name
from tdcr_planner.files import FileModel, find_named_file, parse_table, read_toml, real_path, sha256_of_file

Measure = Literal["coverage", "reach", "clearance", "success"]
SEGMENT_COUNT = "segment_count"
CAMERA_TILT = "camera.tilt_deg"
SCENARIO_PREFIX = "scenario."
_KEY = re.compile(r"[a-z_0-9]+(\[(\d+|\*)\])*(\.[a-z_0-9]+(\[(\d+|\*)\])*)*")
Seconds = Annotated[float, AfterValidator(TIME_S.validate)]


class Parameter(FileModel):
    """A number that designs differ in.

    Attributes:
        keys: Where it goes: keys of the robot file, as "segments[1].length_m"; [*] for all entries of a list;
            "segment_count" repeats the last segment; "camera.tilt_deg" turns the optical axis from the disk's z axis
            towards x; with "scenario." before it, a key of the scenario, as "scenario.base.insertion_m[2]".
        low: Least value.
        high: Largest value.
        whole: Whether it is a whole number.
        log: Whether its logarithm is searched evenly.
        name: What to call it; the first key where it is empty.
    """

    keys: Annotated[tuple[str, ...], Field(min_length=1)]
    low: float
    high: float
    whole: bool = False
    log: bool = False
    name: str = ""

    @field_validator("keys")
    @classmethod
    def _check_keys(cls, keys: tuple[str, ...]) -> tuple[str, ...]:
        for key in keys:
            if not _KEY.fullmatch(key):
                raise ValueError(f"expected keys such as 'segments[1].length_m', got {key!r}")
        return keys

    @model_validator(mode="after")
    def _check_range(self) -> Parameter:
        if self.low >= self.high:
            raise ValueError(f"expected low below high, got {self.low:g} and {self.high:g}")
        if self.log and self.low <= 0.0:
            raise ValueError(f"log needs a low above 0, got {self.low:g}")
        if self.whole and (self.low != round(self.low) or self.high != round(self.high)):
            raise ValueError(f"whole needs whole bounds, got {self.low:g} and {self.high:g}")
        return self

    @property
    def label(self) -> str:
        """What to call it."""
        return self.name or self.keys[0]


class Limit(FileModel):
    """What a design must keep: a measure, or the robot's length_m, within bounds.

    Attributes:
        of: "length_m" or a measure of the study.
        least: Smallest value; None for any.
        most: Largest value; None for any.
    """

    of: str
    least: float | None = None
    most: float | None = None


class StudyFile(FileModel):
    """The content of a study file.

    Attributes:
        scenario: The scene, with a robot to start from.
        parameters: What is varied.
        measures: What is to be large: coverage (share of the surfaces that free shapes see), reach (volume that the
            tip reaches, m^3), clearance (least of the verified paths, m), success (share of scenarios solved).
        scenarios: For clearance and success: queries with goals; the robot is the design's.
        limits: What a design must keep.
        trials: Number of designs.
        seed: Of the search.
        search_s: Time for each measure of a design.
        cells: Cells of a reach map.
        confirm: How many of the best designs get a full verified inspection or plans.
        confirm_s: Time for each of these.
    """

    format: Literal["tdcr-study/1"]
    title: str = ""
    scenario: str
    parameters: Annotated[tuple[Parameter, ...], Field(min_length=1)]
    measures: Annotated[tuple[Measure, ...], Field(min_length=1)] = ("coverage",)
    scenarios: tuple[str, ...] = ()
    limits: tuple[Limit, ...] = ()
    trials: Annotated[int, Field(ge=1, le=100_000)] = 50
    seed: Annotated[int, AfterValidator(SEED.validate)] = 1
    search_s: Seconds = 10.0
    cells: Annotated[int, Field(ge=8, le=200_000)] = 2_000
    confirm: Annotated[int, Field(ge=0, le=100)] = 2
    confirm_s: Seconds = 300.0

    @model_validator(mode="after")
    def _check_measures(self) -> StudyFile:
        if len(set(self.measures)) < len(self.measures):
            raise ValueError(f"measures: expected each once, got {list(self.measures)}")
        if not self.scenarios and set(self.measures) & {"clearance", "success"}:
            raise ValueError("scenarios: clearance and success need one or more scenarios with goals")
        known = {"length_m", *self.measures}
        for limit in self.limits:
            if limit.of not in known:
                raise ValueError(f"limits: {limit.of!r} is no measure of the study; {nearest_name(limit.of, known)}")
        names = [parameter.label for parameter in self.parameters]
        if len(set(names)) < len(names):
            raise ValueError(f"parameters: expected names that differ, got {names}")
        return self


@dataclass(frozen=True)
class Study:
    """A study whose files are known to be there.

    Attributes:
        path: The study file, absolute.
        sha256: Hash of its bytes.
        file: Its content.
        scenario: The scene's file, absolute.
        scenarios: The files of the queries for clearance and success, absolute.
    """

    path: Path
    sha256: str
    file: StudyFile
    scenario: Path
    scenarios: tuple[Path, ...]


def load_study(path: str | Path) -> Study:
    """Returns the study that a TOML file describes.

    Raises:
        FormatError: The file is missing or not a study, a scenario is missing, or a parameter names no number of the
            robot or scenario file.
    """
    from tdcr_planner.design.variants import apply, base_tables

    file = real_path(path)
    content = read_toml(path)
    if content.get("parameters") == [] or "parameters" not in content:
        raise FormatError(path, "expected one or more [[parameters]] to vary, got none", "parameters")
    study = parse_table(StudyFile, content, path)
    scenario = find_named_file(file.parent / study.scenario, path, "scenario")
    queries = [
        find_named_file(file.parent / name, path, f"scenarios[{index + 1}]")
        for index, name in enumerate(study.scenarios)
    ]
    loaded = Study(file, sha256_of_file(file), study, Path(scenario), tuple(Path(query) for query in queries))
    tables = base_tables(loaded.scenario)
    for index, parameter in enumerate(study.parameters):
        try:
            apply(tables, {parameter.label: parameter.low}, (parameter,))
        except KeyError as error:
            raise FormatError(path, str(error.args[0]), f"parameters[{index + 1}].keys") from error
    return loaded
