"""Writing a shape model: TorchScript, card and plain weights in one file."""

from __future__ import annotations

import io
import platform
import warnings
import zipfile
from importlib.metadata import version
from itertools import groupby
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tdcr_planner.learning.checkpoint import write_bytes
from tdcr_planner.shape.card import ModelCard
from tdcr_planner.shape.model_file import CARD_FILE, WEIGHTS_FILE
from tdcr_planner.shape.shooting import ShootingWeights
from tdcr_planner.shape.torch_module import script_module

UNITS = {"tensions": "N", "gravity": "m/s^2", "tip_force": "N", "positions": "m", "rotations": "1"}


def write_model(path: Path, network: nn.Module, card: ModelCard, weights: ShootingWeights | None) -> None:
    """Writes a model file, whole or not at all.

    Args:
        path: The file.
        network: The trained network; its `forward` maps tensions, gravity and tip force to positions and rotations.
        card: Its card.
        weights: The weights for the compiled path; None for a network that has none.
    """
    extra: dict[str, bytes | str] = {CARD_FILE: card.model_dump_json(indent=1)}
    if weights is not None:
        extra[WEIGHTS_FILE] = _weights_as_bytes(weights)
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"`torch\.jit\..*` is deprecated", category=DeprecationWarning)
        torch.jit.save(script_module(network), buffer, _extra_files=extra)
    write_bytes(path, _canonical_archive(buffer))


def library_versions() -> dict[str, str]:
    """Returns the versions of what makes a model."""
    names = ("tdcr-planner", "torch", "numpy", "numba")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}


def _canonical_archive(archive: io.BytesIO) -> bytes:
    """Returns a TorchScript archive without what differs between two runs that train the same model.

    The places in the source that its code came from are for error messages only, and name folders of the machine.
    The number that torch gives the archive follows from all of them, and nothing needs it. A module's constants stand
    in an order that Python draws anew for each process; sorted, they mean the same.
    """
    kept = io.BytesIO()
    with zipfile.ZipFile(archive) as source, zipfile.ZipFile(kept, "w", zipfile.ZIP_STORED) as target:
        for record in source.infolist():
            if record.filename.endswith((".debug_pkl", "/.data/serialization_id")):
                continue
            content = source.read(record)
            if record.filename.endswith(".py"):
                content = _with_sorted_constants(content)
            target.writestr(zipfile.ZipInfo(record.filename), content)
    return kept.getvalue()


def _with_sorted_constants(code: bytes) -> bytes:
    """Returns a module's serialized code with each group of lines `name : Final[...] = value` in order."""
    lines = code.decode().split("\n")
    groups = groupby(lines, key=lambda line: " : Final[" in line)
    return "\n".join(line for constant, group in groups for line in (sorted(group) if constant else group)).encode()


def _weights_as_bytes(weights: ShootingWeights) -> bytes:
    arrays: dict[str, np.ndarray] = {
        "features": weights.features,
        "load_scale": weights.load_scale,
        "layers": np.array(len(weights.matrices)),
        "corrections": np.array(weights.corrections),
    }
    for index, (matrix, bias) in enumerate(zip(weights.matrices, weights.biases, strict=True)):
        arrays[f"matrix_{index}"] = matrix
        arrays[f"bias_{index}"] = bias
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()
