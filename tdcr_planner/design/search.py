"""The search for a design: Optuna asks, workers measure, and what comes back stays on disk."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tdcr_planner.design.study import Study
from tdcr_planner.design.trial import TrialJob, run_trial
from tdcr_planner.errors import FormatError, MissingLibraryError
from tdcr_planner.workers import Backend, WorkersError

Progress = Callable[[int, int, str], None]

STORAGE = "study.journal"
_NAME = "study"
_SHA = "study_sha256"
_HANG_FACTOR, _HANG_ADDED_S = 5.0, 600.0

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Design:
    """A finished trial.

    Attributes:
        number: Its number.
        values: The design's numbers, by the parameters' labels.
        measures: What it comes to, by measure; empty where it failed.
        reason: Why it failed; empty where it did not.
        folder: Where its robot.toml and scenario.toml are.
    """

    number: int
    values: dict[str, float]
    measures: dict[str, float]
    reason: str
    folder: Path


@dataclass(frozen=True)
class DesignOutcome:
    """What a study has come to.

    Attributes:
        study: The study.
        designs: All finished trials, in order.
        best: Numbers of the trials that no other is better than in every measure, the best by the first measure first.
        importance: Share of each parameter in what the first measure varies by; empty with too few trials.
        resumed: How many trials an earlier run had finished.
        interrupted: Why trials are left; empty when all are finished.
    """

    study: Study
    designs: tuple[Design, ...]
    best: tuple[int, ...]
    importance: dict[str, float]
    resumed: int
    interrupted: str = ""

    @property
    def complete(self) -> bool:
        """Whether as many trials are finished as the study asks for."""
        return len(self.designs) >= self.study.file.trials

    def design(self, number: int) -> Design:
        """Returns a trial by its number."""
        return next(item for item in self.designs if item.number == number)


def run_study(
    study: Study, folder: str | Path, backend: Backend, *, at_once: int = 1, progress: Progress | None = None
) -> DesignOutcome:
    """Runs the trials of a study that its folder has no record of.

    A design that is invalid, crashes or hangs is a failed trial with its reason. Ctrl-C and a lost cluster end the run;
    what had finished by then is in the folder, and the next run goes on from there.

    Args:
        study: The study.
        folder: Output folder, of this study and no other.
        backend: Where trials run: `workers.local_backend` or `cluster.dask_backend`.
        at_once: Trials at a time.
        progress: Told trials done, trials in all, and the last one's outcome.

    Raises:
        FormatError: The folder holds another study, or it cannot be written.
        MissingLibraryError: Optuna is not installed.
    """
    try:
        import optuna
    except ImportError as error:
        raise MissingLibraryError("optuna", "to search for designs", "every system (the extra 'design')") from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    target = Path(folder)
    made = _open(optuna, study, target)
    tell = progress or (lambda *_: None)
    begun = _finished(made)
    done, interrupted = begun, ""
    tell(done, study.file.trials, "")
    try:
        while done < study.file.trials:
            asked = [made.ask() for _ in range(min(at_once, study.file.trials - done))]
            jobs = [_job(study, trial, target) for trial in asked]
            told: set[int] = set()
            limit = _HANG_FACTOR * study.file.search_s * len(study.file.measures) + _HANG_ADDED_S
            with contextlib.closing(backend(run_trial, jobs, time_limit_s=limit)) as outcomes:
                for outcome in outcomes:
                    record: dict[str, Any] = {"reason": outcome.error} if outcome.error else dict(outcome.value)
                    _tell(optuna, made, study, asked[outcome.index], record)
                    told.add(outcome.index)
                    done += 1
                    tell(done, study.file.trials, str(record.get("reason") or _shown(record["values"])))
    except KeyboardInterrupt:
        interrupted = "interrupted"
    except WorkersError as error:
        interrupted = str(error)
    return _outcome(optuna, made, study, target, begun, interrupted)


def _open(optuna: Any, study: Study, folder: Path) -> Any:
    """Returns the Optuna study in a folder, made when missing."""
    folder.mkdir(parents=True, exist_ok=True)
    journal = optuna.storages.journal
    storage = optuna.storages.JournalStorage(journal.JournalFileBackend(str(folder / STORAGE)))
    sampler = optuna.samplers.TPESampler(seed=study.file.seed, multivariate=True, constant_liar=True)
    made = optuna.create_study(
        study_name=_NAME,
        storage=storage,
        sampler=sampler,
        directions=["maximize"] * len(study.file.measures),
        load_if_exists=True,
    )
    known = made.user_attrs.get(_SHA)
    if known not in (None, study.sha256):
        raise FormatError(folder, f"holds another study, or {study.path.name} has changed since; choose another folder")
    made.set_user_attr(_SHA, study.sha256)
    for trial in made.get_trials(deepcopy=False, states=(optuna.trial.TrialState.RUNNING,)):
        # Left by a run that was ended: it is asked anew.
        made.tell(trial.number, state=optuna.trial.TrialState.FAIL)
    return made


def _finished(made: Any) -> int:
    return sum(1 for trial in made.get_trials(deepcopy=False) if "outcome" in trial.user_attrs)


def _job(study: Study, trial: Any, folder: Path) -> TrialJob:
    values: dict[str, float] = {}
    for parameter in study.file.parameters:
        if parameter.whole:
            values[parameter.label] = trial.suggest_int(parameter.label, int(parameter.low), int(parameter.high))
        else:
            values[parameter.label] = trial.suggest_float(
                parameter.label, parameter.low, parameter.high, log=parameter.log
            )
    place = folder.resolve() / "designs" / f"{trial.number + 1:04d}"
    return TrialJob(str(study.path), trial.number + 1, values, str(place))


def _tell(optuna: Any, made: Any, study: Study, trial: Any, record: dict[str, Any]) -> None:
    reason = str(record.get("reason", ""))
    trial.set_user_attr("outcome", {"reason": reason, "measures": record.get("values", {})})
    if reason:
        logger.info("design %d failed: %s", trial.number + 1, reason)
        made.tell(trial, state=optuna.trial.TrialState.FAIL)
    else:
        made.tell(trial, [record["values"][name] for name in study.file.measures])


def _shown(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in values.items())


def _outcome(optuna: Any, made: Any, study: Study, folder: Path, resumed: int, interrupted: str) -> DesignOutcome:
    designs = []
    for trial in made.get_trials(deepcopy=False):
        outcome = trial.user_attrs.get("outcome")
        if outcome is not None:
            designs.append(
                Design(
                    trial.number + 1,
                    dict(trial.params),
                    {} if outcome["reason"] else dict(outcome["measures"]),
                    outcome["reason"],
                    folder / "designs" / f"{trial.number + 1:04d}",
                )
            )
    good = [design for design in designs if design.measures]
    best = [trial.number + 1 for trial in made.best_trials] if good else []
    first = study.file.measures[0]
    by_number = {design.number: design for design in designs}
    best.sort(key=lambda number: -by_number[number].measures[first])
    return DesignOutcome(study, tuple(designs), tuple(best), _importance(optuna, made, good), resumed, interrupted)


def _importance(optuna: Any, made: Any, good: list[Design]) -> dict[str, float]:
    """Returns the share of each parameter in how much the first measure varies, by PED-ANOVA (Watanabe et al. 2023)."""
    if len(good) < 4 or len({tuple(design.measures.values()) for design in good}) < 2:
        return {}
    with warnings.catch_warnings():
        # It reminds of the sign that the target has here already.
        warnings.simplefilter("ignore")
        evaluator = optuna.importance.PedAnovaImportanceEvaluator()
        found = optuna.importance.get_param_importances(
            made, evaluator=evaluator, target=lambda trial: -trial.values[0]
        )
    return {str(name): float(share) for name, share in found.items()}
