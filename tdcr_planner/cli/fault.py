"""The last catch of the command line: what is no fault of the user's ends in one sentence and a file."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
import traceback
from collections.abc import Sequence
from importlib.metadata import version

EXIT_FAULT = 70
"""`EX_SOFTWARE` of sysexits.h: an internal error."""

# How libraries say that the system gave them no memory: torch, the loader of shared libraries, threads.
_MEMORY_WORDS = ("can't allocate memory", "cannot allocate memory", "failed to map segment", "can't start new thread")


def is_memory_fault(error: BaseException) -> bool:
    """Returns whether an exception, or one that it came from, says that memory ran out."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, MemoryError) or (isinstance(seen, OSError) and seen.errno == errno.ENOMEM):
            return True
        if isinstance(seen, OSError | RuntimeError | ImportError):
            text = str(seen).lower()
            if any(word in text for word in _MEMORY_WORDS):
                return True
        seen = seen.__cause__ or seen.__context__
    return False


def describe_memory_fault() -> str:
    """Returns the sentence for a command that ran out of memory."""
    return (
        "not done: the memory that this process may use (of the machine, or by `ulimit -v`) does not suffice; "
        "files that were complete are as they were"
    )


def report_fault(error: BaseException, arguments: Sequence[str] | None) -> str:
    """Writes an exception's traceback into a file of its own; returns the sentence that names it.

    Args:
        error: The exception.
        arguments: The command line without the program's name; None for the process's own.
    """
    words = sys.argv[1:] if arguments is None else arguments
    text = "".join(
        [
            f"tdcr-planner {version('tdcr-planner')}, Python {sys.version.split()[0]}, {sys.platform}\n",
            f"arguments: {list(words)!a}\n\n",
            *traceback.format_exception(error),
        ]
    )
    kind = type(error).__name__
    try:
        handle, name = tempfile.mkstemp(prefix="tdcr-fault-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as stream:
            stream.write(text)
    except OSError:
        return f"fault of the program ({kind}), and no file could be written:\n{text}"
    return (
        f"fault of the program ({kind}), not of your input; please report it with {name}. "
        "Files that were complete are as they were"
    )
