"""The roadmap: valid configurations and motions of one scene, what they were proven under, and their file."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tdcr_planner.array_schema import ArraySchema, ArraySpec, read_arrays
from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.files import (
    FileModel,
    NotNegative,
    Positive,
    check_file,
    parse_table,
    sha256_of_json,
    write_file_whole,
)
from tdcr_planner.json_text import parse_json
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.planning.scene import differences, scene_facts
from tdcr_planner.shape.base import ShapeModel

ROADMAP_FORMAT = "tdcr-roadmap/1"
REBUILD = "build one with `tdcr roadmap SCENARIO --out FILE`"

_SHOWN_PROBLEMS = 3


@dataclass(frozen=True)
class Conditions:
    """What a roadmap's motions were proven under, or what a query asks for.

    Attributes:
        scene: The scene's facts; see `scene_facts`.
        model: The shape model's name, SHA-256 (None where there is no file) and error bound a disk, m.
        clearance_m: Distance kept from every surface on top of the error bound.
        step_m: No point of the body moves farther between two checked states.
    """

    scene: dict[str, Any]
    model: dict[str, Any]
    clearance_m: float
    step_m: float

    def unfit_for(self, query: Conditions) -> str:
        """Returns why motions proven under these conditions do not serve a query; empty when they do.

        An edge that keeps a clearance keeps every smaller one, whatever the step it was checked at. A finer step is
        asked for all the same, because the bound on what lies between two states holds for models that do not change
        their mind between them, and the first states of an edge stand some steps apart.
        """
        problems = differences(self.scene, query.scene) + differences({"model": self.model}, {"model": query.model})
        if query.clearance_m > self.clearance_m:
            problems.append(f"clearance_m: {self.clearance_m:g}, less than {query.clearance_m:g}")
        if query.step_m < self.step_m:
            problems.append(f"step_m: {self.step_m:g}, more than {query.step_m:g}")
        return "; ".join(problems[:_SHOWN_PROBLEMS])


def conditions_of(scenario: Scenario, model: ShapeModel, facts: dict[str, Any] | None = None) -> Conditions:
    """Returns the conditions that a scenario asks for.

    Args:
        scenario: The scenario.
        model: The shape model that its search asks.
        facts: Its scene's facts, where they are known already.
    """
    return Conditions(
        scene=scene_facts(scenario) if facts is None else facts,
        model={
            "name": model.name,
            "sha256": model.sha256,
            "error_bound_m": np.asarray(model.error_bound).tolist(),
        },
        clearance_m=scenario.planner.clearance_m,
        step_m=scenario.planner.step_m,
    )


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Configurations and the straight motions between them that `EdgeChecker.check_edge` has passed.

    Attributes:
        rows: Vertices, shape (n, dimension).
        edges: Pairs of vertices joined by a proven motion, shape (m, 2).
        motion_scale: What a unit of each coordinate counts in distances, shape (dimension,), m per unit.
        conditions: What the motions were proven under.
        seed: Seed of the build.
        build_s: Time that the build took.
    """

    rows: FloatArray
    edges: IntArray
    motion_scale: FloatArray
    conditions: Conditions
    seed: int
    build_s: float

    @property
    def size(self) -> dict[str, Any]:
        """Number of vertices and edges, by these names."""
        return {"vertices": len(self.rows), "edges": len(self.edges)}

    @cached_property
    def components(self) -> IntArray:
        """Number of the connected part that each vertex belongs to, shape (n,)."""
        from scipy.sparse.csgraph import connected_components

        return np.asarray(connected_components(self.graph, directed=False)[1], dtype=np.int64)

    @property
    def largest_share(self) -> float:
        """Share of the vertices in the largest connected part."""
        return float(np.bincount(self.components).max() / len(self.rows)) if len(self.rows) else 0.0

    def nearest(self, row: FloatArray, count: int) -> IntArray:
        """Returns the vertices nearest to a configuration in body motion, nearest first, `count` at most."""
        count = min(count, len(self.rows))
        if not count:
            return np.empty(0, dtype=np.int64)
        return np.atleast_1d(self._tree.query(row * self.motion_scale, k=count)[1]).astype(np.int64)

    def length(self, row_a: FloatArray, row_b: FloatArray) -> float:
        """Returns the body motion of a straight motion, m."""
        return float(np.linalg.norm((row_b - row_a) * self.motion_scale))

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.rows * self.motion_scale)

    @cached_property
    def graph(self) -> Any:
        """The edges' lengths, m, as a sparse matrix (n, n); each edge in both directions."""
        first, second = self.edges.T
        lengths = np.linalg.norm((self.rows[first] - self.rows[second]) * self.motion_scale, axis=1)
        both = np.concatenate([first, second]), np.concatenate([second, first])
        # A length of 0 would be no edge.
        lengths = np.tile(np.maximum(lengths, 1e-12), 2)
        from scipy.sparse import csr_array

        return csr_array((lengths, both), shape=(len(self.rows), len(self.rows)))

    def save(self, path: str | Path) -> Path:
        """Writes the roadmap as an NPZ file, whole or not at all; returns its path.

        Raises:
            FormatError: The folder cannot be written.
        """
        conditions = self.conditions
        header = {
            "format": ROADMAP_FORMAT,
            "scene": conditions.scene,
            "model": conditions.model,
            "clearance_m": conditions.clearance_m,
            "step_m": conditions.step_m,
            "seed": self.seed,
            "build_s": self.build_s,
        }
        arrays: dict[str, Any] = {
            "rows": self.rows,
            "edges": self.edges.astype(np.int32),
            "motion_scale": self.motion_scale,
        }
        header["sha256"] = _digest(header, arrays)
        target = Path(path)
        with write_file_whole(target) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, header=np.array(json.dumps(header, allow_nan=False)), **arrays)
        return target

    @classmethod
    def load(cls, path: str | Path) -> Roadmap:
        """Returns the roadmap of a file; `check_fit` says whether its motions serve a query.

        Raises:
            FormatError: The file is missing, damaged or no roadmap.
        """
        return _read(Path(path))

    def check_fit(self, query: Conditions, name: str = "roadmap") -> None:
        """Raises InputError unless the motions serve a query; the message names what differs.

        A roadmap made for more clearance or a finer step will do. One made for another scene, robot or shape model,
        for less clearance or a coarser step will not.

        Args:
            query: What the motions must hold under.
            name: What to call the roadmap in the message.
        """
        problem = self.conditions.unfit_for(query)
        if problem:
            raise InputError(name, f"a roadmap that serves the scenario ({REBUILD})", f"one made for {problem}")


class _Model(FileModel):
    """The shape model of a roadmap's file; see `Conditions`."""

    name: str
    sha256: str | None
    error_bound_m: list[NotNegative]


class _Header(FileModel):
    """What a roadmap's file says beside its arrays; sha256 covers both."""

    format: Literal["tdcr-roadmap/1"]
    scene: dict[str, Any]
    model: _Model
    clearance_m: NotNegative
    step_m: Positive
    seed: int
    build_s: NotNegative
    sha256: str


# A build makes some thousand configurations a second; ten million take hours, and 10 GB with their motions.
_SCHEMA = ArraySchema(
    "roadmap",
    {
        "header": ArraySpec("text"),
        "rows": ArraySpec("float64", ("vertices", "dimension")),
        "edges": ArraySpec("integer", ("edges", 2), low=0),
        "motion_scale": ArraySpec("float64", ("dimension",), low=0.0),
    },
    {"vertices": 10_000_000, "edges": 100_000_000, "dimension": 1002, "text": 10_000_000},
)


def _read(path: Path) -> Roadmap:
    """Returns what a file holds, or raises FormatError saying what is wrong with it."""
    check_file(path)
    try:
        arrays, sizes = read_arrays(path, _SCHEMA)
        table = parse_json(str(arrays.pop("header")), path, "header")
        header = parse_table(_Header, table, path)
    except FormatError as error:
        raise FormatError(path, f"{error.problem}; {REBUILD}", error.place) from error
    if header.sha256 != _digest({key: value for key, value in table.items() if key != "sha256"}, arrays):
        raise FormatError(path, f"is damaged: its content is not what was written; {REBUILD}")
    if (arrays["edges"] >= sizes["vertices"]).any():
        raise FormatError(path, f"expected pairs of vertices from 0 to {sizes['vertices'] - 1}; {REBUILD}", "edges")
    conditions = Conditions(header.scene, header.model.model_dump(), header.clearance_m, header.step_m)
    return Roadmap(
        arrays["rows"],
        arrays["edges"].astype(np.int64),
        arrays["motion_scale"],
        conditions,
        header.seed,
        header.build_s,
    )


def _digest(header: dict[str, Any], arrays: dict[str, Any]) -> str:
    digest = hashlib.sha256(sha256_of_json(header).encode())
    for name in sorted(arrays):
        digest.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()
