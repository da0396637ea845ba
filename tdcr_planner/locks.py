"""Advisory locks on open files and folders, which the system releases when their holder ends, however it ends."""

from __future__ import annotations

import enum
import errno
from importlib.util import find_spec

# Systems other than POSIX ones, such as Windows, have no such locks.
HAS_LOCKS = find_spec("fcntl") is not None


class LockState(enum.Enum):
    """What came of asking for a lock."""

    HELD = "held"
    IN_USE = "in use by another process"
    UNAVAILABLE = "not available on this system or file system"


_TAKEN = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES)


def try_lock(descriptor: int) -> LockState:
    """Asks for the lock of an open file or folder without waiting; closing the descriptor gives it back.

    Network file systems may know no locks: that is another answer than a lock that somebody else holds.
    """
    if not HAS_LOCKS:
        return LockState.UNAVAILABLE
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return LockState.IN_USE if error.errno in _TAKEN else LockState.UNAVAILABLE
    return LockState.HELD
