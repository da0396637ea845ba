"""Interrupts: ending signals and errors while a compiled library calls back, kept until the library has returned."""

from __future__ import annotations

import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

# What a user, a system or a closed terminal ends a program with; SIGHUP is not on every system.
ENDING_SIGNALS = tuple(
    signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if name in signal.Signals.__members__
)


@contextmanager
def interrupts_kept(keep: Callable[[BaseException], None]) -> Iterator[None]:
    """Passes what SIGINT, SIGTERM or SIGHUP raises to `keep` instead of raising it, while the block runs.

    Python raises KeyboardInterrupt at the next instruction that it runs. When the signal comes while a compiled
    library is at work, that is the first one of the library's next callback, before any `try` in it, and the exception
    would pass through code that knows nothing of exceptions. The caller raises what it was given after the block.
    Outside of the main thread, and for a signal that has no Python handler, nothing is changed.

    Args:
        keep: Takes what the handler that was there before has raised.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    found = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    before = {number: handler for number, handler in found.items() if callable(handler)}

    def handle(number: int, frame: FrameType | None) -> None:
        try:
            before[signal.Signals(number)](number, frame)
        except BaseException as error:
            # Its frames lead to the interrupted ones, and those hold what the library frees.
            keep(error.with_traceback(None))

    for number in before:
        signal.signal(number, handle)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def forget_frames(error: BaseException) -> None:
    """Lets go of what the frames of an error's traceback and the finished ones that called them hold.

    An error raised in a callback is kept by whoever catches it, its frames with it, and the frames hold Python's
    handles of objects that the library has freed by then. The binding finds such a handle again when the library
    allocates at the same place, and what it leads to is not that object. The lines of the traceback stay.
    """
    step = error.__traceback__
    traceback.clear_frames(step)
    frame = None if step is None else step.tb_frame.f_back
    while frame is not None:
        try:
            frame.clear()
        except RuntimeError:
            # A frame that still runs; so do all that called it.
            break
        frame = frame.f_back
