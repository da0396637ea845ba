from __future__ import annotations

import errno
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.files import (
    FileModel,
    check_folder,
    parse_table,
    read_json,
    read_text,
    read_toml,
    sha256_of_file,
    sha256_of_json,
    write_file_whole,
    write_folder_whole,
)


class Inner(FileModel):
    radius_m: float


class Outer(FileModel):
    name: str
    parts: tuple[Inner, ...] = ()
    inner: Inner | None = None


def test_unknown_key_names_place_and_nearest_key() -> None:
    content = {"name": "a", "parts": [{"radius_m": 1.0}, {"radius_m": 1.0, "raduis_m": 2.0}]}
    with pytest.raises(FormatError, match=r"a\.toml: parts\[2\]\.raduis_m: unknown key; did you mean 'radius_m'\?"):
        parse_table(Outer, content, "a.toml")


def test_unknown_key_in_an_optional_table_lists_its_own_keys() -> None:
    with pytest.raises(FormatError, match=r"inner\.size: unknown key; valid: radius_m$"):
        parse_table(Outer, {"name": "a", "inner": {"radius_m": 1.0, "size": 1}}, "a.toml")


def test_all_faults_are_reported_at_once() -> None:
    with pytest.raises(FormatError) as caught:
        parse_table(Outer, {"parts": [{"radius_m": "wide"}]}, "a.toml")
    message = str(caught.value)
    assert "name: missing" in message
    assert "parts[1].radius_m: input should be a valid number" in message
    assert "got 'wide'" in message


def test_not_a_number_is_refused() -> None:
    with pytest.raises(FormatError, match="inner.radius_m: input should be a finite number"):
        parse_table(Outer, {"name": "a", "inner": {"radius_m": float("nan")}}, "a.toml")


@pytest.mark.parametrize("reader", [read_text, read_toml, read_json, sha256_of_file])
def test_missing_file_and_folder_are_named(reader: object, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"none\.toml"):
        reader(tmp_path / "none.toml")  # type: ignore[operator]
    with pytest.raises(FormatError):
        reader(tmp_path)  # type: ignore[operator]


def test_broken_toml_and_json_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_text("x = = 1")
    with pytest.raises(FormatError, match="not valid TOML"):
        read_toml(file)
    with pytest.raises(FormatError, match="not valid JSON"):
        read_json(file)
    file.write_text("[1]")
    with pytest.raises(FormatError, match="expected a JSON object, got list"):
        read_json(file)
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="not a text file"):
        read_toml(file)


def test_hashes(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"abc")
    assert sha256_of_file(file) == hashlib.sha256(b"abc").hexdigest()
    assert sha256_of_json({"a": 1, "b": [2.5]}) == sha256_of_json({"b": [2.5], "a": 1})
    assert sha256_of_json({"a": 1}) != sha256_of_json({"a": 2})


def test_write_file_whole_replaces_only_on_success(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "a.txt"
    with write_file_whole(target) as temporary:
        temporary.write_text("first")
    assert target.read_text(encoding="utf-8") == "first"
    with pytest.raises(KeyboardInterrupt), write_file_whole(target) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert target.read_text(encoding="utf-8") == "first"
    assert [item.name for item in target.parent.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("write", [write_file_whole, write_folder_whole])
def test_a_full_disk_is_named_and_changes_nothing(write: Callable[..., Any], tmp_path: Path) -> None:
    target = tmp_path / "out"
    if write is write_file_whole:
        target.write_text("old")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(FormatError, match=r"out: cannot be written: No space left"), write(target) as staging:
        (staging if write is write_file_whole else staging / "a.txt").write_text("new")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert [path for path in sorted(tmp_path.iterdir()) if path in before or path.is_file()] == before
    assert not list(tmp_path.rglob("a.txt"))
    assert not target.is_file() or target.read_text(encoding="utf-8") == "old"
    with pytest.raises(PermissionError), write(target):
        raise PermissionError("another fault passes as it is")


def test_write_folder_whole_keeps_the_old_set_on_failure(tmp_path: Path) -> None:
    with write_folder_whole(tmp_path) as staging:
        (staging / "result.json").write_text("1")
        (staging / "a.csv").write_text("1")
    with pytest.raises(RuntimeError), write_folder_whole(tmp_path) as staging:
        (staging / "a.csv").write_text("2")
        raise RuntimeError
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.csv", "result.json"]
    assert (tmp_path / "a.csv").read_text(encoding="utf-8") == "1"


def test_unwritable_folder_is_refused(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("")
    with pytest.raises(FormatError, match="cannot be written"), write_folder_whole(blocker / "out"):
        pass


def test_a_folder_that_can_be_made_is_not_made_yet(tmp_path: Path) -> None:
    check_folder(tmp_path)
    check_folder(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_behind_a_file_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(FormatError, match="file is no folder"):
            check_folder(folder)


def test_a_folder_without_permission_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The superuser may write anywhere, so what the system would say to others is put in its place.
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(FormatError, match="no permission in"):
        check_folder(tmp_path / "below")


@pytest.mark.parametrize(
    "text", ["a = " + "9" * 5000, "a = " + "[" * 100_000, "a = 1\na = 2", "a = nul", 'a = "\\ud800"']
)
def test_toml_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(FormatError, match="a.toml: is not valid TOML"):
        read_toml(path)
