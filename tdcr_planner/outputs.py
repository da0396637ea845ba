"""Writing files whole or not at all: staged beside their target, then moved there, or poured into a pipe or device."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tdcr_planner.errors import FormatError
from tdcr_planner.inputs import check_name
from tdcr_planner.locks import LockState, try_lock

STAGING_PREFIX = ".tdcr-writing-"
# Where there are no locks, a staging folder that nothing has touched for so long is left over. No file takes a day.
ABANDONED_S = 86400.0
# Bytes of a name between two separators that common file systems allow.
_LONGEST_NAME = 255


@contextmanager
def write_file_whole(path: str | Path) -> Iterator[Path]:
    """Yields a temporary path with the target's name; on success the file written there becomes the target.

    A link is followed: the file that it leads to is replaced, and the link stays. A regular file is replaced at once
    and keeps its permissions; on an error nothing changes. What the file holds is written into a pipe or device, which
    cannot be replaced.

    Raises:
        FormatError: The target is a folder, or cannot be made or written, or the disk is full.
    """
    target = Path(path)
    check_file_target(target)
    into = _is_stream(target)
    real = target if into else Path(os.path.realpath(target))
    with _staging(_temporary_folder(target) if into else real.parent) as staging, _full_disk_named(target):
        temporary = staging / target.name
        yield temporary
        if into:
            _pour(temporary, target)
        else:
            _replace(temporary, real)


@contextmanager
def write_folder_whole(folder: str | Path, last: str = "result.json") -> Iterator[Path]:
    """Yields an empty staging folder whose files are moved into the target folder together on success.

    On an exception (Ctrl-C included) the target stays as it was. Every file is moved complete; the one named `last`
    comes last, so that whoever finds it finds the others too. Links are followed as by `write_file_whole`.

    Args:
        folder: The target folder, made when it is missing.
        last: Name of the file that says the set is complete.

    Raises:
        FormatError: The folder cannot be made or written, one of the files is a folder there, or the disk is full.
    """
    target = Path(folder)
    check_name(target)
    with _staging(target) as staging, _full_disk_named(target):
        yield staging
        names = sorted((item.name for item in staging.iterdir()), key=lambda name: (name == last, name))
        for name in names:
            check_file_target(target / name)
        for name in names:
            if os.path.islink(target / name) or _is_stream(target / name):
                with write_file_whole(target / name) as temporary:
                    shutil.copyfile(staging / name, temporary)
            else:
                _replace(staging / name, target / name)


def check_folder(folder: str | Path, files: Iterable[str] = ()) -> None:
    """Raises FormatError unless files can be written into a folder: what is computed for it would be lost.

    Nothing is made or changed.

    Args:
        folder: The folder; it may be missing, with folders above it.
        files: Names of the files that shall be written there.
    """
    check_name(folder)
    target = Path(os.path.abspath(folder))
    _check_length(folder, target)
    nearest = next(place for place in (target, *target.parents) if os.path.lexists(place))
    if not nearest.is_dir():
        raise FormatError(folder, f"cannot be written: {nearest} is no folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise FormatError(folder, f"cannot be written: no permission in {nearest}")
    for name in files:
        check_file_target(target / name)


def check_file_target(path: str | Path) -> None:
    """Raises FormatError unless a file can be written at a path, for the same reason as `check_folder`."""
    check_name(path)
    _check_length(path, Path(os.path.abspath(path)))
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        mode = stat.S_IFREG
    except OSError as error:
        raise FormatError(path, f"cannot be written: {error.strerror}") from error
    if stat.S_ISDIR(mode):
        raise FormatError(path, "is a folder, expected a file")
    if stat.S_ISBLK(mode):
        raise FormatError(path, "is a disk, whose content would be destroyed; expected a file, pipe or terminal")
    if stat.S_ISREG(mode):
        check_folder(Path(os.path.realpath(path)).parent)


def is_private(path: str | Path) -> bool:
    """Whether nobody but this user (and the system's administrator) decides what a file or folder holds.

    A file or folder that another user owns, that everybody may write to, or that lies where everybody may exchange it,
    is not private. Systems without such owners have nothing to tell: there everything counts as private.
    """
    if not hasattr(os, "geteuid"):
        return True
    place = Path(os.path.realpath(path))
    trusted = (0, os.geteuid())
    try:
        own = os.stat(place)
        above = [os.stat(folder) for folder in place.parents]
    except OSError:
        return False
    if own.st_uid not in trusted or own.st_mode & stat.S_IWOTH:
        return False
    # In a folder with the sticky bit, such as /tmp, only an entry's owner can exchange it.
    return all(not folder.st_mode & stat.S_IWOTH or folder.st_mode & stat.S_ISVTX for folder in above)


def _check_length(path: str | Path, absolute: Path) -> None:
    longest = max((len(os.fsencode(part)) for part in absolute.parts), default=0)
    if longest > _LONGEST_NAME:
        raise FormatError(path, f"expected names of at most {_LONGEST_NAME} bytes, got one of {longest}")


def _is_stream(path: Path) -> bool:
    """Whether something is there that is neither file nor folder: a pipe, a terminal, /dev/null."""
    return os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path)


def _replace(source: Path, target: Path) -> None:
    """Moves a file to its target, which keeps the permissions that it has."""
    with suppress(OSError):
        source.chmod(stat.S_IMODE(target.stat().st_mode))
    try:
        os.replace(source, target)
    except OSError as error:
        raise FormatError(target, f"cannot be written: {error.strerror}") from error


def _pour(source: Path, target: Path) -> None:
    """Writes a file's bytes into a pipe or device."""
    try:
        # Without waiting: the pipe's other end may never be opened.
        descriptor = os.open(target, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        os.set_blocking(descriptor, True)
        with source.open("rb") as content, os.fdopen(descriptor, "wb") as stream:
            shutil.copyfileobj(content, stream)
    except OSError as error:
        unread = error.errno in (errno.ENXIO, errno.EPIPE)
        problem = "no program reads from it" if unread else error.strerror
        raise FormatError(target, f"cannot be written: {problem}") from error


def _temporary_folder(target: Path) -> Path:
    try:
        return Path(tempfile.gettempdir())
    except OSError as error:
        raise FormatError(target, f"cannot be written: {error.strerror}") from error


@contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    """Yields a folder for files that are being written, and removes it and what killed processes have left beside it.

    Its lock says that its process is alive; its random name and its permissions keep others out.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(folder)
        staging, descriptor = _make_staging(folder)
    except OSError as error:
        raise FormatError(folder, f"cannot be written: {error.strerror}") from error
    try:
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        if descriptor is not None:
            os.close(descriptor)


def _make_staging(folder: Path) -> tuple[Path, int | None]:
    """Returns a staging folder and the descriptor that holds its lock; None where folders cannot be opened."""
    while True:
        staging = Path(tempfile.mkdtemp(prefix=STAGING_PREFIX, dir=folder))
        descriptor = _open_folder(staging)
        state = LockState.UNAVAILABLE if descriptor is None else try_lock(descriptor)
        # Another process may have taken the lock, and the folder for abandoned, before this one could.
        if state is not LockState.IN_USE and staging.exists():
            return staging, descriptor
        if descriptor is not None:
            os.close(descriptor)


def _remove_abandoned(folder: Path) -> None:
    with suppress(OSError), os.scandir(folder) as entries:
        found = [Path(entry) for entry in entries if entry.name.startswith(STAGING_PREFIX)]
        for staging in found:
            _remove_if_abandoned(staging)


def _remove_if_abandoned(staging: Path) -> None:
    """Removes a staging folder of this user whose process is gone, or which is old where that cannot be told."""
    if hasattr(os, "geteuid") and staging.lstat().st_uid != os.geteuid():
        return
    descriptor = _open_folder(staging)
    try:
        state = LockState.UNAVAILABLE if descriptor is None else try_lock(descriptor)
        old = time.time() - staging.lstat().st_mtime > ABANDONED_S
        if state is LockState.HELD or (state is LockState.UNAVAILABLE and old):
            shutil.rmtree(staging, ignore_errors=True)
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _open_folder(folder: Path) -> int | None:
    """Returns a descriptor of a folder, or None for links and other things, and where the system opens no folders."""
    if not hasattr(os, "O_DIRECTORY"):
        return None
    try:
        return os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None


@contextmanager
def _full_disk_named(target: Path) -> Iterator[None]:
    """Turns what only a disk without room raises into an error that names the target."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise FormatError(target, f"cannot be written: {error.strerror}") from error
        raise
