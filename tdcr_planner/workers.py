"""Jobs in processes of their own: one job at a time each, and none that fails, hangs or crashes ends the others."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol

from tdcr_planner.errors import InputError, WorkersError

__all__ = [
    "ALLOWED_LOSSES",
    "Backend",
    "Outcome",
    "WorkersError",
    "describe_error",
    "local_backend",
    "run_jobs",
    "usable_cpus",
]

# Workers that a job may lose, to a crash or to somebody's kill, before it counts as failed, where it is given again.
ALLOWED_LOSSES = 3

# One thread a process: workers share the machine among each other, and results do not depend on its core count.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
_POLL_S = 0.5
_END_S = 5.0


@dataclass(frozen=True)
class Outcome:
    """How one job ended.

    Attributes:
        index: Its place in the list of jobs.
        value: What the function returned; None when it failed.
        error: Why it failed; empty when it did not.
        lost: Whether it failed because its worker died or was ended.
    """

    index: int
    value: Any = None
    error: str = ""
    lost: bool = False


class Backend(Protocol):
    """Where jobs run: processes of this machine (`local_backend`) or a cluster (`cluster.dask_backend`)."""

    def __call__(
        self,
        function: Callable[[Any], Any],
        jobs: Sequence[Any],
        *,
        groups: Sequence[Hashable] | None = None,
        time_limit_s: float | None = None,
    ) -> Generator[Outcome, None, None]:
        """Yields the outcome of each job, by its place in `jobs`, as it comes; each once. Closing ends what is left.

        Args:
            function: Importable by name where the workers are; called with one job.
            jobs: What to call it with. Jobs and values can be pickled.
            groups: A key a job; jobs of one group share what a worker may keep. Not every backend makes use of it.
            time_limit_s: Time after which a job counts as hanging. Not every backend can end one.

        Raises:
            WorkersError: The workers are gone.
        """
        ...


def local_backend(workers: int, *, losses: int = 0) -> Backend:
    """Returns a backend of worker processes on this machine.

    Args:
        workers: Number of processes.
        losses: How often a job whose worker died is given to another one; 0 for jobs that may be what killed it.
    """

    def run(
        function: Callable[[Any], Any],
        jobs: Sequence[Any],
        *,
        groups: Sequence[Hashable] | None = None,
        time_limit_s: float | None = None,
    ) -> Generator[Outcome, None, None]:
        return run_jobs(function, jobs, groups=groups, workers=workers, time_limit_s=time_limit_s, losses=losses)

    return run


def usable_cpus() -> int:
    """Returns how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def describe_error(error: BaseException) -> str:
    """Returns an exception as one line: its type and message."""
    return f"{type(error).__name__}: {error}".replace("\n", " ")


def run_jobs(
    function: Callable[[Any], Any],
    jobs: Sequence[Any],
    *,
    groups: Sequence[Hashable] | None = None,
    workers: int = 1,
    time_limit_s: float | None = None,
    losses: int = 0,
) -> Generator[Outcome, None, None]:
    """Runs jobs in worker processes and yields each outcome as it comes.

    Workers are started afresh (not forked), each with one thread for numerical libraries. A worker that dies or
    exceeds the time limit is replaced; its job fails, or is given to another worker, and no other job is concerned.
    Closing the iterator ends the workers.

    Args:
        function: Importable by name; called with one job, returns something that can be pickled.
        jobs: What to call it with, each picklable.
        groups: A key a job. A worker prefers jobs of the group it had last, so that it can keep what they share.
        workers: Number of processes.
        time_limit_s: Time for one job; None for none.
        losses: How often a job whose worker died or was ended is given to another one before it fails.

    Raises:
        InputError: Fewer than one worker.
    """
    if workers < 1:
        raise InputError("workers", "1 or more", workers)
    queue = _Queue(list(groups) if groups is not None else [0] * len(jobs))
    lost: Counter[int] = Counter()

    def settled(outcome: Outcome) -> Iterator[Outcome]:
        """Yields the outcome, unless its job goes to another worker."""
        lost[outcome.index] += outcome.lost
        if outcome.lost and lost[outcome.index] <= losses:
            queue.put_back(outcome.index)
        else:
            yield outcome

    lanes = [_Lane(function, time_limit_s) for _ in range(min(workers, len(jobs)))]
    try:
        while True:
            for lane in lanes:
                if not lane.busy:
                    lane.take(queue, jobs)
            busy = {lane.connection: lane for lane in lanes if lane.busy}
            if not busy:
                return
            for ready in wait(list(busy), timeout=_POLL_S):
                assert isinstance(ready, Connection)  # only connections were waited for
                yield from settled(busy[ready].collect())
            for lane in lanes:
                if lane.overdue:
                    yield from settled(lane.give_up())
    finally:
        for lane in lanes:
            lane.end()


class _Queue:
    """Jobs still to be done, by group."""

    def __init__(self, groups: list[Hashable]) -> None:
        self._groups = groups
        self._waiting: dict[Hashable, deque[int]] = {}
        for index, group in enumerate(groups):
            self._waiting.setdefault(group, deque()).append(index)
        self._claimed: set[Hashable] = set()

    def next(self, last: Hashable | None) -> tuple[int, Hashable] | None:
        """Returns a job of the last group, else of a group that no one has begun, else of the longest; or None."""
        open_groups = {group: waiting for group, waiting in self._waiting.items() if waiting}
        if not open_groups:
            return None
        untouched = (group for group in open_groups if group not in self._claimed)
        longest = max(open_groups, key=lambda group: len(open_groups[group]))
        group = last if last in open_groups else next(untouched, longest)
        self._claimed.add(group)
        return open_groups[group].popleft(), group

    def put_back(self, index: int) -> None:
        """Takes a job back, to be given out before the others of its group."""
        self._waiting[self._groups[index]].appendleft(index)


class _Lane:
    """One worker process and the job that it has."""

    def __init__(self, function: Callable[[Any], Any], time_limit_s: float | None) -> None:
        self._function = function
        self._limit = time_limit_s
        self._process: BaseProcess | None = None
        self._connection: Connection | None = None
        self._job: int | None = None
        self._group: Hashable | None = None
        self._begun = 0.0

    @property
    def busy(self) -> bool:
        return self._job is not None

    @property
    def overdue(self) -> bool:
        return self.busy and self._limit is not None and time.monotonic() - self._begun > self._limit

    @property
    def connection(self) -> Connection:
        assert self._connection is not None  # a busy lane has a worker
        return self._connection

    def take(self, queue: _Queue, jobs: Sequence[Any]) -> None:
        """Takes the next job from the queue, if there is one, and gives it to the worker."""
        found = queue.next(self._group)
        if found is None:
            return
        if self._process is None:
            self._start()
        self._job, self._group = found
        self._begun = time.monotonic()
        # A worker that has died since its last job is noticed when its answer is waited for.
        with contextlib.suppress(OSError):
            self.connection.send(jobs[self._job])

    def collect(self) -> Outcome:
        """Returns the outcome of the job whose answer, or whose worker's end, has come."""
        index = self._job
        assert index is not None  # called for a busy lane
        try:
            value, error = self.connection.recv()
        except (EOFError, OSError):
            return self._abandon(f"the process {self._describe_end()}")
        self._job = None
        return Outcome(index, value, error)

    def give_up(self) -> Outcome:
        """Ends the worker of a job that takes too long."""
        return self._abandon(f"no answer within {self._limit:g} s; its process was ended")

    def end(self) -> None:
        """Ends the worker, in the middle of a job too."""
        if self._process is None:
            return
        self.connection.close()
        if self.busy:
            self._process.terminate()
        self._process.join(_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()
        self._process, self._connection, self._job = None, None, None

    def _abandon(self, error: str) -> Outcome:
        index = self._job
        assert index is not None  # called for a busy lane
        self.end()
        return Outcome(index, None, error, lost=True)

    def _describe_end(self) -> str:
        assert self._process is not None  # called for a busy lane
        self._process.join(_END_S)
        code = self._process.exitcode
        if code is None:
            return "closed its connection"
        if code < 0:
            return f"was ended by signal {-code} ({signal.Signals(-code).name})"
        return f"ended with exit code {code}"

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._function), daemon=True)
        with _environment(_ONE_THREAD), _interrupt_ignored():
            self._process.start()
        theirs.close()


def _serve(connection: Connection, function: Callable[[Any], Any]) -> None:
    """What a worker process does: jobs in, values or errors out, until the connection ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            job = connection.recv()
        except (EOFError, OSError):
            return
        try:
            answer = function(job), ""
        except BaseException as error:
            answer = None, describe_error(error)
        try:
            connection.send(answer)
        except BrokenPipeError:
            return
        except Exception as error:
            connection.send((None, f"the result cannot be sent: {describe_error(error)}"))


def _end_with_parent() -> None:
    """Ends this process, in the middle of a job too, when the one that started it has ended in whatever way."""
    parent = multiprocessing.parent_process()
    assert parent is not None  # called in a worker
    parent.join()
    os._exit(1)


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _interrupt_ignored() -> Iterator[None]:
    """A process started inside ignores Ctrl-C from its first instruction on: ending it is the parent's affair."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
