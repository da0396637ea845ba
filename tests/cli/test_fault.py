"""What no check has foreseen: one sentence, a file with the traceback, exit code 70."""

from __future__ import annotations

import errno
import re
import tempfile
from pathlib import Path

import pytest

from tdcr_planner.cli.commands import COMMANDS
from tdcr_planner.cli.fault import is_memory_fault
from tdcr_planner.cli.main import run
from tdcr_planner.errors import FormatError


@pytest.fixture
def raising(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Returns a function that lets `tdcr info` raise an exception and returns exit code and folder of fault files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def let(error: BaseException) -> int:
        def fail(file: str) -> int:
            raise error

        monkeypatch.setitem(COMMANDS, "info", fail)
        return run(["info", "--file", "a\udcff.toml"])

    return let


def test_a_fault_is_one_sentence_that_names_the_file_of_its_traceback(raising, capsys, tmp_path: Path) -> None:
    assert raising(KeyError("gone")) == 70
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("fault of the program (KeyError), not of your input")
    found = re.search(r"\S+tdcr-fault-\S+\.txt", line)
    assert found is not None
    text = Path(found.group()).read_text(encoding="utf-8")
    assert "KeyError: 'gone'" in text
    assert "Traceback" in text
    assert "tdcr-planner " in text
    assert r"a\udcff.toml" in text


def test_a_fault_without_a_place_for_its_file_is_printed(raising, capsys, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    assert raising(KeyError("gone")) == 70
    assert "KeyError: 'gone'" in capsys.readouterr().err


def test_errors_of_the_user_stay_what_they_are(raising, capsys) -> None:
    assert raising(FormatError("a.toml", "is wrong")) == 2
    assert capsys.readouterr().err == "error: a.toml: is wrong\n"
    assert raising(KeyboardInterrupt()) == 1


MEMORY_ERRORS = [
    MemoryError(),
    OSError(errno.ENOMEM, "Cannot allocate memory"),
    RuntimeError("[enforce fail at alloc_cpu.cpp:127] DefaultCPUAllocator: can't allocate memory: you tried ..."),
    ImportError("libtorch_cpu.so: failed to map segment from shared object"),
    RuntimeError("can't start new thread"),
]


@pytest.mark.parametrize("error", MEMORY_ERRORS)
def test_memory_that_runs_out_has_a_sentence_of_its_own(raising, capsys, tmp_path: Path, error: Exception) -> None:
    assert raising(error) == 1
    assert "ulimit -v" in capsys.readouterr().err
    assert not list(tmp_path.glob("tdcr-fault-*"))


def test_other_errors_are_no_memory_faults() -> None:
    for error in (RuntimeError("no"), OSError(errno.ENOENT, "no"), ImportError("no module"), KeyError("memory")):
        assert not is_memory_fault(error)


def test_memory_that_ran_out_below_an_error_counts() -> None:
    error = ValueError("no array")
    error.__cause__ = MemoryError()
    assert is_memory_fault(error)
