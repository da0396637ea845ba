from __future__ import annotations

import errno
import fcntl
from pathlib import Path

import pytest

from tdcr_planner import locks
from tdcr_planner.locks import LockState, try_lock


def test_a_lock_is_held_until_its_file_is_closed(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_text("")
    with file.open("rb") as mine:
        assert try_lock(mine.fileno()) is LockState.HELD
        with file.open("rb") as other:
            assert try_lock(other.fileno()) is LockState.IN_USE
    with file.open("rb") as other:
        assert try_lock(other.fileno()) is LockState.HELD


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL, errno.EBADF])
def test_a_file_system_without_locks_is_told_apart(code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(code, "no locks")

    monkeypatch.setattr(fcntl, "flock", refuse)
    assert try_lock(0) is LockState.UNAVAILABLE


def test_a_system_without_locks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "HAS_LOCKS", False)
    assert try_lock(0) is LockState.UNAVAILABLE
