"""The files of compiled code: what happens when they cannot be written, and how long they are kept."""

from __future__ import annotations

import errno
import logging
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tdcr_planner import machine_code
from tdcr_planner.compiled import njit

DAY_S = 86400.0


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder for compiled code, used by this process for the length of a test."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    for told in (machine_code.code_folders, machine_code._prune, machine_code._say_once):
        told.cache_clear()
    yield tmp_path / machine_code.FOLDER
    for told in (machine_code.code_folders, machine_code._prune, machine_code._say_once):
        told.cache_clear()


def kernel(offset: float) -> Any:
    @njit
    def shifted(x):  # type: ignore[no-untyped-def]
        return x + offset

    return shifted


def test_a_full_disk_is_one_warning(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(path: Path, content: bytes) -> int:
        path.touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with caplog.at_level(logging.WARNING):
        assert kernel(1.0)(1.0) == 2.0
        assert kernel(2.0)(1.0) == 3.0
    (record,) = caplog.records
    assert str(folder) in record.message
    assert "No space left" in record.message
    assert not list(folder.iterdir())


def test_files_without_use_are_removed(folder: Path) -> None:
    assert kernel(1.0)(1.0) == 2.0
    (used,) = folder.iterdir()
    old, young = folder / "old.code", folder / "young.code"
    for file, days in ((old, 61.0), (young, 59.0), (used, 59.0)):
        file.touch()
        os.utime(file, (time.time() - days * DAY_S,) * 2)
    # Read again, it counts as used.
    assert kernel(1.0)(1.0) == 2.0
    assert time.time() - used.stat().st_mtime < DAY_S
    machine_code._prune.cache_clear()
    assert kernel(2.0)(1.0) == 3.0
    assert not old.exists()
    assert young.exists()
    assert used.exists()


def test_what_cannot_be_told_apart_is_not_kept(folder: Path) -> None:
    # An object without a text: two that differ would share one file.
    @njit
    def constant(x):  # type: ignore[no-untyped-def]
        return x

    constant.py_func.__defaults__ = (object(),)
    assert constant(1.0) == 1.0
    assert not folder.exists() or not list(folder.iterdir())


def test_another_argument_type_has_another_file(folder: Path) -> None:
    function = kernel(1.0)
    assert function(1.0) == 2.0
    assert function(1) == 2.0
    assert len(list(folder.iterdir())) == 2
