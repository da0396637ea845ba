"""What evaluates the network of a model file: machine code, torch, or onnxruntime."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.shape.convention import decode, encode
from tdcr_planner.shape.foreign_network import load_network
from tdcr_planner.shape.model_file import ModelFile
from tdcr_planner.shape.rod_kernel import rod_constants
from tdcr_planner.shape.shooting import ShootingFunction

Device = Literal["cpu", "cuda"]

Answer = tuple[FloatArray, FloatArray, FloatArray | None]
"""Positions (n, d, 3) m, rotations (n, d, 3, 3), base frame, and the moment left over at the tip (n,) N m if known."""


class Evaluator(Protocol):
    """A network that is ready to answer."""

    def __call__(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> Answer:
        """Returns the shapes of a batch; shapes, units and frames as in `ShapeModel.disk_poses_unchecked`."""
        ...


def make_evaluator(path: Path, content: ModelFile, engine: str, device: str = "cpu") -> Evaluator:
    """Returns what evaluates a model file.

    Args:
        path: The file, for messages.
        content: What it holds.
        engine: Which, one of `model_file.Engine`.
        device: "cpu" or, with torch, "cuda".

    Raises:
        InputError: The file has no such engine, or there is no such device.
        FormatError: An adopted network does not load.
    """
    if engine not in content.engines:
        raise InputError("shape_engine", f"one that {path} has: {', '.join(content.engines)}", engine)
    if device == "cuda" and engine != "torchscript":
        raise InputError("shape_device", f"cpu for the engine {engine!r}; 'torchscript' runs on a GPU", device)
    if content.foreign is not None:
        return _AdoptedNetwork(path, content, device)
    if engine == "compiled":
        assert content.weights is not None  # only files with weights have this engine
        return ShootingFunction(rod_constants(content.card.robot), content.weights)
    return _OwnModule(path, content, device)


class _OwnModule:
    """The TorchScript module of this project's own classes."""

    def __init__(self, path: Path, content: ModelFile, device: str) -> None:
        from tdcr_planner.shape.torch_module import paper_module, shooting_module, to_device

        if content.weights is not None:
            module = shooting_module(content.card, content.weights)
        else:
            module = paper_module(path, content.card, content.tensors)
        self._shooting = content.weights is not None
        self._module = to_device(module, device)
        self._device = device

    def __call__(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> Answer:
        from tdcr_planner.shape.torch_module import ask, ask_with_residual

        if self._shooting:
            return ask_with_residual(self._module, self._device, tensions, gravity, tip_force)
        return (*ask(self._module, self._device, tensions, gravity, tip_force), None)


class _AdoptedNetwork:
    """Somebody else's network, asked and understood by its convention."""

    def __init__(self, path: Path, content: ModelFile, device: str) -> None:
        adoption = content.card.adoption
        assert adoption is not None  # an adopted model has it, and the network
        assert content.foreign is not None
        self._path = path
        self._robot = content.card.robot
        self._convention = adoption.convention
        self._network = load_network(path, content.foreign, device=device)
        if self._network.kind != adoption.kind:
            raise FormatError(path, f"its card is of a {adoption.kind} network, it holds another")

    def __call__(self, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray) -> Answer:
        count, robot = len(tensions), self._robot
        if not count:
            return np.empty((0, robot.disk_count, 3)), np.empty((0, robot.disk_count, 3, 3)), None
        try:
            answers = self._network(encode(self._convention, robot, tensions, gravity, tip_force))
            positions, rotations = decode(self._convention, robot, count, list(answers.values()))
        except InputError as error:
            raise FormatError(
                self._path, f"its network does not answer as it did when it was adopted: {error}"
            ) from error
        return positions, rotations, None
