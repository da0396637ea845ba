"""Jobs on a Dask cluster that exists already (optional extra "cluster")."""

from __future__ import annotations

import contextlib
import gc
import time
import uuid
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from tdcr_planner.errors import InputError
from tdcr_planner.workers import ALLOWED_LOSSES, Backend, Outcome, WorkersError, describe_error

CONNECT_S = 10.0
# How long a lost connection may take to come back, and how long a cluster may be without any worker.
GONE_S = 15.0
NO_WORKER_S = 120.0
_POLL_S = 0.1
_TLS_ADVICE = (
    "; certificates are Dask's own configuration: distributed.comm.tls.ca-file, .client.cert and .client.key, "
    "or DASK_DISTRIBUTED__COMM__TLS__CA_FILE and so on"
)
_UCX_ADVICE = (
    "; UCX is Dask's own configuration (distributed.comm.ucx) and needs the package of its bindings; try tcp://"
)
_ADVICE = {"tls": _TLS_ADVICE, "wss": _TLS_ADVICE, "ucx": _UCX_ADVICE, "ucxx": _UCX_ADVICE}
_LOOK_S = 2.0


def dask_backend(address: str) -> Backend:
    """Returns a backend that runs jobs on the workers of a Dask scheduler.

    Every worker must have this package, and see the files that the jobs name under the same paths. A job whose worker
    dies goes to another one, as often as the scheduler allows (`distributed.scheduler.allowed-failures`, by default 3);
    its outcome is yielded once, when it has arrived here. Groups and time limits are the scheduler's own affair.

    Args:
        address: Of the scheduler, for example "tcp://127.0.0.1:8786".

    Raises:
        InputError: dask.distributed is not installed.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "--scheduler", "dask.distributed (`pip install 'tdcr-planner[cluster]'`)", "a Python without it"
        ) from error

    def run(
        function: Callable[[Any], Any],
        jobs: Sequence[Any],
        *,
        groups: Sequence[Hashable] | None = None,  # noqa: ARG001
        time_limit_s: float | None = None,  # noqa: ARG001
    ) -> Generator[Outcome, None, None]:
        if not jobs:
            return
        client = _connect(distributed, address)
        try:
            yield from _Cluster(client, address, function, jobs).outcomes()
        finally:
            # A scheduler that is gone cannot be told goodbye.
            with contextlib.suppress(Exception):
                client.close(timeout=1.0)

    return run


def _connect(distributed: Any, address: str) -> Any:
    try:
        return distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except Exception as error:  # each of Dask's transports raises what its own library does
        problem = describe_error(error)
    # The error's frames held the half-made client. Its finaliser waits for a lock that the start of another client
    # holds: left to a collection during that start, both would wait for ever.
    gc.collect()
    advice = _ADVICE.get(address.partition("://")[0].lower(), "")
    raise WorkersError(f"no scheduler answers at {address}: {problem}{advice}")


@dataclass
class _Cluster:
    client: Any
    address: str
    function: Callable[[Any], Any]
    jobs: Sequence[Any]
    now: Callable[[], float] = time.monotonic
    futures: dict[int, Any] = field(default_factory=dict)
    connected: float = 0.0
    had_workers: float = 0.0
    looked: float = 0.0

    def outcomes(self) -> Iterator[Outcome]:
        """Yields outcomes as they come, until all jobs have one or the cluster is gone."""
        self.connected = self.had_workers = self.now()
        for index in range(len(self.jobs)):
            self._submit(index)
        try:
            while self.futures:
                finished = [index for index, future in self.futures.items() if future.status in ("finished", "error")]
                for index in finished:
                    future = self.futures.pop(index)
                    outcome = self._collect(index, future)
                    if outcome is not None:
                        yield outcome
                if not finished:
                    self._look_after()
                    time.sleep(_POLL_S)
        finally:
            with contextlib.suppress(Exception):
                self.client.cancel(list(self.futures.values()), asynchronous=False, force=True)

    def _submit(self, index: int) -> None:
        # A key of its own for each submission: the scheduler must neither merge jobs nor hand out an older result.
        self.futures[index] = self.client.submit(
            self.function,
            self.jobs[index],
            key=f"tdcr-{index}-{uuid.uuid4().hex}",
            pure=False,
            priority=-index,
        )

    def _collect(self, index: int, future: Any) -> Outcome | None:
        """Returns the outcome of a finished future, or None when its result was lost and the job is submitted again."""
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            return Outcome(index, future.result(timeout=GONE_S))
        except (FutureCancelledError, OSError) as error:
            if self.client.status != "running":
                raise WorkersError(self._gone()) from error
            self._submit(index)
            return None
        except KilledWorker:
            return Outcome(index, None, f"{ALLOWED_LOSSES + 1} workers died while they had this job")
        except Exception as error:
            return Outcome(index, None, describe_error(error))

    def _look_after(self) -> None:
        """Submits lost jobs again; ends the run when the scheduler or all its workers are gone."""
        now = self.now()
        if self.client.status == "running":
            self.connected = now
            for index, future in list(self.futures.items()):
                if future.status in ("lost", "cancelled"):
                    self._submit(index)
        elif self.client.status == "closed" or now - self.connected > GONE_S:
            raise WorkersError(self._gone())
        if now - self.looked > _LOOK_S and self.client.status == "running":
            self.looked = now
            if self.client.scheduler_info(n_workers=1)["workers"]:
                self.had_workers = now
            elif now - self.had_workers > NO_WORKER_S:
                raise WorkersError(f"the scheduler at {self.address} has had no worker for {NO_WORKER_S:g} s")

    def _gone(self) -> str:
        return f"the scheduler at {self.address} is gone"
