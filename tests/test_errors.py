from __future__ import annotations

import pytest

from tdcr_planner.errors import (
    DomainError,
    FormatError,
    InputError,
    RobotMismatchError,
    TdcrError,
    UnknownNameError,
    nearest_name,
)


def test_nearest_name_suggests_the_misspelt_key() -> None:
    assert nearest_name("PRM", ["prm", "FMT"]) == "did you mean 'prm'? valid: FMT, prm"
    assert nearest_name("lenght_m", ["length_m", "disks"]) == "did you mean 'length_m'? valid: disks, length_m"


def test_nearest_name_lists_all_when_nothing_is_near() -> None:
    assert nearest_name("zzz", ["b", "a"]) == "valid: a, b"


@pytest.mark.parametrize("kind", [InputError, FormatError, RobotMismatchError, DomainError])
def test_every_error_is_a_tdcr_error(kind: type[Exception]) -> None:
    assert issubclass(kind, TdcrError)


def test_an_unknown_name_reads_as_a_sentence() -> None:
    error = UnknownNameError("planner.name", "rrtstar", ["RRTstar", "RRT"])
    assert str(error) == "planner.name: got 'rrtstar'; did you mean 'RRTstar'? valid: RRT, RRTstar"
    assert isinstance(error, InputError)
    assert str(UnknownNameError("unit", "xy", ["m"], " (?)")) == "unit: got 'xy' (?); valid: m"


def test_messages_carry_place_expected_and_got() -> None:
    assert (
        str(InputError("tensions", "shape (n, 3)", "shape (4,)")) == "tensions: expected shape (n, 3), got shape (4,)"
    )
    assert str(FormatError("a.toml", "unknown key", "segments[1].x")) == "a.toml: segments[1].x: unknown key"
    assert "tdcr train" in str(RobotMismatchError("paper 12ab", "mine 34cd", "model.pt"))
