"""The torch module of a model file, built from this project's classes and the file's numbers."""

from __future__ import annotations

import copy
import re
import warnings
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tdcr_planner.array_schema import Array, ArraySchema, ArraySpec, check_arrays
from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.shape.card import ModelCard
from tdcr_planner.shape.paper_network import PaperNetwork
from tdcr_planner.shape.shooting import MOST_LAYERS, MOST_WIDTH, ShootingWeights
from tdcr_planner.shape.shooting_network import ShootingNetwork

# Arc lengths are stored in single precision.
_ROUNDING = 1e-6


def script_module(network: nn.Module) -> torch.jit.ScriptModule:
    """Returns a network as TorchScript on the CPU, with constant weights: gradients by the inputs remain."""
    network = copy.deepcopy(network).cpu().eval().requires_grad_(False)
    with warnings.catch_warnings():
        # TorchScript is the model format; torch deprecates it without a replacement that C++ can load.
        warnings.filterwarnings("ignore", message=r"`torch\.jit\..*` is deprecated", category=DeprecationWarning)
        return torch.jit.script(network)


def shooting_module(card: ModelCard, weights: ShootingWeights) -> torch.jit.ScriptModule:
    """Returns the module of a `shooting` model; its weights have been checked against the card's robot."""
    hidden = tuple(len(bias) for bias in weights.biases[:-1])
    domain = card.domain
    # Tensors made in inference mode could never be used for gradients, and the module is kept.
    with torch.inference_mode(False):
        network = ShootingNetwork(card.robot, hidden, weights.corrections, domain.gravity_m_s2, domain.tip_force_n)
        network.features.copy_(_tensor(weights.features))
        network.load_scale.copy_(_tensor(weights.load_scale))
        layers = [layer for layer in (*network.layers, network.head) if isinstance(layer, nn.Linear)]
        with torch.no_grad():
            for layer, matrix, bias in zip(layers, weights.matrices, weights.biases, strict=True):
                layer.weight.copy_(_tensor(matrix))
                layer.bias.copy_(_tensor(bias))
        return script_module(network)


def to_device(module: torch.jit.ScriptModule, device: str) -> torch.jit.ScriptModule:
    """Returns a module on a device.

    Raises:
        InputError: It is a GPU, and torch has none.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("shape_device", "cpu, as there is no GPU that torch can use", device)
    return module.to(device)


def ask(
    module: torch.jit.ScriptModule, device: str, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns positions (n, d, 3) m and rotations (n, d, 3, 3) of a module whose `forward` is this project's."""
    with torch.inference_mode():
        positions, rotations = module(*_inputs(device, tensions, gravity, tip_force))
    return positions.cpu().numpy(), rotations.cpu().numpy()


def ask_with_residual(
    module: torch.jit.ScriptModule, device: str, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns the same of a `shooting` module, and the moment left over at the tip (n,), N m; `forward` in steps."""
    with torch.inference_mode():
        tension, g, f = _inputs(device, tensions, gravity, tip_force)
        moment, inverse = module.base_moment(tension, g, f)
        for _ in range(module.corrections):
            left_over = module.shoot(tension, g, f, moment)[0]
            moment = moment - torch.matmul(inverse, left_over.unsqueeze(2)).squeeze(2)
        left_over, positions, rotations = module.shoot(tension, g, f, moment)
        residual = torch.linalg.vector_norm(left_over, dim=1)
    return positions.cpu().numpy(), rotations.cpu().numpy(), residual.cpu().numpy()


def _inputs(device: str, *arrays: FloatArray) -> list[torch.Tensor]:
    # One load for all rows is a view that torch could not write to, of which it warns.
    return [torch.from_numpy(np.require(array, requirements=("C", "W"))).to(device) for array in arrays]


def paper_module(path: Path, card: ModelCard, tensors: dict[str, Array]) -> torch.jit.ScriptModule:
    """Returns the module of a `paper` model.

    Args:
        path: The model file, for messages.
        card: Its card.
        tensors: Its tensors by the names of `PaperNetwork.state_dict`.

    Raises:
        FormatError: The tensors are not those of this network for the card's robot.
    """
    count = sum(re.fullmatch(r"layers\.\d+\.weight", name) is not None for name in tensors)
    sizes = check_arrays(path, _paper_schema(count), tensors, {"tendons": card.robot.tendon_count, "width 0": 3})
    with torch.inference_mode(False):
        try:
            network = PaperNetwork(card.robot, tuple(sizes[f"width {index + 1}"] for index in range(count)))
        except InputError as error:
            raise FormatError(path, f"its card's robot is none of the `paper` network: {error}") from error
        for name in ("directions", "stops"):
            own = network.state_dict()[name].numpy()
            if tensors[name].shape != own.shape or not np.allclose(tensors[name], own, rtol=_ROUNDING, atol=_ROUNDING):
                raise FormatError(path, "expected the values of the robot in the card", name)
        network.load_state_dict({name: _tensor(array) for name, array in tensors.items()})
        return script_module(network)


def _paper_schema(layers: int) -> ArraySchema:
    arrays = {
        "directions": ArraySpec("float64", ("tendons", 2)),
        "stops": ArraySpec("float32", ("disks",)),
        "head.weight": ArraySpec("float32", (9, f"width {layers}")),
        "head.bias": ArraySpec("float32", (9,)),
    }
    for index in range(min(layers, MOST_LAYERS)):
        arrays[f"layers.{index}.weight"] = ArraySpec("float32", (f"width {index + 1}", f"width {index}"))
        arrays[f"layers.{index}.bias"] = ArraySpec("float32", (f"width {index + 1}",))
    widths = {f"width {index}": MOST_WIDTH for index in range(layers + 1)}
    return ArraySchema("`paper` network", arrays, {"tendons": 3, "disks": 10_000, **widths})


def _tensor(array: Array) -> torch.Tensor:
    return torch.from_numpy(np.array(array))
