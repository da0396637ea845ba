"""A progress bar that counts: jobs or states done, with the time left."""

from __future__ import annotations

import sys
from types import TracebackType

from tqdm import tqdm


class CountBar:
    """A bar of things done out of a total, with an estimate of the time left.

    Use it as a context manager and pass `update` as the progress callback.
    """

    def __init__(self, title: str, total: int, *, shown: bool = True) -> None:
        """Prepares a bar.

        Args:
            title: What is being done.
            total: How many things there are.
            shown: False draws nothing; neither does a standard error that is no terminal.
        """
        self._bar = tqdm(
            total=total,
            desc=title,
            disable=not (shown and sys.stderr.isatty()),
            bar_format="{desc}: {bar} {n_fmt} of {total_fmt}, {elapsed} gone, {remaining} left {postfix}",
            dynamic_ncols=True,
            leave=False,
        )
        self._known = False

    def __enter__(self) -> CountBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def update(self, done: int, total: int, remark: str) -> None:
        """Moves the bar and shows a remark. The first call says what an earlier run has done: no part of the pace."""
        if not self._known:
            self._known = True
            self._bar.total = total
            self._bar.initial = done
            self._bar.n = done
            self._bar.refresh()
            return
        self._bar.set_postfix_str(remark, refresh=False)
        self._bar.update(done - self._bar.n)
