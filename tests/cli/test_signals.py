"""Every ending signal, at any moment of a command: one line, exit code 1, and no traceback."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tdcr_planner.cli.signals import ending_signals, was_interrupted

NUMBERS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]

# A command in place of `info`, told on its output when it is at work, run by the entry point of a process of its own.
PROGRAM = """
import signal, sys, time
{before}
from tdcr_planner.cli import commands
from tdcr_planner.cli.main import main

class Finalised:
    def __del__(self):
        signal.raise_signal(signal.{number})

def work() -> int:
    '''Stand in for a command.'''
{body}
    return 0

commands.COMMANDS["info"] = work
sys.argv = ["tdcr", "info"]
main()
"""
RAISED = "    signal.raise_signal(signal.{number})"
BODIES = {
    "in the command": RAISED,
    "turned into an error by a library": f"    try:\n    {RAISED}\n    except BaseException:\n"
    "        raise SystemError('returned a result with an exception set')",
    "in a finaliser": "    Finalised()\n    time.sleep(60)",
    "again while the first is answered": f"    try:\n    {RAISED}\n    finally:\n    {RAISED}",
}


@pytest.fixture(autouse=True)
def handlers_stay() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in NUMBERS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def run_program(number: str, body: str, before: str = "") -> subprocess.CompletedProcess[str]:
    code = PROGRAM.format(number=number, body=body.format(number=number), before=before)
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize(
    ("number", "body"),
    [(number, "in the command") for number in ("SIGINT", "SIGTERM", "SIGHUP")]
    + [("SIGINT", body) for body in list(BODIES)[1:]],
)
def test_a_signal_is_one_line_and_exit_code_1(number: str, body: str) -> None:
    # In the background of a script SIGINT is ignored, and under nohup SIGHUP; this test may run there.
    heard = "signal.signal(signal.SIGINT, signal.default_int_handler)\nsignal.signal(signal.SIGHUP, signal.SIG_DFL)"
    done = run_program(number, BODIES[body], heard)
    (line,) = done.stderr.splitlines()
    assert line == "interrupted: no file is left half-written, and what was finished before is kept"
    assert done.returncode == 1


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    done = run_program("SIGHUP", BODIES["in the command"], "signal.signal(signal.SIGHUP, signal.SIG_IGN)")
    assert (done.returncode, done.stderr) == (0, "")


def test_an_error_without_a_signal_is_no_interrupt() -> None:
    done = run_program("SIGINT", "    raise SystemError('a fault')")
    assert "interrupted" not in done.stderr
    assert done.returncode != 0


@pytest.mark.parametrize("number", NUMBERS)
def test_signals_raise_inside_and_end_the_process_afterwards(number: signal.Signals) -> None:
    signal.signal(number, signal.default_int_handler)
    with ending_signals():
        assert not was_interrupted()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        assert was_interrupted()
    assert signal.getsignal(number) is signal.SIG_DFL
