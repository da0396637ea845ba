"""The ONNX file of a foreign network, read as data: which operators it names, and where its numbers lie."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tdcr_planner.errors import FormatError, MissingLibraryError
from tdcr_planner.inputs import open_file
from tdcr_planner.shape.memory_guard import bounded_memory
from tdcr_planner.shape.script_archive import MOST_BYTES
from tdcr_planner.shape.script_rules import names_in

_DOMAINS = ("", "ai.onnx")
# Values at random, and operators that train.
_REFUSED = names_in(
    """
    Bernoulli Multinomial RandomNormal RandomNormalLike RandomUniform RandomUniformLike Gradient
    """
)
_MOST_NODES = 200_000


def check_onnx(path: Path, content: bytes | None = None) -> bytes:
    """Returns an ONNX model that holds all of its numbers and standard operators alone.

    Args:
        path: The file, or the model file that holds it; numbers outside of the file must lie beside it.
        content: The model's bytes, where it is a record of a model file; None reads the file.

    Raises:
        FormatError: The file is missing, damaged or too large, names other operators, or numbers in other places.
        MissingLibraryError: onnx is not installed.
    """
    onnx = _library("onnx")
    beside = content is None
    if content is None:
        with open_file(path) as stream:
            content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise FormatError(path, f"expected at most {MOST_BYTES:,} bytes for an ONNX file")
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # protobuf has errors of its own
        raise FormatError(path, f"is damaged or no ONNX file ({type(error).__name__})") from error
    if not model.graph.node:
        raise FormatError(path, "is damaged or no ONNX file: it has no operators")
    for graph in _graphs(path, model):
        for tensor in (*graph.initializer, *_constants(graph)):
            _take_in(path, tensor, beside=beside)
    return bytes(model.SerializeToString())


def _library(name: str) -> Any:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingLibraryError(
            name, "to read ONNX files (pip install 'tdcr-planner[onnx]')", "every system that torch runs on"
        ) from error


def onnx_session(path: Path, content: bytes) -> Any:
    """Returns what runs a checked model.

    Raises:
        FormatError: onnxruntime does not take it.
        MissingLibraryError: onnxruntime is not installed.
    """
    runtime = _library("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        # It computes constants already.
        with bounded_memory():
            return runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has errors of its own
        raise FormatError(path, f"onnxruntime does not take it: {str(error)[:200]}") from error


def _graphs(path: Path, model: Any) -> list[Any]:
    """Returns the model's graph and those inside of its operators and functions, each checked for what it names."""
    found, left, count = [], [model.graph], 0
    functions = {(function.domain, function.name) for function in model.functions}
    nodes_of_functions = [node for function in model.functions for node in function.node]
    for opset in model.opset_import:
        own = any(domain == opset.domain for domain, _ in functions)
        if opset.domain not in _DOMAINS and not own and _uses(model, opset.domain):
            raise FormatError(path, f"names operators of {opset.domain!r}, expected the standard ones alone")
    while left:
        graph = left.pop()
        found.append(graph)
        for node in (*graph.node, *(nodes_of_functions if graph is model.graph else ())):
            count += 1
            if count > _MOST_NODES:
                raise FormatError(path, f"expected at most {_MOST_NODES:,} operators")
            foreign = node.domain not in _DOMAINS and (node.domain, node.op_type) not in functions
            if foreign or node.op_type in _REFUSED:
                name = f"{node.domain}.{node.op_type}" if node.domain else node.op_type
                raise FormatError(path, f"names an operator that this program does not run: {name}")
            for attribute in node.attribute:
                left += [attribute.g] if attribute.HasField("g") else []
                left += list(attribute.graphs)
    return found


def _uses(model: Any, domain: str) -> bool:
    return any(node.domain == domain for node in model.graph.node)


def _constants(graph: Any) -> list[Any]:
    return [
        tensor
        for node in graph.node
        for attribute in node.attribute
        for tensor in ([attribute.t] if attribute.HasField("t") else []) + list(attribute.tensors)
    ]


def _take_in(path: Path, tensor: Any, *, beside: bool) -> None:
    """Reads a tensor's numbers from the file beside the model into it; any other place is refused."""
    if not tensor.external_data and tensor.data_location != tensor.EXTERNAL:
        return
    entries = {entry.key: entry.value for entry in tensor.external_data}
    location = entries.get("location", "")
    file = path.parent / location
    plain = location not in ("", ".", "..") and Path(location).name == location and "\\" not in location
    if not beside or not plain or file.is_symlink() or not file.is_file():
        raise FormatError(
            path, f"names numbers in {location!r}, expected a file that lies beside it", f"tensor {tensor.name!r}"
        )
    try:
        offset, length = int(entries.get("offset", 0)), int(entries.get("length", -1))
    except ValueError as error:
        raise FormatError(path, "expected whole numbers for the place of numbers", f"tensor {tensor.name!r}") from error
    size = file.stat().st_size
    length = size - offset if length < 0 else length
    if offset < 0 or length < 0 or offset + length > size or length > MOST_BYTES:
        raise FormatError(path, f"names numbers beyond the {size:,} bytes of {location}", f"tensor {tensor.name!r}")
    with open_file(file) as stream:
        stream.seek(offset)
        tensor.raw_data = stream.read(length)
    del tensor.external_data[:]
    tensor.data_location = tensor.DEFAULT
