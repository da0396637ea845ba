from __future__ import annotations

from types import SimpleNamespace

import pytest
from numba.core import event

from tdcr_planner.cli import progress
from tdcr_planner.cli.progress import CompileBar, CountBar, StageBar


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


class FakeFunction:
    """What numba's events carry of a function that is compiled."""

    def __init__(self, name: str) -> None:
        self.py_func = type(name, (), {})


def compile_events(clock: Clock, bar: CompileBar, seconds: list[float]) -> None:
    with bar:
        for number, duration in enumerate(seconds):
            with event.trigger_event("numba:compile", data={"dispatcher": FakeFunction(f"kernel_{number}")}):
                clock.now_s += duration


def test_long_compiling_is_said_in_one_line(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    compile_events(clock, CompileBar(), [1.0, 1.5, 20.0, 20.0])
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(CompileBar.TITLE)


def test_short_or_unwanted_compiling_is_not_said(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    compile_events(clock, CompileBar(), [1.0, 20.0])
    compile_events(clock, CompileBar(shown=False), [20.0, 20.0])
    assert capsys.readouterr().err == ""


def test_a_terminal_shows_the_function_that_is_compiled(
    clock: Clock, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    compile_events(clock, CompileBar(), [3.0, 1.0, 1.0])
    said = capsys.readouterr().err
    assert "kernel_2" in said
    assert "\n" not in said.strip()
