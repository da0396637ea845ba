"""Checkpoints: the state of a training on disk, so that a killed one goes on as if nothing had happened."""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from tdcr_planner.errors import FormatError
from tdcr_planner.files import open_file, write_file_whole

_FORMAT = "tdcr-checkpoint/1"


def checkpoint_path(out: Path) -> Path:
    """Returns where the checkpoint of a training that writes `out` stands."""
    return out.with_name(out.name + ".checkpoint")


def save_checkpoint(path: Path, robot: str, settings: str, state: dict[str, Any]) -> None:
    """Writes a checkpoint, whole or not at all.

    Args:
        path: The file.
        robot: What must be the same to go on: the robot's hash.
        settings: The same for the settings.
        state: Tensors, numbers and lists of them.
    """
    content = {"format": _FORMAT, "robot": robot, "settings": settings, "state": state}
    buffer = io.BytesIO()
    torch.save(content, buffer)
    write_bytes(path, buffer.getvalue())


def load_checkpoint(path: Path, robot: str, settings: str) -> dict[str, Any] | None:
    """Returns the state in a checkpoint, None where there is none.

    Raises:
        FormatError: The file is broken, or belongs to another robot or other settings.
    """
    if not os.path.lexists(path):
        return None
    try:
        with open_file(path) as stream:
            content = torch.load(stream, weights_only=True, map_location="cpu")
    except (RuntimeError, EOFError, ValueError, pickle.UnpicklingError) as error:
        raise FormatError(path, "is a broken checkpoint; delete it to start again") from error
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise FormatError(path, "is not a checkpoint of this version; delete it to start again")
    for what, mine in (("robot", robot), ("settings", settings)):
        if content[what] != mine:
            raise FormatError(
                path,
                f"is a checkpoint of another training: its {what} differs; delete it to start again, or write to "
                "another --out",
            )
    state: dict[str, Any] = content["state"]
    return state


def write_bytes(path: Path, content: bytes) -> None:
    """Writes a file whole, or raises FormatError and leaves what was there."""
    write_with(path, lambda temporary: temporary.write_bytes(content))


def write_with(path: Path, write: Callable[[Path], object]) -> None:
    """Lets `write` fill a temporary file that then replaces `path`; a full disk raises FormatError, changes nothing."""
    try:
        with write_file_whole(path) as temporary:
            write(temporary)
    except OSError as error:
        raise FormatError(path, f"cannot be written: {error.strerror or error}") from error
