"""The model file: card, weights and tensors of a TorchScript archive, read as data without running any of it."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tdcr_planner.archive import Archive, open_archive
from tdcr_planner.array_schema import Array, ArraySchema, ArraySpec, read_arrays
from tdcr_planner.errors import FormatError
from tdcr_planner.files import parse_table
from tdcr_planner.json_text import parse_json
from tdcr_planner.shape.card import ModelCard
from tdcr_planner.shape.foreign_network import MODULE_FILES
from tdcr_planner.shape.script_archive import MOST_BYTES
from tdcr_planner.shape.shooting import MOST_CORRECTIONS, MOST_LAYERS, MOST_WIDTH, ShootingWeights
from tdcr_planner.shape.stored_module import StoredModule, read_stored_module

Engine = Literal["compiled", "torchscript", "onnx"]
"""What evaluates a model: machine code of this project, torch, or onnxruntime."""

CARD_FILE = "card.json"
WEIGHTS_FILE = "weights.npz"

# The weights twice, as tensors and as arrays, and as much again.
_MOST_BYTES = 4 * 4 * MOST_LAYERS * MOST_WIDTH**2
_HEAD = 27

# The networks under the names of the modules that have held them.
_NETWORKS = {
    "__torch__.tdcr_planner.learning.network ShootingNetwork": "shooting",
    "__torch__.tdcr_planner.shape.shooting_network ShootingNetwork": "shooting",
    "__torch__.tdcr_planner.learning.paper_network PaperNetwork": "paper",
    "__torch__.tdcr_planner.shape.paper_network PaperNetwork": "paper",
}
_LAYER = re.compile(r"__torch__\.torch\.nn\.modules\.(container|linear) (ModuleList|Linear)")
# What TorchScript puts into the name of a class that it has met before in the same process.
_MANGLE = re.compile(r"\.___torch_mangle_\d+(?= )")


@dataclass(frozen=True)
class ModelFile:
    """What a model file holds.

    Attributes:
        card: The card.
        weights: The weights of a `shooting` network; None for another.
        tensors: The tensors of the stored module, by the names of its `state_dict`.
        foreign: The bytes of an adopted network, which has neither weights nor tensors here; None for another.
    """

    card: ModelCard
    weights: ShootingWeights | None
    tensors: dict[str, Array]
    foreign: bytes | None = None

    @property
    def engines(self) -> tuple[Engine, ...]:
        """What can evaluate it, the fastest first."""
        if self.card.adoption is not None:
            return (self.card.adoption.kind,)
        return ("torchscript",) if self.weights is None else ("compiled", "torchscript")


def read_model_file(path: Path) -> ModelFile:
    """Returns what a model file holds, without torch, whose import takes seconds.

    Raises:
        FormatError: The file is missing, damaged or no shape model, or holds another module than this project writes.
    """
    with open_archive(path, "shape model", max(_MOST_BYTES, MOST_BYTES)) as archive:
        archive.check_all()
        prefix = _find_prefix(archive)
        content = parse_json(archive.read(f"{prefix}/extra/{CARD_FILE}"), path, CARD_FILE)
        card = parse_table(ModelCard, content, path)
        if card.adoption is not None:
            return ModelFile(card, None, {}, _read_foreign(archive, prefix, card))
        module = read_stored_module(archive, prefix)
        _check_classes(path, module, card)
        weights = None
        if card.network == "shooting":
            record = f"{prefix}/extra/{WEIGHTS_FILE}"
            if record not in archive.names:
                raise FormatError(path, f"holds no {WEIGHTS_FILE}, which the planner reads")
            weights = _read_weights(path, archive.read(record), card)
        return ModelFile(card, weights, module.tensors)


def _find_prefix(archive: Archive) -> str:
    """Returns the folder in the archive that holds all of its records, as torch writes them."""
    prefixes = {name.split("/", 1)[0] for name in archive.names}
    prefix = min(prefixes, default="")
    if len(prefixes) != 1 or f"{prefix}/extra/{CARD_FILE}" not in archive.names:
        raise FormatError(
            archive.path, "is not a shape model, or is truncated: it holds no card; make one with `tdcr train`"
        )
    return prefix


def _read_foreign(archive: Archive, prefix: str, card: ModelCard) -> bytes:
    """Returns the network of an adopted model; what it does is checked when it is loaded."""
    assert card.adoption is not None  # the card of an adopted network has it
    record = f"{prefix}/extra/{MODULE_FILES[card.adoption.kind]}"
    if record not in archive.names:
        raise FormatError(archive.path, "holds no network, which its card says it has", record)
    content = archive.read(record)
    if hashlib.sha256(content).hexdigest() != card.adoption.module_sha256:
        raise FormatError(
            archive.path, "holds another network than the one that was adopted; adopt it with `tdcr adopt`", record
        )
    return content


def _check_classes(path: Path, module: StoredModule, card: ModelCard) -> None:
    """Refuses a module of foreign classes: what it computes is not what this program would answer."""
    root = _MANGLE.sub("", module.root)
    classes = {_MANGLE.sub("", name) for name in module.classes}
    foreign = sorted(name for name in classes if name not in _NETWORKS and not _LAYER.fullmatch(name))
    if foreign or root not in _NETWORKS:
        name = (foreign or [root])[0].removeprefix("__torch__.")
        raise FormatError(
            path, f"holds code that this program does not run: class {name}, expected a model that `tdcr train` wrote"
        )
    if _NETWORKS[root] != card.network:
        raise FormatError(
            path, f"its card is of network {card.network!r}, its module is of network {_NETWORKS[root]!r}"
        )


def _read_weights(path: Path, content: bytes, card: ModelCard) -> ShootingWeights:
    robot = card.robot
    sizes = {"inputs": robot.tendon_count + 7, "width 0": 3 * robot.segment_count + 6}
    arrays, sizes = read_arrays(path, _weights_schema(), sizes, content)
    layers = int(arrays["layers"])
    expected = {f"{kind}_{index}" for kind in ("matrix", "bias") for index in range(layers)}
    if {name for name in arrays if name.startswith(("matrix_", "bias_"))} != expected:
        raise FormatError(path, f"expected {layers} layers, each with a matrix and a bias", WEIGHTS_FILE)
    if sizes[f"width {layers}"] != _HEAD:
        raise FormatError(
            path, f"expected {_HEAD} outputs of the last layer, got {sizes[f'width {layers}']}", WEIGHTS_FILE
        )
    return ShootingWeights(
        features=arrays["features"],
        load_scale=arrays["load_scale"],
        matrices=tuple(arrays[f"matrix_{index}"] for index in range(layers)),
        biases=tuple(arrays[f"bias_{index}"] for index in range(layers)),
        corrections=int(arrays["corrections"]),
    )


def _weights_schema() -> ArraySchema:
    arrays = {
        "layers": ArraySpec("integer", low=2, high=MOST_LAYERS),
        "corrections": ArraySpec("integer", low=0, high=MOST_CORRECTIONS),
        "features": ArraySpec("float32", ("width 0", "inputs")),
        "load_scale": ArraySpec("float32", (6,), low=0.0),
    }
    for index in range(MOST_LAYERS):
        shape = (f"width {index + 1}", f"width {index}")
        arrays[f"matrix_{index}"] = ArraySpec("float32", shape, required=False)
        arrays[f"bias_{index}"] = ArraySpec("float32", shape[:1], required=False)
    return ArraySchema(WEIGHTS_FILE, arrays, {f"width {index}": MOST_WIDTH for index in range(MOST_LAYERS + 1)})
