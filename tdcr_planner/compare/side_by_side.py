"""Several model files in one scenario: error, margin, time, wrong verdicts both ways and planning, a row a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tdcr_planner.compare.confusion import count_verdicts
from tdcr_planner.compare.paths import plan_path
from tdcr_planner.compare.timing import measure_times
from tdcr_planner.compare.verdicts import Verdicts, judge, sample_configurations
from tdcr_planner.errors import InputError
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.query.result import PlanStatus
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.rates import Rate, binomial_rate
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape
from tdcr_planner.shape.learned import LearnedShape
from tdcr_planner.shape.reference import ReferenceShape

_TIMED_STATES = 1000
_MOST_MODELS = 20

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class ModelRow:
    """One model among several.

    Attributes:
        name: Its file's name, or that of a model without a file.
        file: Its file; None without one.
        error_m: Median and 99th percentile of the largest distance of a disk centre from the reference's, m.
        margin_m: Median over the states of the bound at the tip that planning keeps, m.
        shape_us: For the disk poses in the world frame, with all that planning asks of them, us a state.
        check_us: For a whole verdict, us a state.
        false_valid: States that the reference rejects, called valid.
        false_invalid: States that the reference accepts, called invalid.
        verified: Queries that ended with a verified path.
        plan_s: Median time of the searches; None without queries.
    """

    name: str
    file: Path | None
    error_m: tuple[float, float]
    margin_m: float
    shape_us: float
    check_us: float
    false_valid: Rate
    false_invalid: Rate
    verified: Rate
    plan_s: float | None


@dataclass(frozen=True)
class SideBySide:
    """Several models in one scenario.

    Attributes:
        scenario: The scenario.
        states: How many states were judged.
        rows: A row a model, files first, then constant curvature and the reference.
    """

    scenario: Scenario
    states: int
    rows: tuple[ModelRow, ...]


def compare_files(
    scenario: Scenario,
    files: Sequence[Path],
    *,
    samples: int = 10_000,
    paths: int = 5,
    seed: int = 1,
    progress: Progress | None = None,
) -> SideBySide:
    """Compares model files with each other, with constant curvature and with the reference.

    Args:
        scenario: The scenario, whose own shape model takes no part unless it is among the files.
        files: The model files.
        samples: Number of states, the same for all models.
        paths: Queries to plan with each model, with seeds 1, 2, ...; 0 for none.
        seed: Seed of the states.
        progress: Told models done, models in all, and which one is next.

    Raises:
        TdcrError: A file cannot be used in this scenario; names it.
    """
    if not 1 <= len(files) <= _MOST_MODELS:
        raise InputError("models", f"1 to {_MOST_MODELS} files", len(files))
    tell = progress or (lambda *_: None)
    total = len(files) + 2
    rows: list[ModelRow] = []
    for number, file in enumerate(files):
        tell(number, total, file.name)
        changed = scenario.file.model_copy(update={"shape_model": str(file.resolve())})
        session = PlanningSession(replace(scenario, file=changed).with_planner(validity=LearnedShape.name))
        rows.append(_judge_model(session, LearnedShape.name, file.name, file, samples, paths, seed))
    for place, name in enumerate((ConstantCurvatureShape.name, ReferenceShape.name), start=len(files)):
        tell(place, total, name)
        rows.append(_judge_model(session, name, name.replace("_", " "), None, samples, paths, seed))
    tell(total, total, "")
    return SideBySide(scenario, samples, tuple(rows))


def _judge_model(
    session: PlanningSession, model: str, name: str, file: Path | None, samples: int, paths: int, seed: int
) -> ModelRow:
    configurations, _ = sample_configurations(session.space, samples, seed)
    verdicts: Verdicts = judge(session, configurations, (model,))
    confusion = count_verdicts(verdicts.valid(verdicts.variants[0]), verdicts.reference_valid)
    deviation = verdicts.deviation_of(model)
    known = deviation[np.isfinite(deviation)]
    times = {time.model: time for time in measure_times(session, configurations[:_TIMED_STATES], (model,))}
    actuation = session.space.actuate(configurations)
    bounds = session.model(model).error_bound_at(actuation.tensions, actuation.gravity, actuation.tip_force)
    planned = [plan_path(session, model, number) for number in range(1, paths + 1)]
    verified = sum(path.status == PlanStatus.VERIFIED for path in planned)
    quantiles = np.quantile(known, [0.5, 0.99]) if len(known) else np.full(2, np.nan)
    return ModelRow(
        name=name,
        file=file,
        error_m=(float(quantiles[0]), float(quantiles[1])),
        margin_m=float(np.median(bounds[..., -1])),
        shape_us=times[model].shape_us,
        check_us=times[model].check_us,
        false_valid=confusion.rates["false_valid"],
        false_invalid=confusion.rates["false_invalid"],
        verified=binomial_rate(verified, paths),
        plan_s=float(np.median([path.plan_s for path in planned])) if planned else None,
    )
