"""Opening files: whatever stands at a name is read or refused in one line, and nothing keeps the program waiting."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tdcr_planner import inputs
from tdcr_planner.errors import FormatError
from tdcr_planner.files import read_json, read_toml, sha256_of_file
from tdcr_planner.inputs import check_file, find_named_file, open_file, read_bytes, read_text, real_path
from tdcr_planner.planning.roadmap import Roadmap
from tdcr_planner.shape.learned import load_shape_model

TEXT = 'title = "Gerät für 5 °"\r\n'


def at_pipe(folder: Path) -> Path:
    os.mkfifo(folder / "x")
    return folder / "x"


def at_socket(folder: Path) -> Path:
    server = socket.socket(socket.AF_UNIX)
    before = Path.cwd()
    os.chdir(folder)  # the name of a socket may have a hundred bytes only
    server.bind("x")
    os.chdir(before)
    server.close()
    return folder / "x"


def at_loop(folder: Path) -> Path:
    (folder / "x").symlink_to(folder / "y")
    (folder / "y").symlink_to(folder / "x")
    return folder / "x"


def at_dangling_link(folder: Path) -> Path:
    (folder / "x").symlink_to(folder / "gone")
    return folder / "x"


def below_a_file(folder: Path) -> Path:
    (folder / "x").write_text("")
    return folder / "x" / "y"


PLACES: dict[str, tuple[Callable[[Path], Path], str]] = {
    "missing": (lambda folder: folder / "x", "no such file"),
    "folder": (lambda folder: folder, "is a folder, expected a file"),
    "pipe": (at_pipe, "is a pipe, expected a file"),
    "socket": (at_socket, "is a socket, expected a file"),
    "device": (lambda _: Path("/dev/zero"), "is a device, expected a file"),
    "loop": (at_loop, "cannot be read: Too many levels of symbolic links"),
    "dangling link": (at_dangling_link, "is a link to a file that does not exist"),
    "below a file": (below_a_file, "cannot be read: Not a directory"),
    "long name": (lambda folder: folder / ("ä" * 200), "cannot be read: File name too long"),
    "long path": (lambda folder: folder.joinpath(*(["a" * 200] * 30)), "cannot be read: File name too long"),
    "null byte": (lambda folder: folder / "a\0b", "got one with a null byte"),
    "another encoding": (lambda folder: folder / os.fsdecode(b"caf\xe9"), "got one in another encoding; rename it"),
}
READERS = (check_file, read_bytes, read_text, read_toml, read_json, sha256_of_file, Roadmap.load, load_shape_model)


@pytest.mark.parametrize("place", PLACES)
def test_every_reader_names_what_is_there(place: str, tmp_path: Path) -> None:
    make, problem = PLACES[place]
    path = make(tmp_path)
    for reader in READERS:
        with pytest.raises(FormatError) as caught:
            reader(path)
        assert caught.value.problem.endswith(problem)
        assert caught.value.path == path


@pytest.mark.parametrize("place", PLACES)
def test_a_named_file_is_refused_where_it_is_named(place: str, tmp_path: Path) -> None:
    make, problem = PLACES[place]
    with pytest.raises(FormatError) as caught:
        find_named_file(make(tmp_path), "scenario.toml", "robot", "; look elsewhere")
    assert str(caught.value).startswith("scenario.toml: robot: ")
    assert problem in str(caught.value)
    assert str(caught.value).endswith("; look elsewhere")


def test_links_are_followed(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("content")
    (tmp_path / "link").symlink_to("real")
    assert read_text(tmp_path / "link") == "content"
    assert find_named_file(tmp_path / "link", "a.toml", "robot") == (tmp_path / "real").resolve()
    assert real_path(at_loop(tmp_path)).name in ("x", "y")


def test_what_fails_while_a_file_is_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")
    with pytest.raises(FormatError, match="a: cannot be read: Input/output error"), open_file(tmp_path / "a"):
        raise OSError(5, "Input/output error")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_utf8_is_read_with_and_without_a_byte_order_mark(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(TEXT.encode(encoding))
    assert read_text(tmp_path / "a.toml") == TEXT.replace("\r\n", "\n")
    assert read_toml(tmp_path / "a.toml") == {"title": "Gerät für 5 °"}


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252"])
def test_another_encoding_is_named(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(TEXT.encode(encoding))
    name = "Latin-1 or Windows-1252" if encoding in ("latin-1", "cp1252") else encoding.upper()[:6]
    with pytest.raises(FormatError, match=f"{name}.*; save it as UTF-8$"):
        read_text(tmp_path / "a.toml")


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"\x89PNG\r\n\x1a\n\x00\x00", b"a = 1\0\n", b"\x80\x02}q\x00"])
def test_what_is_not_text_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(content)
    with pytest.raises(FormatError, match="is not a text file"):
        read_text(tmp_path / "a.toml")


@given(content=st.binary(max_size=200))
def test_any_bytes_are_text_without_nulls_or_refused(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "any.bin"
    file.write_bytes(content)
    problem, text = "", ""
    try:
        text = read_text(file)
    except FormatError as error:
        problem = error.problem
    assert "text" in problem or not problem
    assert not set(text) & {"\0", "\r"}


def test_text_beyond_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inputs, "LARGEST_TEXT_BYTES", 10)
    (tmp_path / "a.toml").write_text("x = 1\n" * 10)
    with pytest.raises(FormatError, match="a text file of at most 10 bytes, got 60"):
        read_text(tmp_path / "a.toml")


def test_half_a_character_in_json_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"a": "\\ud800"}')
    with pytest.raises(FormatError, match="not valid JSON: .*surrogates not allowed"):
        read_json(tmp_path / "a.json")
    (tmp_path / "a.json").write_text('{"a": "\\ud83e\\udd16"}')
    assert read_json(tmp_path / "a.json") == {"a": "🤖"}
