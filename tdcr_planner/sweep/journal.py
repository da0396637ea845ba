"""The journal: one file to which each finished job is appended, so that a sweep can be killed and go on."""

from __future__ import annotations

import contextlib
import json
import logging
import os
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from tdcr_planner.errors import FormatError
from tdcr_planner.files import (
    Count,
    FileModel,
    Model,
    NotNegative,
    check_file,
    check_file_target,
    parse_table,
)
from tdcr_planner.json_text import parse_json
from tdcr_planner.locks import LockState, try_lock
from tdcr_planner.sweep.suite import Suite

JOURNAL_NAME = "jobs.jsonl"
JOURNAL_FORMAT = "tdcr-sweep/1"
logger = logging.getLogger(__name__)


class _Header(FileModel):
    """The first line: whose records follow."""

    format: Literal["tdcr-sweep/1"]
    suite_sha256: str
    jobs: Annotated[int, Field(ge=1)]


class _Result(FileModel):
    """What the seed decides; nothing of it for a query that was not verified."""

    repairs: Count | None = None
    states: Count | None = None
    tip_travel_m: NotNegative | None = None
    duration_s: NotNegative | None = None
    clearance_m: float | None = None
    deviation_m: NotNegative | None = None
    residual_nm: NotNegative | None = None
    path_sha256: str | None = None


class _Timing(FileModel):
    """What the clock decides too; a query that failed has a message alone."""

    plan_s: NotNegative | None = None
    verify_s: NotNegative | None = None
    total_s: NotNegative | None = None
    iterations: Count | None = None
    vertices: Count | None = None
    states_checked: Count | None = None
    edges_checked: Count | None = None
    rejected: dict[str, Count] = {}
    repairs_tried: Count | None = None
    last_clearance_m: float | None = None
    last_deviation_m: NotNegative | None = None
    message: str = ""
    worker: str = ""


class _Record(FileModel):
    """A line of a finished job."""

    job: Count
    status: Literal["verified", "unverified", "no_path", "invalid_start", "invalid_goal", "failed"]
    result: _Result
    timing: _Timing


class Journal:
    """Records of finished jobs, on disk as soon as they are added.

    Attributes:
        path: The file: a header line, then a line a job.
        records: The record of each finished job by its index.
    """

    def __init__(self, path: Path, stream: FileIO, records: dict[int, dict[str, Any]]) -> None:
        """Use `open_journal`."""
        self.path = path
        self.records = records
        self._stream = stream

    def add(self, index: int, record: dict[str, Any]) -> None:
        """Appends the record of a job; it is on disk when this returns.

        Raises:
            FormatError: The file cannot be written.
        """
        self._append({"job": index, **record})
        self.records[index] = record

    def _append(self, content: dict[str, Any]) -> None:
        line = json.dumps(content, allow_nan=False).encode() + b"\n"
        try:
            while line:
                line = line[self._stream.write(line) :]
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise FormatError(self.path, f"cannot be written: {error.strerror}") from error


@contextlib.contextmanager
def open_journal(folder: str | Path, suite: Suite) -> Iterator[Journal]:
    """Opens the journal of a sweep in its output folder, with the records of earlier runs.

    A last line that was cut short when an earlier run was killed is dropped. While it is open, no other process can
    open it; where the file system has no locks, a warning says so.

    Args:
        folder: The output folder, made when it is missing.
        suite: The suite whose jobs it records.

    Raises:
        FormatError: The folder cannot be written, holds another sweep, or is in use by a running one.
    """
    path = Path(folder) / JOURNAL_NAME
    check_file_target(path)
    if os.path.exists(path):
        check_file(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Without a buffer: what a full disk refuses is not kept back, to be refused again when the file is closed.
        stream = path.open("a+b", buffering=0)
    except OSError as error:
        raise FormatError(path.parent, f"cannot be written: {error.strerror}") from error
    with stream:
        state = try_lock(stream.fileno())
        if state is LockState.IN_USE:
            raise FormatError(path, "another sweep is writing into this folder at this moment")
        if state is LockState.UNAVAILABLE:
            logger.warning("%s: its file system has no file locks; start no second sweep into this folder", path)
        lines = _complete_lines(stream)
        journal = Journal(path, stream, _read_records(path, lines, suite))
        if not lines:
            journal._append({"format": JOURNAL_FORMAT, "suite_sha256": suite.sha256, "jobs": len(suite.jobs)})
        yield journal


def _complete_lines(stream: FileIO) -> list[bytes]:
    """Returns the lines that end in a line break, and cuts off what stands after them."""
    stream.seek(0)
    content = stream.read()
    complete = content[: content.rfind(b"\n") + 1]
    if len(complete) < len(content):
        stream.truncate(len(complete))
    return complete.splitlines()


def _read_records(path: Path, lines: list[bytes], suite: Suite) -> dict[int, dict[str, Any]]:
    if not lines:
        return {}
    header = _parse(_Header, path, 1, lines[0])
    if header.suite_sha256 != suite.sha256:
        raise FormatError(
            path,
            f"the folder holds another sweep than {suite.path.name}: another suite, or its scenarios, models or meshes "
            "have changed since; choose another folder, or delete this one to start anew",
        )
    records = {}
    for number, line in enumerate(lines[1:], start=2):
        record = _parse(_Record, path, number, line)
        if record.job >= len(suite.jobs):
            raise FormatError(
                path, f"expected a job from 0 to {len(suite.jobs) - 1}, got {record.job}", f"line {number}"
            )
        records[record.job] = record.model_dump(exclude={"job"}, exclude_unset=True)
    return records


def _parse(model: type[Model], path: Path, number: int, line: bytes) -> Model:
    try:
        return parse_table(model, parse_json(line, path), path)
    except FormatError as error:
        place = f"line {number}, {error.place}" if error.place else f"line {number}"
        raise FormatError(path, f"is damaged: {error.problem}", place) from error
