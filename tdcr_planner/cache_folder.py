"""Where this program keeps what it can make again: a folder of the user's own that nobody else can write to."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from tdcr_planner.errors import TdcrError


class UnusableFolderError(TdcrError):
    """A folder that cannot be used as a cache; the message says why."""


def cache_folder() -> Path | None:
    """Returns the folder for caches: TDCR_CACHE_DIR, or tdcr_planner in the user's cache folder.

    None where neither is given nor can be told: a user without a home folder. The folder need not exist.
    """
    given = os.environ.get("TDCR_CACHE_DIR")
    if given:
        return Path(given)
    base = os.environ.get("XDG_CACHE_HOME")
    if base:
        return Path(base) / "tdcr_planner"
    try:
        return Path.home() / ".cache" / "tdcr_planner"
    except RuntimeError:
        return None


def temporary_cache_folder() -> Path:
    """Returns the folder that stands in for a cache folder that cannot be used: one for each user."""
    user = os.geteuid() if hasattr(os, "geteuid") else os.environ.get("USERNAME", "user")
    return Path(tempfile.gettempdir()) / f"tdcr_planner-{user}"


def check_private(folder: Path) -> None:
    """Makes a folder, mode 0700, where it is missing, and checks that only its owner can write to it.

    What is read from such a folder is run as code. So the folder must belong to the user of this process or to root,
    must not be a link, and nobody else may write to it.

    Raises:
        UnusableFolderError: It cannot be made, or is not private.
    """
    try:
        if not folder.is_dir():
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except (OSError, ValueError) as error:
        raise UnusableFolderError(f"it cannot be made: {getattr(error, 'strerror', None) or error}") from error
    if not stat.S_ISDIR(found.st_mode):
        raise UnusableFolderError("it is a link or a file, not a folder")
    if hasattr(os, "geteuid"):
        if found.st_uid not in (os.geteuid(), 0):
            raise UnusableFolderError(f"it belongs to user {found.st_uid}, not to user {os.geteuid()}")
        if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise UnusableFolderError("other users can write to it")
