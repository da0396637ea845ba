"""Progress of the command line on standard error: bars on a terminal, elsewhere a line now and then for a count."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

from tqdm import tqdm

_COUNTED = "{desc}: {bar} {n_fmt} of {total_fmt}, {elapsed} gone, {remaining} left {postfix}"
_TIMED = "{desc}: {bar} {n:.1f} of {total:.0f} s {postfix}"
# A log of an hour's training stays within what a person reads.
LINE_EVERY_S = 30.0


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


class _Bar:
    """A context manager around one tqdm bar at a time; `update` of those derived from it is a progress callback."""

    def __init__(self, *, shown: bool) -> None:
        self._shown = shown and sys.stderr.isatty()
        self._bar: tqdm[Any] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Takes the bar off the screen."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def _open(self, title: str, total: float, form: str, *, initial: float = 0, delay_s: float = 0.0) -> None:
        self.close()
        self._bar = tqdm(
            total=total,
            desc=title,
            initial=initial,
            disable=not self._shown,
            bar_format=form,
            dynamic_ncols=True,
            leave=False,
            delay=delay_s,
        )

    def _move(self, done: float, remark: str) -> None:
        assert self._bar is not None  # opened before it is moved
        self._bar.set_postfix_str(remark, refresh=False)
        self._bar.update(done - self._bar.n)


class _Counter(_Bar):
    """A bar of steps done out of a total; where nothing can be drawn, a line at a stage's start and now and then."""

    def __init__(self, *, shown: bool) -> None:
        super().__init__(shown=shown)
        self._lines = shown and not self._shown
        self._stage = ""
        self._began_s = self._last_line_s = 0.0

    def _count(self, stage: str, done: int, total: int, remark: str) -> None:
        begins = self._bar is None or stage != self._stage
        if begins:
            self._stage = stage
            self._began_s = time.perf_counter()
            self._open(stage, total, _COUNTED, initial=done)
        self._move(done, remark)
        if self._lines and (begins or time.perf_counter() - self._last_line_s >= LINE_EVERY_S):
            self._last_line_s = time.perf_counter()
            gone = tqdm.format_interval(self._last_line_s - self._began_s)
            parts = [f"{done} of {total}", *([] if begins else [f"{gone} gone"]), *([remark] if remark else [])]
            print(f"{stage}: {', '.join(parts)}", file=sys.stderr, flush=True)


class CountBar(_Counter):
    """A bar of things done out of a total, with an estimate of the time left."""

    def __init__(self, title: str, *, shown: bool = True) -> None:
        """Prepares a bar.

        Args:
            title: What is being done.
            shown: False draws and prints nothing.
        """
        super().__init__(shown=shown)
        self._title = title

    def update(self, done: int, total: int, remark: str) -> None:
        """Moves the bar and shows a remark. The first call says what an earlier run has done: no part of the pace."""
        self._count(self._title, done, total, remark)


class StageBar(_Counter):
    """A count bar for work in stages: each begins another bar, with the time left in that stage."""

    def __init__(self, *, shown: bool = True) -> None:
        """Prepares the bar; it draws and prints nothing when `shown` is false."""
        super().__init__(shown=shown)

    def update(self, stage: str, done: int, total: int, remark: str) -> None:
        """Moves the bar: `done` of `total` steps of a stage. What a stage begins with is no part of its pace."""
        self._count(stage, done, total, remark)


class TimeBar(_Bar):
    """A bar that fills as a time limit is used up, with a remark of what is going on."""

    def __init__(self, title: str, limit_s: float, *, shown: bool = True) -> None:
        """Prepares a bar.

        Args:
            title: What is being done.
            limit_s: The time at which the bar is full, s.
            shown: False draws nothing.
        """
        super().__init__(shown=shown)
        self._limit = limit_s
        self._started = time.perf_counter()
        self._open(title, limit_s, _TIMED, delay_s=0.5)

    def update(self, share: float, remark: str) -> None:  # noqa: ARG002
        """Moves the bar to the time used so far and shows a remark.

        Args:
            share: Part of its own time that a search has used; the bar shows the query's time, repairs included.
            remark: What is going on.
        """
        self._move(min(time.perf_counter() - self._started, self._limit), remark)
