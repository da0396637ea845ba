import json
import os
import resource
from contextlib import contextmanager

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.locks import LockState
from tdcr_planner.sweep.journal import JOURNAL_NAME, open_journal
from tdcr_planner.sweep.suite import load_suite

RECORD = {"status": "verified", "result": {}, "timing": {}}


def test_records_come_back(suite, tmp_path):
    with open_journal(tmp_path / "out", suite) as journal:
        journal.add(4, RECORD)
        journal.add(1, {**RECORD, "status": "no_path"})
    with open_journal(tmp_path / "out", suite) as journal:
        assert journal.records == {4: RECORD, 1: {**RECORD, "status": "no_path"}}


def test_every_prefix_of_the_file_is_a_journal(suite, tmp_path):
    with open_journal(tmp_path / "out", suite) as journal:
        for index in range(3):
            journal.add(index, RECORD)
    path = tmp_path / "out" / JOURNAL_NAME
    whole = path.read_bytes()
    ends = [place for place, byte in enumerate(whole, start=1) if byte == ord("\n")]
    for length in range(len(whole) + 1):
        path.write_bytes(whole[:length])
        with open_journal(tmp_path / "out", suite) as journal:
            complete = sum(end <= length for end in ends)
            assert sorted(journal.records) == list(range(max(complete - 1, 0)))
            journal.add(5, RECORD)
        header, *entries = [json.loads(line) for line in path.read_bytes().splitlines()]
        assert header["suite_sha256"] == suite.sha256
        assert entries[-1]["job"] == 5


@contextmanager
def no_file_beyond(size):
    """Lets no file of this process grow beyond a size, as a full disk would."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_ends_the_run_and_keeps_what_was_recorded(suite, tmp_path):
    path = tmp_path / "out" / JOURNAL_NAME
    with (
        pytest.raises(FormatError, match="cannot be written: File too large"),
        open_journal(tmp_path / "out", suite) as journal,
    ):
        journal.add(0, RECORD)
        with no_file_beyond(path.stat().st_size + 10):
            journal.add(1, RECORD)
    assert not path.read_bytes().endswith(b"\n")
    with open_journal(tmp_path / "out", suite) as journal:
        assert journal.records == {0: RECORD}
        journal.add(2, RECORD)
    assert [json.loads(line).get("job") for line in path.read_bytes().splitlines()] == [None, 0, 2]


def test_refuses_the_folder_of_another_suite(suite, write_suite, tmp_path):
    with open_journal(tmp_path / "out", suite) as journal:
        journal.add(0, RECORD)
    before = (tmp_path / "out" / JOURNAL_NAME).read_bytes()
    other = load_suite(write_suite(seeds="[7]"))
    with pytest.raises(FormatError, match="another sweep"), open_journal(tmp_path / "out", other):
        pass
    assert (tmp_path / "out" / JOURNAL_NAME).read_bytes() == before


def test_refuses_a_folder_in_use(suite, tmp_path):
    with (
        open_journal(tmp_path / "out", suite),
        pytest.raises(FormatError, match="at this moment"),
        open_journal(tmp_path / "out", suite),
    ):
        pass


def test_a_file_system_without_locks_is_a_warning_and_no_other_sweep(suite, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("tdcr_planner.sweep.journal.try_lock", lambda _: LockState.UNAVAILABLE)
    with open_journal(tmp_path / "out", suite) as journal:
        journal.add(0, RECORD)
    assert "has no file locks; start no second sweep" in caplog.text
    with open_journal(tmp_path / "out", suite) as journal:
        assert journal.records == {0: RECORD}


def test_a_pipe_in_the_place_of_the_journal_is_refused(suite, tmp_path):
    os.mkfifo(tmp_path / JOURNAL_NAME)
    with pytest.raises(FormatError, match="is a pipe, expected a file"), open_journal(tmp_path, suite):
        pass


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("{broken\n", ["line 2", "not valid JSON"]),
        ("[1]\n", ["line 2", "JSON object", "list"]),
        ('{"job": 99, "status": "failed", "result": {}, "timing": {}}\n', ["line 2", "0 to 5", "99"]),
        ('{"status": "verified", "result": {}, "timing": {}}\n', ["line 2, job", "missing"]),
        ('{"job": 1, "status": "good", "result": {}, "timing": {}}\n', ["line 2, status", "'verified'", "'good'"]),
        ('{"job": 1, "status": "failed", "result": {}, "timing": {"plan_s": "1"}}\n', ["plan_s", "valid number"]),
    ],
)
def test_names_a_damaged_line(suite, tmp_path, line, words):
    with open_journal(tmp_path / "out", suite):
        pass
    with (tmp_path / "out" / JOURNAL_NAME).open("a") as stream:
        stream.write(line)
    with pytest.raises(FormatError) as caught, open_journal(tmp_path / "out", suite):
        pass
    for word in words:
        assert word in str(caught.value)


def test_refuses_an_older_format(suite, tmp_path):
    (tmp_path / JOURNAL_NAME).write_text('{"format": "tdcr-sweep/0"}\n')
    with pytest.raises(FormatError, match="tdcr-sweep/1"), open_journal(tmp_path, suite):
        pass


def test_refuses_a_folder_that_cannot_be_made(suite, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="cannot be written"), open_journal(tmp_path / "file" / "out", suite):
        pass
