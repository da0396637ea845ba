"""Progress bars of the command line."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from tqdm import tqdm


@contextmanager
def remark_if_slow(remark: str, after_s: float = 8.0) -> Iterator[None]:
    """Prints a remark to standard error when what is done inside takes longer than usual.

    Args:
        remark: What the reason may be.
        after_s: How long to wait before saying so, s.
    """
    timer = threading.Timer(after_s, lambda: print(remark, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


class TimeBar:
    """A bar that fills as a time limit is used up, with a remark of what is going on.

    Use it as a context manager and pass `update` as the progress callback.
    """

    def __init__(self, title: str, limit_s: float, *, shown: bool = True) -> None:
        """Prepares a bar.

        Args:
            title: What is being done.
            limit_s: The time at which the bar is full, s.
            shown: False draws nothing; neither does a standard error that is no terminal.
        """
        self._limit = limit_s
        self._started = time.perf_counter()
        self._bar = tqdm(
            total=limit_s,
            desc=title,
            disable=not (shown and sys.stderr.isatty()),
            bar_format="{desc}: {bar} {n:.1f} of {total:.0f} s {postfix}",
            leave=False,
            delay=0.5,
        )

    def __enter__(self) -> TimeBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def update(self, share: float, remark: str) -> None:  # noqa: ARG002
        """Moves the bar to the time used so far and shows a remark.

        Args:
            share: Part of its own time that a search has used; the bar shows the query's time, repairs included.
            remark: What is going on.
        """
        used = min(time.perf_counter() - self._started, self._limit)
        self._bar.set_postfix_str(remark, refresh=False)
        self._bar.update(used - self._bar.n)
