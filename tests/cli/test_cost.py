from __future__ import annotations

from pathlib import Path

import pytest

from tdcr_planner.cli import cost
from tdcr_planner.cli.cost import describe_duration, tell_cost, training_cost
from tdcr_planner.errors import InputError
from tdcr_planner.learning.settings import TrainSettings, load_train_settings
from tdcr_planner.robot import RobotSpec


def test_what_takes_minutes_is_not_told(capsys: pytest.CaptureFixture[str]) -> None:
    tell_cost("--samples", 60.0, 1e8)
    assert capsys.readouterr().err == ""


def test_what_takes_hours_is_told_with_time_and_memory(capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    monkeypatch.setattr(cost, "available_memory", lambda: 1e11)
    tell_cost("--samples", 4.0 * 3600.0, 3e9)
    assert capsys.readouterr().err == ("--samples: this takes about 4 hours and 3.0 GB of memory; Ctrl-C ends it\n")


def test_what_does_not_fit_into_memory_is_refused(monkeypatch) -> None:
    monkeypatch.setattr(cost, "available_memory", lambda: 4e9)
    with pytest.raises(InputError, match=r"--samples: expected .* 4 GB of which are free, got .* 50 GB"):
        tell_cost("--samples", 1.0, 5e10)


@pytest.mark.parametrize(
    ("seconds", "words"), [(1.0, "1 minutes"), (1800.0, "30 minutes"), (7200.0, "2 hours"), (200_000.0, "2 days")]
)
def test_durations_are_for_people(seconds: float, words: str) -> None:
    assert describe_duration(seconds) == words


def test_cost_of_a_training_grows_with_cases_and_epochs(root: Path, inspection_robot: RobotSpec) -> None:
    shipped = load_train_settings(root / "models/shape/inspection/train.toml")
    seconds, memory = training_cost(inspection_robot, shipped)
    # Measured: 65 to 128 s of processor time; the estimate is good to a factor of a few.
    assert 30.0 < seconds < 400.0
    assert memory < 4e9
    longer = TrainSettings.model_validate(
        {"optimiser": {"epochs": 100_000}, "dataset": {"cases": 10_000_000}, "bound": {"cases": 10_000_000}}
    )
    more_seconds, more_memory = training_cost(inspection_robot, longer)
    assert more_seconds > 1000.0 * seconds
    assert more_memory > 50.0 * memory
