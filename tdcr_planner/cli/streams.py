"""Standard streams of the command line: closed ones, narrow encodings, and text that would change a terminal."""

from __future__ import annotations

import io
import os
import sys


def prepare_streams() -> None:
    """Lets output be written whatever the streams are: a closed one goes nowhere, other characters are escaped."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # The lowest free number is this one. Left free, it would become that of the next file that is opened.
            os.open(os.devnull, os.O_RDWR)
            if descriptor > 0:
                os.set_inheritable(descriptor, True)
    sys.stdout = sys.stdout or os.fdopen(1, "w", encoding="utf-8", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", encoding="utf-8", closefd=False)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def discard_output() -> None:
    """Sends what is left in the streams' buffers nowhere: Python would complain once more about it at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for descriptor in (1, 2):
        os.dup2(nowhere, descriptor)


def one_line(text: str) -> str:
    """Returns a message as one line in which control characters, as names and files may hold them, are escaped."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape", "surrogatepass").decode()
        for character in text
    )
