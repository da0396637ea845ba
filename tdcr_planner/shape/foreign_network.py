"""A foreign network, checked and loaded: arrays in, arrays out."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.shape.memory_guard import bounded_memory
from tdcr_planner.shape.onnx_file import check_onnx, onnx_session
from tdcr_planner.shape.script_archive import check_script

NetworkKind = Literal["torchscript", "onnx"]
MODULE_FILES: dict[NetworkKind, str] = {"torchscript": "module.pt", "onnx": "module.onnx"}
"""The record of a model file that holds a foreign network, by its kind."""


class ForeignNetwork(Protocol):
    """A network of somebody else.

    Attributes:
        kind: What evaluates it.
        content: What is stored of it: its checked bytes.
        arguments: Names of its arguments.
        widths: Columns of each argument; None where the file does not say.
        numbers: Types of number that it may take, the likelier first.
        weights: How many numbers it holds; None where the file does not say.
    """

    kind: NetworkKind
    content: bytes
    arguments: tuple[str, ...]
    widths: tuple[int | None, ...]
    numbers: tuple[Literal["float32", "float64"], ...]
    weights: int | None

    def __call__(self, arguments: list[Any]) -> dict[str, Any]:
        """Returns the answers by name (numbers as names where it gives none), in order.

        Raises:
            InputError: It does not take the arguments, fails, or asks for more memory than a call may.
        """
        ...


def load_network(path: Path, content: bytes | None = None, *, device: str = "cpu") -> ForeignNetwork:
    """Returns a network after its file was checked.

    Args:
        path: A TorchScript archive (`.pt`) or an ONNX file (`.onnx`), or the model file that holds it.
        content: Its bytes, where it is a record of a model file; None reads the file.
        device: "cpu" or "cuda".

    Raises:
        FormatError: The file is damaged, or does more than to compute.
        InputError: There is no such device.
    """
    if (path.suffix == ".onnx") if content is None else not content.startswith(b"PK"):
        return OnnxNetwork(path, content, device=device)
    return ScriptNetwork(path, content, device=device)


class ScriptNetwork:
    """A TorchScript module."""

    kind: NetworkKind = "torchscript"
    numbers: tuple[Literal["float32", "float64"], ...] = ("float64", "float32")

    def __init__(self, path: Path, content: bytes | None, *, device: str) -> None:
        """Checks and loads the module; see `load_network`."""
        checked = check_script(path, content)
        self.path = path
        self.content = checked.content
        self.arguments = checked.arguments
        self.widths: tuple[int | None, ...] = (None,) * len(checked.arguments)
        self.weights: int | None = checked.weights
        self._device = device
        self._module = _load_script(path, checked.content, device)

    def __call__(self, arguments: list[Any]) -> dict[str, Any]:
        """See `ForeignNetwork`."""
        import torch

        try:
            with bounded_memory(), warnings.catch_warnings(), torch.inference_mode():
                warnings.simplefilter("ignore")
                given = [torch.from_numpy(np.require(a, requirements=("C", "W"))).to(self._device) for a in arguments]
                return _named(self._module(*given))
        except (RuntimeError, MemoryError, ValueError, IndexError, TypeError) as error:
            raise InputError("network", "a network that takes its inputs", _first_line(error)) from error


def _load_script(path: Path, content: bytes, device: str) -> Any:
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("shape_device", "cpu, as there is no GPU that torch can use", device)
    try:
        with bounded_memory(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # On the CPU whatever device its weights were saved on.
            return torch.jit.load(io.BytesIO(content), map_location=device).eval()
    except (RuntimeError, MemoryError, ValueError, AttributeError, IndexError) as error:
        raise FormatError(path, f"torch does not load it: {_first_line(error)}") from error


def _named(answer: Any) -> dict[str, Any]:
    """Returns what a module answers as arrays by name."""
    if isinstance(answer, Mapping):
        found = {str(name): value for name, value in answer.items()}
    elif hasattr(answer, "_fields"):
        found = dict(zip(answer._fields, answer, strict=True))
    elif isinstance(answer, tuple | list):
        found = {str(index): value for index, value in enumerate(answer)}
    else:
        found = {"0": answer}
    wrong = [name for name, value in found.items() if not hasattr(value, "detach")]
    if wrong:
        raise TypeError(f"answer {wrong[0]!r} is a {type(found[wrong[0]]).__name__}, expected a tensor")
    return {name: value.detach().cpu().numpy() for name, value in found.items()}


class OnnxNetwork:
    """An ONNX model, run by onnxruntime."""

    kind: NetworkKind = "onnx"

    def __init__(self, path: Path, content: bytes | None, *, device: str) -> None:
        """Checks and loads the model; see `load_network`."""
        if device != "cpu":
            raise InputError("shape_device", "cpu for an ONNX file", device)
        self.path = path
        self.content = check_onnx(path, content)
        self.weights: int | None = None
        self._session = onnx_session(path, self.content)
        inputs = self._session.get_inputs()
        self.arguments = tuple(item.name for item in inputs)
        self.widths = tuple(
            item.shape[1] if len(item.shape) == 2 and isinstance(item.shape[1], int) else None for item in inputs
        )
        double = any(item.type == "tensor(double)" for item in inputs)
        self.numbers: tuple[Literal["float32", "float64"], ...] = ("float64",) if double else ("float32",)
        self._outputs = [item.name for item in self._session.get_outputs()]

    def __call__(self, arguments: list[Any]) -> dict[str, Any]:
        """See `ForeignNetwork`."""
        try:
            with bounded_memory():
                answers = self._session.run(None, dict(zip(self.arguments, arguments, strict=True)))
        except Exception as error:  # onnxruntime has errors of its own
            raise InputError("network", "a network that takes its inputs", _first_line(error)) from error
        return dict(zip(self._outputs, answers, strict=True))


def _first_line(error: BaseException) -> str:
    """Returns the line of an error that says what is wrong: the last one of TorchScript's tracebacks."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    for line in reversed(lines):
        if line.startswith(("RuntimeError:", "torch.", "builtins.")):
            return line[:200]
    return (lines[0] if lines else type(error).__name__)[:200]
