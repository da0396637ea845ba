"""Opening the user's files: regular files only, text in UTF-8 only, and every fault of a name is one FormatError."""

from __future__ import annotations

import codecs
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from tdcr_planner.errors import FormatError

# Text is held in memory as a whole, several times over while it is parsed. Results of long paths take a few MB.
LARGEST_TEXT_BYTES = 256 * 2**20

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_BYTE_ORDER_MARKS = (
    # UTF-32 first: its mark begins like that of UTF-16.
    (codecs.BOM_UTF32_LE, "UTF-32"),
    (codecs.BOM_UTF32_BE, "UTF-32"),
    (codecs.BOM_UTF16_LE, "UTF-16"),
    (codecs.BOM_UTF16_BE, "UTF-16"),
)
# What may stand in text below the space: tabulator, line feed, form feed, carriage return.
_BINARY = frozenset(range(32)) - {0x09, 0x0A, 0x0C, 0x0D}


def check_name(path: str | Path) -> None:
    """Raises FormatError unless a name can be passed to the system and written into text files."""
    name = os.fspath(path)
    if "\0" in name:
        raise FormatError(path, "expected a file name, got one with a null byte")
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise FormatError(path, "expected a file name in UTF-8, got one in another encoding; rename it") from error


def check_file(path: str | Path) -> None:
    """Raises FormatError unless a path leads to a regular file.

    Nothing is opened: a pipe or device cannot keep the program waiting.
    """
    check_name(path)
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError as error:
        problem = "is a link to a file that does not exist" if os.path.islink(path) else "no such file"
        raise FormatError(path, problem) from error
    except OSError as error:
        raise FormatError(path, f"cannot be read: {error.strerror}") from error
    _check_regular(path, mode)


def real_path(path: str | Path) -> Path:
    """Returns the absolute path of a file with links followed; a loop of links stays, to be refused when it is read."""
    check_name(path)
    return Path(os.path.realpath(path))


def find_named_file(path: str | Path, source: str | Path, place: str, advice: str = "") -> Path:
    """Returns the real path of a file that another file names.

    Args:
        path: The named file, absolute or as seen from where the program runs.
        source: The file that names it.
        place: The key at which it does.
        advice: What to do where there is none, appended to the message.

    Raises:
        FormatError: There is no regular file; the message tells `source` and `place`.
    """
    try:
        check_file(path)
    except FormatError as error:
        target = path if "\0" in os.fspath(path) else os.path.realpath(path)
        raise FormatError(source, f"{error.problem}: {target}{advice}", place) from error
    return real_path(path)


@contextmanager
def open_file(path: str | Path) -> Iterator[BufferedReader]:
    """Opens a regular file for reading bytes; what the system refuses inside of the `with` block counts too.

    Raises:
        FormatError: The name cannot be one, there is no such file, it is a folder, pipe, socket or device, or it
            cannot be read.
    """
    check_file(path)
    try:
        with open(path, "rb", opener=_open_at_once) as stream:
            _check_regular(path, os.fstat(stream.fileno()).st_mode)
            yield stream
    except OSError as error:
        raise FormatError(path, f"cannot be read: {error.strerror or error}") from error


def read_bytes(path: str | Path) -> bytes:
    """Returns the bytes of a regular file, or raises FormatError saying why it cannot be read."""
    with open_file(path) as stream:
        return stream.read()


def read_text(path: str | Path) -> str:
    """Returns a file's text with line feeds between lines, without the byte order mark that some editors write.

    Raises:
        FormatError: It cannot be read, is larger than any text of this package, is not text, or is not in UTF-8; the
            message then names the encoding that it seems to have.
    """
    with open_file(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > LARGEST_TEXT_BYTES:
            raise FormatError(path, f"expected a text file of at most {LARGEST_TEXT_BYTES:,} bytes, got {size:,}")
        content = stream.read()
    return _decode(path, content).replace("\r\n", "\n").replace("\r", "\n")


def _open_at_once(name: str, flags: int) -> int:
    """Opens without waiting: the name may have become that of a pipe since it was checked."""
    return os.open(name, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))


def _check_regular(path: str | Path, mode: int) -> None:
    for is_kind, kind in _KINDS:
        if is_kind(mode):
            raise FormatError(path, f"is {kind}, expected a file")


def _decode(path: str | Path, content: bytes) -> str:
    for mark, encoding in _BYTE_ORDER_MARKS:
        if content.startswith(mark) and _is_text_in(content, encoding):
            raise FormatError(path, f"is text in {encoding}, expected UTF-8; save it as UTF-8")
    if 0 in content:
        # Western text in UTF-16 has a null byte in almost every pair.
        for encoding, nulls in (("UTF-16-LE", content[1::2]), ("UTF-16-BE", content[0::2])):
            if 2 * nulls.count(0) > len(nulls) and _is_text_in(content, encoding):
                raise FormatError(path, "is text in UTF-16, expected UTF-8; save it as UTF-8")
        raise FormatError(path, "is not a text file")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if not _BINARY.isdisjoint(content):
            raise FormatError(path, "is not a text file") from error
        line = content.count(b"\n", 0, error.start) + 1
        found = content[error.start : error.start + 1]
        meant = found.decode("cp1252", errors="replace")
        raise FormatError(
            path,
            f"expected text in UTF-8, got byte 0x{found.hex().upper()}, which is {meant!r} in Latin-1 or Windows-1252; "
            "save it as UTF-8",
            f"line {line}",
        ) from error


def _is_text_in(content: bytes, encoding: str) -> bool:
    try:
        return "\0" not in content.decode(encoding)
    except UnicodeDecodeError:
        return False
