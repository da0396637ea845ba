"""Writing files: links are followed, pipes and devices stay, folders of killed processes are removed."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tdcr_planner import outputs
from tdcr_planner.errors import FormatError
from tdcr_planner.locks import LockState
from tdcr_planner.outputs import (
    STAGING_PREFIX,
    check_file_target,
    check_folder,
    is_private,
    write_file_whole,
    write_folder_whole,
)

WAITS = """
import sys, time
from tdcr_planner.outputs import write_file_whole
with write_file_whole(sys.argv[1]) as temporary:
    temporary.write_text("half")
    print("writing", flush=True)
    time.sleep(60)
"""


def write(path: Path, text: str = "new") -> None:
    with write_file_whole(path) as temporary:
        temporary.write_text(text)


def left_over(folder: Path) -> list[str]:
    return [item.name for item in folder.iterdir() if item.name.startswith(STAGING_PREFIX)]


def test_a_link_is_followed_and_stays(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("elsewhere/real.txt")
    write(tmp_path / "link.txt")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "elsewhere" / "real.txt").read_text(encoding="utf-8") == "new"
    (tmp_path / "later.txt").symlink_to("elsewhere/later.txt")
    write(tmp_path / "later.txt")
    assert (tmp_path / "elsewhere" / "later.txt").read_text(encoding="utf-8") == "new"


def test_a_set_of_files_follows_links_too(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a.csv").symlink_to("../elsewhere/a.csv")
    with write_folder_whole(tmp_path / "out") as staging:
        for name in ("a.csv", "result.json"):
            (staging / name).write_text("new")
    assert (tmp_path / "out" / "a.csv").is_symlink()
    assert (tmp_path / "elsewhere" / "a.csv").read_text(encoding="utf-8") == "new"
    assert left_over(tmp_path / "out") == left_over(tmp_path / "elsewhere") == []


def test_a_folder_in_the_place_of_one_file_keeps_the_whole_set_back(tmp_path: Path) -> None:
    (tmp_path / "result.json").mkdir()
    with pytest.raises(FormatError, match="result.json: is a folder"), write_folder_whole(tmp_path) as staging:
        for name in ("a.csv", "result.json"):
            (staging / name).write_text("new")
    assert [item.name for item in tmp_path.iterdir()] == ["result.json"]
    with pytest.raises(FormatError, match="result.json: is a folder"):
        check_folder(tmp_path, ["a.csv", "result.json"])


def test_a_device_stays_a_device() -> None:
    before = os.stat(os.devnull)
    write(Path(os.devnull))
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)
    assert os.stat(os.devnull).st_ino == before.st_ino


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device without room on this system")
def test_a_device_without_room_is_named() -> None:
    with pytest.raises(FormatError, match="/dev/full: cannot be written: No space left"):
        write(Path("/dev/full"))


def test_a_pipe_is_written_into(tmp_path: Path) -> None:
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_text(encoding="utf-8")))
    reader.start()
    while True:  # until the reader has opened it
        try:
            os.close(os.open(pipe, os.O_WRONLY | os.O_NONBLOCK))
            break
        except OSError:
            time.sleep(0.01)
    reader.join()
    reader = threading.Thread(target=lambda: got.append(pipe.read_text(encoding="utf-8")))
    reader.start()
    text = "x" * 300_000  # more than a pipe takes at once
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        try:
            write(pipe, text)
            break
        except FormatError:
            time.sleep(0.01)
    reader.join()
    assert got[-1] == text
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_pipe_that_nobody_reads_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FormatError, match="pipe: cannot be written: no program reads from it"):
        write(tmp_path / "pipe")


def test_permissions_stay(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_text("old")
    file.chmod(0o640)
    write(file)
    assert stat.S_IMODE(file.stat().st_mode) == 0o640


def make_bad_target(kind: str, folder: Path) -> tuple[Path, str]:
    if kind == "loop":
        (folder / "x").symlink_to(folder / "x")
        return folder / "x", "Too many levels of symbolic links"
    if kind == "below a file":
        (folder / "x").write_text("")
        return folder / "x" / "y", "x is no folder"
    return {
        "folder": (folder, "is a folder, expected a file"),
        "null byte": (folder / "a\0b", "null byte"),
        "another encoding": (folder / os.fsdecode(b"caf\xe9"), "in another encoding"),
        "long name": (folder / ("ä" * 200), "at most 255 bytes, got one of 400"),
        "long name below": (folder / "none" / ("a" * 300) / "b", "at most 255 bytes, got one of 300"),
    }[kind]


@pytest.mark.parametrize(
    "kind", ["folder", "loop", "below a file", "null byte", "another encoding", "long name", "long name below"]
)
def test_what_cannot_be_a_target_is_refused_before_anything_is_made(kind: str, tmp_path: Path) -> None:
    target, problem = make_bad_target(kind, tmp_path)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(FormatError, match=problem):
        check_file_target(target)
    with pytest.raises(FormatError, match=problem):
        write(target)
    if kind not in ("folder", "loop"):
        with pytest.raises(FormatError, match=problem):
            check_folder(target)
    assert sorted(tmp_path.iterdir()) == before


def test_what_a_killed_process_left_is_removed_by_the_next_that_writes_there(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", WAITS, str(tmp_path / "a")], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    write(tmp_path / "b")
    assert len(left_over(tmp_path)) == 1  # its process lives
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert len(left_over(tmp_path)) == 1
    write(tmp_path / "b")
    assert sorted(item.name for item in tmp_path.iterdir()) == ["b"]


def test_many_that_write_into_one_folder_leave_each_other_alone(tmp_path: Path) -> None:
    faults: list[BaseException] = []

    def work(number: int) -> None:
        try:
            for step in range(20):
                write(tmp_path / f"{number}", str(step))
        except BaseException as error:
            faults.append(error)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert faults == []
    assert {item.name: item.read_text(encoding="utf-8") for item in tmp_path.iterdir()} == {
        str(number): "19" for number in range(8)
    }


def test_where_there_are_no_locks_age_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outputs, "try_lock", lambda _: LockState.UNAVAILABLE)
    fresh, old = tmp_path / f"{STAGING_PREFIX}a", tmp_path / f"{STAGING_PREFIX}b"
    for folder in (fresh, old):
        folder.mkdir()
    yesterday = time.time() - outputs.ABANDONED_S - 60.0
    os.utime(old, (yesterday, yesterday))
    write(tmp_path / "c")
    assert left_over(tmp_path) == [fresh.name]


def test_only_folders_of_ones_own_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    (tmp_path / f"{STAGING_PREFIX}link").symlink_to(kept)
    (tmp_path / f"{STAGING_PREFIX}file").write_text("a user's")
    write(tmp_path / "a")
    assert kept.is_dir()
    assert sorted(left_over(tmp_path)) == [f"{STAGING_PREFIX}file", f"{STAGING_PREFIX}link"]
    (tmp_path / f"{STAGING_PREFIX}other").mkdir()
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    outputs._remove_abandoned(tmp_path)
    assert (tmp_path / f"{STAGING_PREFIX}other").is_dir()


def test_a_place_where_others_can_write_is_not_private(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, file = tmp_path / "cache", tmp_path / "cache" / "a"
    folder.mkdir(mode=0o700)
    file.write_text("")
    assert is_private(folder)
    assert is_private(file)
    assert not is_private(folder / "none")
    file.chmod(0o666)
    assert not is_private(file)
    file.chmod(0o600)
    folder.chmod(0o777)
    assert not is_private(folder)
    assert not is_private(file)
    folder.chmod(0o1777)  # as /tmp: others can add files, not exchange this one
    assert not is_private(folder)
    assert is_private(file)
    folder.chmod(0o700)
    owner = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    assert is_private(folder) == (owner == 0)  # the administrator's folders can be trusted
