"""Progress of the command line on standard error: bars on a terminal, elsewhere a line now and then for a count."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any, Self

from tqdm import tqdm

_COUNTED = "{desc}: {bar} {n_fmt} of {total_fmt}, {elapsed} gone, {remaining} left {postfix}"
_OPEN_ENDED = "{desc}: {elapsed} gone {postfix}"
_TIMED = "{desc}: {bar} {n:.1f} of {total:.0f} s {postfix}"
# A log of an hour's training stays within what a person reads.
LINE_EVERY_S = 30.0
# What compiles in less needs no remark.
_COMPILES_LONG_S = 2.0


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


class CompileBar(_Bar):
    """Says what is compiled inside of it, where that takes long: a bar on a terminal, else one line."""

    TITLE = "compiling the numeric code, once on this machine"

    def __init__(self, *, shown: bool = True) -> None:
        """Prepares the bar; nothing is drawn when `shown` is false, or when nothing is compiled."""
        super().__init__(shown=shown)
        self._lines = shown and not self._shown
        self._depth = 0
        self._began_s: float | None = None
        self._listener: Any = None

    def __enter__(self) -> Self:
        """Begins to listen."""
        # Imports numba, which only commands that compute need.
        from numba.core import event

        class Listener(event.Listener):
            """Hands numba's events on; compiling one function begins with compiling those that it calls."""

            def on_start(listener, event: Any) -> None:  # noqa: N805
                self._begin(event.data["dispatcher"].py_func.__name__)

            def on_end(listener, event: Any) -> None:  # noqa: N805, ARG002
                self._depth -= 1

        self._listener = Listener()
        event.register("numba:compile", self._listener)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends listening and takes the bar off the screen."""
        from numba.core import event

        event.unregister("numba:compile", self._listener)
        super().__exit__(kind, error, trace)

    def _begin(self, name: str) -> None:
        self._depth += 1
        now = time.perf_counter()
        if self._began_s is None:
            self._began_s = now
        if now - self._began_s < _COMPILES_LONG_S:
            return
        if self._lines:
            self._lines = False
            print(f"{self.TITLE}: half a minute or so", file=sys.stderr, flush=True)
        if self._bar is None:
            self._open(self.TITLE, 1.0, _OPEN_ENDED)
        assert self._bar is not None  # just opened
        if self._depth == 1:
            self._bar.set_postfix_str(name)
