"""Standard streams of the command line: closed ones, narrow encodings, and text that would change a terminal."""

from __future__ import annotations

import io
import os
import sys
from typing import TextIO


class _Output(io.TextIOWrapper):
    """A standard stream that outlives its reader: `head`, for example, ends when it has seen enough."""

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except BrokenPipeError:
            self._forget_reader()
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except BrokenPipeError:
            self._forget_reader()

    def _forget_reader(self) -> None:
        """Sends what is left in the buffer, and all that follows, nowhere."""
        discard_output(self)


def prepare_streams() -> None:
    """Lets output be written whatever the streams are: a closed one goes nowhere, other characters are escaped."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # The lowest free number is this one. Left free, it would become that of the next file that is opened.
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _tolerant(sys.stdout, 1)
    sys.stderr = _tolerant(sys.stderr, 2)


def discard_output(stream: TextIO) -> None:
    """Sends what a stream still holds nowhere: Python would complain once more about it at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def one_line(text: str) -> str:
    """Returns a message as one line in which control characters, as names and files may hold them, are escaped."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape", "surrogatepass").decode()
        for character in text
    )


def _tolerant(stream: TextIO | None, descriptor: int) -> TextIO:
    if stream is None:
        return os.fdopen(descriptor, "w", encoding="utf-8", closefd=False)
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    lines, through = stream.line_buffering, stream.write_through
    encoding = stream.encoding
    return _Output(
        stream.detach(),
        encoding,
        "backslashreplace",
        line_buffering=lines,
        write_through=through,
    )
