from __future__ import annotations

from types import SimpleNamespace

import pytest

from tdcr_planner.cli import progress
from tdcr_planner.cli.progress import CountBar, StageBar


class Clock:
    """A clock that stands still until it is set."""

    now_s = 0.0

    def perf_counter(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=clock.perf_counter))
    return clock


def test_without_a_terminal_stages_are_lines_half_a_minute_apart(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with StageBar() as bar:
        for second in range(0, 100, 10):
            clock.now_s = float(second)
            bar.update("cases", second, 100, "")
        bar.update("training", 3, 9, "loss 0.5")
        bar.update("training", 4, 9, "loss 0.4")
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines() == [
        "cases: 0 of 100",
        "cases: 30 of 100, 00:30 gone",
        "cases: 60 of 100, 01:00 gone",
        "cases: 90 of 100, 01:30 gone",
        "training: 3 of 9, loss 0.5",
    ]


def test_a_count_has_lines_too(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with CountBar("sweep") as bar:
        bar.update(5, 20, "")
        clock.now_s = 61.0
        bar.update(6, 20, "1 failed")
    assert capsys.readouterr().err.splitlines() == ["sweep: 5 of 20", "sweep: 6 of 20, 01:01 gone, 1 failed"]


def test_progress_that_is_not_wanted_prints_nothing(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with StageBar(shown=False) as bar:
        bar.update("cases", 0, 100, "")
        clock.now_s = 100.0
        bar.update("cases", 1, 100, "")
    assert capsys.readouterr().err == ""


def test_a_terminal_has_a_bar_and_no_lines(
    clock: Clock, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with CountBar("sweep") as bar:
        bar.update(5, 20, "")
        clock.now_s = 61.0
        bar.update(6, 20, "")
    assert "\n" not in capsys.readouterr().err.strip()
