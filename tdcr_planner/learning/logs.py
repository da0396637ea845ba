"""TensorBoard logs of a training, where tensorboard is installed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from tdcr_planner.errors import InputError


class TrainingLog:
    """Writes figures of each epoch to a folder that TensorBoard reads; nothing without a folder."""

    def __init__(self, folder: Path | None) -> None:
        """Opens the log.

        Args:
            folder: Where to write; None for no log.

        Raises:
            InputError: The package tensorboard is not installed, or the folder cannot be written.
        """
        self._writer: Any = None
        if folder is None:
            return
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError as error:
            raise InputError(
                "log", "the package tensorboard to be installed (pip install tensorboard)", "none"
            ) from error
        try:
            self._writer = SummaryWriter(str(folder))
        except OSError as error:
            raise InputError("log", "a folder that can be written", f"{folder}: {error.strerror or error}") from error

    def add(self, epoch: int, figures: Mapping[str, float]) -> None:
        """Adds figures of one epoch by name."""
        if self._writer is not None:
            for name, value in figures.items():
                self._writer.add_scalar(name, value, epoch)

    def __enter__(self) -> TrainingLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.close()
