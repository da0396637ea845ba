"""Drawing after the result is written: what fails costs its own picture and one warning, nothing else."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from pathlib import Path

from tdcr_planner.files import write_file_whole

_log = logging.getLogger(__name__)

Drawing = Callable[[Path], None]


def draw_pictures(folder: str | Path, drawings: Mapping[str, Drawing], *, stale: tuple[str, ...] = ()) -> list[str]:
    """Draws files into a folder, each whole or not at all, and returns the names of those that were drawn.

    Files of these names go first: they show an earlier result. A picture that cannot be drawn is a warning in the log
    that names it and its cause, whatever the cause is; what is interrupted stays interrupted.

    Args:
        folder: An existing folder.
        drawings: What writes each file, by its name in the folder; called with the path to write.
        stale: Names of other files that go, too.
    """
    target = Path(folder)
    for name in (*drawings, *stale):
        _remove_file(target / name)
    drawn = []
    for name, draw in drawings.items():
        try:
            with write_file_whole(target / name) as temporary:
                draw(temporary)
            drawn.append(name)
        except Exception as error:
            warn_not_drawn(target / name, error)
    return drawn


def warn_not_drawn(name: str | Path, error: Exception) -> None:
    """Logs one warning: which picture is missing, and why."""
    _log.warning("%s is not drawn: %s: %s", name, type(error).__name__, " ".join(str(error).split()))


def _remove_file(file: Path) -> None:
    """Removes a plain file; leaves alone what cannot be removed and what is no plain file, as a device or a link."""
    try:
        if file.is_file() and not file.is_symlink():
            file.unlink()
    except OSError:
        _log.debug("%s cannot be removed", file)
