"""Signals to the command line: SIGINT, SIGTERM and SIGHUP end a command in the same way, at whatever it is doing."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

# This module is imported before anything heavy, so it does not take them from `planning.interrupts`.
_ENDING = tuple(signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if name in signal.Signals.__members__)
# How soon an interrupt is raised again that was raised where Python cannot pass it on.
_AGAIN_S = 0.05


class _State:
    number: int | None = None


def was_interrupted() -> bool:
    """Whether one of the signals has come: an error raised since then may be what a library made of it."""
    return _State.number is not None


@contextmanager
def ending_signals() -> Iterator[None]:
    """Raises KeyboardInterrupt for each of the signals while the block runs; after it they end the process at once.

    A signal that is ignored, as under `nohup`, stays ignored.
    """
    _State.number = None
    numbers = [number for number in _ENDING if signal.getsignal(number) is not signal.SIG_IGN]
    hook, sys.unraisablehook = sys.unraisablehook, _raise_again
    for number in numbers:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        # Python's own end would answer a signal with a traceback.
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)
        sys.unraisablehook = hook


def _interrupt(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    _State.number = number
    raise KeyboardInterrupt


def _raise_again(unraisable: UnraisableHookArgs) -> None:
    """Raises an interrupt again that hit a finaliser or a callback, where Python would print and forget it."""
    number = _State.number
    if issubclass(unraisable.exc_type, KeyboardInterrupt) and number is not None:
        # From another thread: raised in this one, it would hit this function. A true signal also ends a sleep.
        timer = threading.Timer(_AGAIN_S, lambda: os.kill(os.getpid(), number))
        timer.daemon = True
        timer.start()
    else:
        sys.__unraisablehook__(unraisable)
