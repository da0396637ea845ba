"""Checkpoints: the state of a training on disk, so that a killed one goes on as if nothing had happened."""

from __future__ import annotations

import io
import math
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tdcr_planner.archive import open_archive
from tdcr_planner.errors import FormatError
from tdcr_planner.files import open_file, write_file_whole

_FORMAT = "tdcr-checkpoint/1"
_KEYS = {"format", "robot", "settings", "state"}
# Four sets of weights, of a network many times as large as any that is useful here.
_MOST_BYTES = 2**31


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


def load_checkpoint(path: Path, robot: str, settings: str, like: Any) -> dict[str, Any] | None:
    """Returns the state in a checkpoint, None where there is none.

    Args:
        path: The file.
        robot: What must be the same to go on: the robot's hash.
        settings: The same for the settings.
        like: A state of the same training; see `check_like`.

    Raises:
        FormatError: The file is broken, or belongs to another robot or other settings.
    """
    if not os.path.lexists(path):
        return None
    try:
        # torch reads without looking at the archive's checksums.
        with open_archive(path, "checkpoint", _MOST_BYTES) as archive:
            archive.check_all()
        with open_file(path) as stream:
            content = torch.load(stream, weights_only=True, map_location="cpu")
    except (
        FormatError,
        RuntimeError,
        OSError,
        EOFError,
        LookupError,
        ValueError,
        TypeError,
        AttributeError,
        AssertionError,
        pickle.UnpicklingError,
    ) as error:
        raise FormatError(path, f"is a broken checkpoint ({error}); delete it to start again") from error
    if not isinstance(content, dict) or content.get("format") != _FORMAT or set(content) != _KEYS:
        raise FormatError(path, "is not a checkpoint of this version; delete it to start again")
    for what, mine in (("robot", robot), ("settings", settings)):
        if content[what] != mine:
            raise FormatError(
                path,
                f"is a checkpoint of another training: its {what} differs; delete it to start again, or write to "
                "another --out",
            )
    state: dict[str, Any] = content["state"]
    check_like(path, "state", state, like)
    return state


def check_like(path: Path, place: str, value: Any, like: Any) -> None:
    """Raises FormatError unless a value is built like another: the same keys, types, shapes, and finite numbers.

    Args:
        path: The checkpoint.
        place: Where in it the value stands.
        value: Tensors, numbers, text, lists and tables of them.
        like: What a training of the same robot and settings would write; a list of one stands for any length, and
            infinity for a number that may be infinite.
    """
    problem = _difference(value, like)
    if problem:
        raise FormatError(path, f"{problem}; delete the checkpoint to start again", place)
    if isinstance(like, dict):
        for key, item in like.items():
            check_like(path, f"{place}.{key}", value[key], item)
    elif isinstance(like, list | tuple):
        for index, item in enumerate(value):
            check_like(path, f"{place}[{index + 1}]", item, like[min(index, len(like) - 1)])


def _difference(value: Any, like: Any) -> str:
    """Returns in what a value is built otherwise than another, without what is in them; empty for nothing."""
    if type(value) is not type(like):
        if {type(value), type(like)} != {int, float}:
            return f"expected {type(like).__name__}, got {type(value).__name__}"
        if isinstance(value, float):
            return "expected an integer"
    if isinstance(like, Tensor):
        if value.dtype != like.dtype or value.shape != like.shape:
            return f"expected a tensor of {like.dtype} and shape {tuple(like.shape)}"
        return "" if bool(torch.isfinite(value).all()) else "expected finite numbers"
    if isinstance(like, dict):
        return "" if value.keys() == like.keys() else f"expected the keys {', '.join(str(key) for key in like)}"
    if isinstance(like, list | tuple):
        return "" if len(value) == len(like) or len(like) == 1 else f"expected {len(like)} entries, got {len(value)}"
    if isinstance(like, float) and not math.isfinite(value) and (math.isnan(value) or math.isfinite(like)):
        return "expected a finite number"
    return ""


def optimiser_like(optimiser: torch.optim.Optimizer) -> dict[str, Any]:
    """Returns what the state of an AdamW optimiser looks like after its first step, for `check_like`."""
    like = optimiser.state_dict()
    parameters = [parameter for group in optimiser.param_groups for parameter in group["params"]]
    moments = {
        index: {"step": torch.zeros(()), "exp_avg": parameter.detach(), "exp_avg_sq": parameter.detach()}
        for index, parameter in enumerate(parameters)
    }
    return {**like, "state": moments}


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
