"""The comparison of a scenario: sampled states and planned paths, judged by models and reference."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.compare.confusion import Confusion, count_verdicts
from tdcr_planner.compare.paths import PlannedPath, plan_path
from tdcr_planner.compare.timing import CheckTime, measure_times
from tdcr_planner.compare.verdicts import (
    MODELS,
    REFERENCE_VERDICTS,
    Variant,
    Verdicts,
    join_verdicts,
    judge,
    sample_configurations,
)
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.planning.causes import CAUSES
from tdcr_planner.planning.scenario import Scenario, Validity
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.shape.reference import ReferenceShape
from tdcr_planner.shape.registry import SHAPE_MODELS
from tdcr_planner.workers import ALLOWED_LOSSES, Outcome, WorkersError, run_jobs

# Fixed, so that the batches, and with them the last digits of the network's answers, do not depend on the workers.
BATCH = 1000
WORST_OF_A_KIND = 2
_TIMED_STATES = 1000

Progress = Callable[[int, int, str], None]
Kind = Literal["false_valid", "false_invalid"]


@dataclass(frozen=True)
class Disagreement:
    """A state on which a variant and the reference disagree.

    Attributes:
        variant: Name of the variant.
        kind: "false_valid" or "false_invalid".
        state: Its index among the sampled states.
        cause: Why it is invalid for the one that rejects it: a cause of `planning.validity` for the variant, one of
            REFERENCE_VERDICTS for the reference.
        row: The configuration, shape (dimension,).
        clearance: Under the reference, m.
        deviation: Of the model from the reference, m.
        positions: Disk centres by the reference, shape (d, 3), m, world frame.
        rotations: world_from_disk by the reference, shape (d, 3, 3).
        model_positions: Disk centres by the model, shape (d, 3), m, world frame.
        model_rotations: world_from_disk by the model, shape (d, 3, 3).
    """

    variant: str
    kind: Kind
    state: int
    cause: str
    row: FloatArray
    clearance: float
    deviation: float
    positions: FloatArray
    rotations: FloatArray
    model_positions: FloatArray
    model_rotations: FloatArray


@dataclass(frozen=True)
class Comparison:
    """What a comparison has found.

    Attributes:
        scenario: The scenario.
        seed: Seed of the states.
        drawn: Draws it took; those that are not among the states break a tension limit.
        verdicts: The states and what was said of them.
        error_bound: The first model's bound, shape (d,), m.
        times: Time a verdict.
        paths: Planned paths.
        disagreements: The worst wrong verdicts with their shapes.
        hashes: SHA-256 of scenario, robot mechanics and shape model.
        seconds: Wall time: load, states, times, paths.
    """

    scenario: Scenario
    seed: int
    drawn: int
    verdicts: Verdicts
    error_bound: FloatArray
    times: tuple[CheckTime, ...]
    paths: tuple[PlannedPath, ...]
    disagreements: tuple[Disagreement, ...]
    hashes: dict[str, str]
    seconds: dict[str, float] = field(default_factory=dict)

    def confusion(self, variant: Variant) -> Confusion:
        """Returns a variant's confusion matrix."""
        return count_verdicts(self.verdicts.valid(variant), self.verdicts.reference_valid)


def compare(
    scenario: Scenario,
    *,
    models: Sequence[Validity] | None = None,
    samples: int = 10_000,
    paths: int = 5,
    seed: int = 1,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Comparison:
    """Compares shape models with the Cosserat reference in a scenario.

    Args:
        scenario: The scenario; it names a shape model where a model needs one.
        models: The shape models by name; None for the learned one, constant curvature and the one that the scenario
            names.
        samples: Number of states.
        paths: Queries to plan with each shape model, with seeds 1, 2, ...; 0 for none.
        seed: Seed of the states.
        jobs: Worker processes. The verdicts do not depend on it.
        progress: Called with the number of completed steps, of all steps, and a message.

    Returns:
        The comparison.

    Raises:
        InputError: A number is out of its range.
        FormatError: The scenario names no shape model.
        WorkersError: A part failed in each process that had it.
    """
    for name, value, least in (("samples", samples, 1), ("paths", paths, 0), ("seed", seed, 0), ("jobs", jobs, 1)):
        if value < least:
            raise InputError(name, f"{least} or more", value)
    compared = _compared(scenario, models)
    tell = progress or (lambda *_: None)
    begin = time.perf_counter()
    session = PlanningSession(scenario.with_planner(validity=compared[0]))
    rows, drawn = sample_configurations(session.space, samples, seed)
    batches = [rows[start : start + BATCH] for start in range(0, samples, BATCH)]
    queries = [(model, number) for model in compared for number in range(1, paths + 1)]
    tasks: list[_Task] = [_Task(session.scenario, compared, rows=batch) for batch in batches]
    tasks += [_Task(session.scenario, compared, query=query) for query in queries]
    loaded = time.perf_counter()
    tell(0, len(tasks), "")
    times = measure_times(session, rows[:_TIMED_STATES], compared)
    timed = time.perf_counter()
    answers: dict[int, Any] = {}
    for outcome in _run(session, tasks, jobs):
        if outcome.error:
            raise WorkersError(f"a part of the comparison failed: {outcome.error}")
        answers[outcome.index] = outcome.value
        task = tasks[outcome.index]
        tell(len(answers), len(tasks), "states" if task.query is None else f"paths, {task.query[0]}")
    verdicts = join_verdicts([answers[index] for index in range(len(batches))])
    judged = time.perf_counter()
    return Comparison(
        scenario=session.scenario,
        seed=seed,
        drawn=drawn,
        verdicts=verdicts,
        error_bound=session.model(compared[0]).error_bound,
        times=times,
        paths=tuple(answers[index] for index in range(len(batches), len(tasks))),
        disagreements=tuple(_worst_disagreements(session, verdicts)),
        hashes={name: text for name, text in session.hashes(session.scenario).items() if name != "geometry"},
        seconds={"load": loaded - begin, "times": timed - loaded, "states_and_paths": judged - timed},
    )


def _compared(scenario: Scenario, models: Sequence[Validity] | None) -> tuple[Validity, ...]:
    """Returns what to compare: the models named, or the usual ones and the scenario's; the reference is the measure."""
    given = models or (*MODELS, scenario.planner.validity)
    names = tuple(name for name in dict.fromkeys(given) if name != ReferenceShape.name)
    if not names:
        raise InputError("models", "shape models beside the reference, which they are compared with", "none")
    for name in names:
        if SHAPE_MODELS.find(name).needs_file and scenario.shape_model_path is None:
            raise FormatError(
                scenario.path, f"missing: there is nothing to compare without a {name} model", "shape_model"
            )
    return names


@dataclass(frozen=True)
class _Task:
    """A batch of states to judge, or a query to plan."""

    scenario: Scenario
    models: tuple[Validity, ...]
    rows: FloatArray | None = None
    query: tuple[Validity, int] | None = None

    def run(self, session: PlanningSession) -> Verdicts | PlannedPath:
        if self.query is not None:
            return plan_path(session, *self.query)
        assert self.rows is not None  # a task without a query has rows
        return judge(session, self.rows, self.models)


_sessions: dict[tuple[str, str], PlanningSession] = {}


def _run_task(task: _Task) -> Verdicts | PlannedPath:
    """Runs a task in a worker process, which keeps its session."""
    key = (str(task.scenario.path), task.scenario.sha256)
    if key not in _sessions:
        _sessions[key] = PlanningSession(task.scenario)
    return task.run(_sessions[key])


def _run(session: PlanningSession, tasks: Sequence[_Task], jobs: int) -> Iterator[Outcome]:
    if jobs > 1:
        yield from run_jobs(_run_task, tasks, workers=jobs, losses=ALLOWED_LOSSES)
        return
    for index, task in enumerate(tasks):
        yield Outcome(index, task.run(session))


def _worst_disagreements(session: PlanningSession, verdicts: Verdicts) -> Iterator[Disagreement]:
    """Yields the false-valid states of least clearance and the false-invalid ones of most, model by model."""
    for place_of_variant, variant in enumerate(verdicts.variants):
        if variant.name != variant.model:
            continue
        valid, truth = verdicts.valid(variant), verdicts.reference_valid
        deviation = verdicts.deviation_of(variant.model)
        drawable = np.isfinite(deviation) & np.isfinite(verdicts.clearance)
        kinds: tuple[tuple[Kind, Any, float], ...] = (
            ("false_valid", valid & ~truth, 1.0),
            ("false_invalid", ~valid & truth, -1.0),
        )
        for kind, wrong, sign in kinds:
            states = np.flatnonzero(wrong & drawable)
            states = states[np.argsort(sign * verdicts.clearance[states], kind="stable")][:WORST_OF_A_KIND]
            if not len(states):
                continue
            rows = verdicts.rows[states]
            reference = session.verifier().judge_each(rows)[1]
            positions, rotations, _ = session.checker(
                session.scenario.with_planner(validity=variant.model)
            ).world_poses(rows)
            for place, state in enumerate(states.tolist()):
                yield Disagreement(
                    variant=variant.name,
                    kind=kind,
                    state=state,
                    cause=_cause(verdicts, state, place_of_variant),
                    row=rows[place],
                    clearance=float(verdicts.clearance[state]),
                    deviation=float(deviation[state]),
                    positions=reference.positions[place],
                    rotations=reference.rotations[place],
                    model_positions=positions[place],
                    model_rotations=rotations[place],
                )


def _cause(verdicts: Verdicts, state: int, variant: int) -> str:
    code = int(verdicts.codes[state, variant])
    return CAUSES[code - 1].value if code else REFERENCE_VERDICTS[int(verdicts.reference[state])]
