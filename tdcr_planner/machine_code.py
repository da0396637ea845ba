"""Machine code on disk: one file for each compiled function and signature, read back only where it surely fits."""

from __future__ import annotations

import functools
import hashlib
import logging
import multiprocessing
import os
import pickle
import time
import uuid
from pathlib import Path
from typing import Any

from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from tdcr_planner.cache_folder import UnusableFolderError, cache_folder, check_private, temporary_cache_folder
from tdcr_planner.fingerprint import UnknownValueError, fingerprint

logger = logging.getLogger(__name__)

FOLDER = "compiled-code"
_SUFFIX = ".code"
_DIGEST_BYTES = 32
_DAY_S = 86400.0
_KEPT_S = 60 * _DAY_S  # without use


class MachineCodeCache(_Cache):
    """The machine code of one function.

    numba asks it before it compiles and hands it what was compiled. Whatever fails here means that the function is
    compiled again: a file that is missing or damaged, a folder that cannot be read or is full.
    """

    def __init__(self, dispatcher: Any) -> None:
        """Prepares the cache; no file is touched before the function is first called."""
        self._dispatcher = dispatcher
        self._enabled = True
        self._fingerprint: str | None = None

    @property
    def cache_path(self) -> str:
        """The folder that is written to, or an empty text where there is none."""
        _, writable = code_folders()
        return str(writable or "")

    def enable(self) -> None:
        """Turns the cache on."""
        self._enabled = True

    def disable(self) -> None:
        """Turns the cache off: nothing is read or written."""
        self._enabled = False

    def flush(self) -> None:
        """Looks at the function and what it uses again. Files that no longer fit are left: they are never read."""
        self._fingerprint = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Returns the compiled function for a signature, or None where it has to be compiled."""
        folders, _ = code_folders()
        if not self._enabled or not folders:
            return None
        target_context.refresh()
        name = self._file_name(sig, target_context.codegen())
        for folder in folders:
            loaded = None if name is None else _load(folder / name, target_context)
            if loaded is not None:
                return loaded
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keeps a compiled function for a signature where that is possible."""
        _, folder = code_folders()
        if not self._enabled or folder is None or data.lifted or data.library.has_dynamic_globals:
            return
        name = self._file_name(sig, data.codegen)
        if name is None:
            return
        payload = dumps(data._reduce())
        try:
            _write_whole(folder / name, hashlib.sha256(payload).digest() + payload)
        except OSError as error:
            _say_once(f"compiled code is not kept in {folder}, so that later runs compile again: {error.strerror}")
            return
        _prune(folder)

    def _file_name(self, sig: Any, codegen: Any) -> str | None:
        try:
            self._fingerprint = self._fingerprint or fingerprint(self._dispatcher)
        except UnknownValueError as error:
            logger.info("%s is not kept for later runs: %s", self._dispatcher.py_func.__name__, error)
            self._enabled = False
            return None
        key = f"{self._fingerprint} {sig!r} {codegen.magic_tuple()}"
        plain = self._dispatcher.py_func
        module = plain.__module__.rpartition(".")[2]
        return f"{module}.{plain.__name__}-{hashlib.sha256(key.encode()).hexdigest()[:40]}{_SUFFIX}"


@functools.cache
def code_folders() -> tuple[tuple[Path, ...], Path | None]:
    """Returns the folders to read compiled code from, and the one to write to, or None.

    `compiled-code` in NUMBA_CACHE_DIR where that is given, else in this program's cache folder; where that cannot be
    written to, in the temporary folder as well. The answer holds for the whole process.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    first = Path(given) if given else cache_folder()
    readable: list[Path] = []
    reason = "the user has no home folder and TDCR_CACHE_DIR is not set"
    for base in (first, temporary_cache_folder()):
        if base is None:
            continue
        folder = base / FOLDER
        try:
            # The temporary folder is everybody's: the one in it has to be this user's as well as what it holds.
            if base is not first:
                check_private(base)
            check_private(folder)
        except UnusableFolderError as error:
            reason = reason if base is not first else f"{folder}: {error}"
            continue
        readable.append(folder)
        if os.access(folder, os.W_OK | os.X_OK):
            if base is not first:
                _say_once(f"compiled code is kept in {folder} ({reason})")
            return tuple(readable), folder
        reason = f"{folder}: it cannot be written to"
    _say_once(f"compiled code is not kept, so that every run compiles again ({reason})")
    return tuple(readable), None


def _load(file: Path, target_context: Any) -> Any:
    """Returns what a file holds, or None where it is missing; a damaged file is removed."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    try:
        payload = memoryview(content)[_DIGEST_BYTES:]
        if hashlib.sha256(payload).digest() != content[:_DIGEST_BYTES]:
            raise ValueError("its checksum is wrong")
        loaded = CompileResult._rebuild(target_context, *pickle.loads(payload))
    except Exception as error:
        # Whatever is wrong with a file, the function can be compiled.
        logger.info("%s is thrown away: %s", file, error)
        file.unlink(missing_ok=True)
        return None
    _mark_used(file)
    return loaded


def _write_whole(file: Path, content: bytes) -> None:
    """Writes a file under a passing name and renames it, so that another process never reads a part of it."""
    temporary = file.with_name(f"{file.name}.{uuid.uuid4().hex[:12]}")
    try:
        temporary.write_bytes(content)
        temporary.replace(file)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _mark_used(file: Path) -> None:
    """Sets a file's time to now, once a day, so that `_prune` keeps it."""
    try:
        if time.time() - file.stat().st_mtime > _DAY_S:
            os.utime(file)
    except OSError:
        logger.debug("the time of %s cannot be set", file)


@functools.cache
def _prune(folder: Path) -> None:
    """Removes files of the folder that no process has used for long; once a process."""
    for file in folder.iterdir():
        try:
            if time.time() - file.stat().st_mtime > _KEPT_S:
                file.unlink()
        except OSError:
            logger.debug("%s cannot be removed", file)


@functools.cache
def _say_once(text: str) -> None:
    """Warns once, and not in worker processes: the process that started them says the same."""
    if multiprocessing.parent_process() is None:
        logger.warning(text)
