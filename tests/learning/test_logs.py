"""Logs of a training: figures go to TensorBoard's writer, and its absence is named."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.learning.logs import TrainingLog


def test_without_the_package_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(InputError, match="log: expected the package tensorboard to be installed"):
        TrainingLog(tmp_path / "log")
    with TrainingLog(None) as log:
        log.add(1, {"loss": 2.0})
    assert not list(tmp_path.iterdir())


def test_every_figure_reaches_the_writer_which_is_closed(tmp_path, monkeypatch):
    told = []

    class Writer:
        def __init__(self, folder):
            told.append(folder)

        def add_scalar(self, name, value, step):
            told.append((name, value, step))

        def close(self):
            told.append("closed")

    module = ModuleType("torch.utils.tensorboard")
    module.SummaryWriter = Writer
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", module)
    with TrainingLog(tmp_path) as log:
        log.add(1, {"loss": 2.0, "validation": 3.0})
    assert told == [str(tmp_path), ("loss", 2.0, 1), ("validation", 3.0, 1), "closed"]


def test_a_folder_that_cannot_be_made_is_named(tmp_path, monkeypatch):
    module = ModuleType("torch.utils.tensorboard")

    def refuse(folder):
        raise NotADirectoryError(20, "Not a directory")

    module.SummaryWriter = refuse
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", module)
    with pytest.raises(InputError, match="log: expected a folder that can be written.*Not a directory"):
        TrainingLog(tmp_path / "log")
