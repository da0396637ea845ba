"""The TorchScript archive of a foreign module: checked record by record as data, and written anew for torch to load."""

from __future__ import annotations

import io
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.archive import Archive, open_archive
from tdcr_planner.array_schema import Array
from tdcr_planner.errors import FormatError
from tdcr_planner.shape.script_source import check_source
from tdcr_planner.shape.stored_module import ModuleReader, StoredName, StoredObject

MOST_BYTES = 512 * 1024**2
"""Of an archive or model: 64 million weights in single precision and as much again. A planner's shapes need less."""
_LONGEST_PICKLE = 4_000_000
_MOST_OBJECTS = 10_000
_SIZES = {
    "torch FloatStorage": 4, "torch DoubleStorage": 8, "torch HalfStorage": 2, "torch BFloat16Storage": 2,
    "torch LongStorage": 8, "torch IntStorage": 4, "torch ShortStorage": 2, "torch CharStorage": 1,
    "torch ByteStorage": 1, "torch BoolStorage": 1,
}  # fmt: skip
_LISTS = frozenset(
    f"torch.jit._pickle {name}" for name in ("build_intlist", "build_tensorlist", "build_doublelist", "build_boollist")
)
_TAG = "torch.jit._pickle restore_type_tag"
# The text of a type that a list or table is marked with; torch's parser of types reads it.
_TAG_TEXT = re.compile(r"(?:Tensor|int|float|bool|str|List|Dict|Tuple|Optional|NoneType|[\[\], ])*\Z")
_NAME_TEXT = re.compile(r"[A-Za-z0-9_.]+ [A-Za-z0-9_]+\Z")
_VERSION_TEXT = re.compile(rb"[0-9]{1,4}\n?\Z")


@dataclass(frozen=True)
class CheckedScript:
    """A module that does nothing but compute.

    Attributes:
        content: A TorchScript archive of it, written from what was checked.
        root: The class of the module, as "__torch__.package.Class".
        arguments: The names of the arguments of its `forward`.
        weights: How many numbers its tensors hold.
    """

    content: bytes
    root: str
    arguments: tuple[str, ...]
    weights: int


def check_script(path: Path, content: bytes | None = None) -> CheckedScript:
    """Returns a TorchScript module that torch may load, or refuses it; nothing of the file is run.

    Args:
        path: The file, or the model file that holds it.
        content: The archive's bytes, where it is a record of another archive; None reads the file.

    Raises:
        FormatError: The file is missing or damaged, or its code or data do more than to compute shapes.
    """
    with open_archive(path, "TorchScript module", MOST_BYTES, content) as archive:
        archive.check_all()
        prefix = _find_prefix(archive)
        files = {
            name.removeprefix(f"{prefix}/code/"): _text(archive, name)
            for name in archive.names
            if name.startswith(f"{prefix}/code/") and name.endswith(".py")
        }
        source = check_source(path, files)
        defined = {_full(name, text) for name, text in source.files.items()}
        names = frozenset().union(*defined) if defined else frozenset()
        root, weights = _check_pickles(archive, prefix, names)
        if root not in source.arguments:
            raise FormatError(path, f"holds no function `forward` of its module {root}")
        return CheckedScript(_write(archive, prefix, source.files), root, source.arguments[root], weights)


def _find_prefix(archive: Archive) -> str:
    prefixes = {name.split("/", 1)[0] for name in archive.names}
    prefix = min(prefixes, default="")
    if len(prefixes) != 1 or not {f"{prefix}/data.pkl", f"{prefix}/constants.pkl"} <= set(archive.names):
        raise FormatError(archive.path, "is no TorchScript module: expected what `torch.jit.save` writes")
    return prefix


def _text(archive: Archive, name: str) -> str:
    try:
        return archive.read(name).decode("ascii")
    except UnicodeDecodeError as error:
        raise FormatError(archive.path, "expected code of printable ASCII characters", name) from error


def _full(name: str, text: str) -> frozenset[str]:
    package = name.removesuffix(".py").replace("/", ".")
    return frozenset(f"{package}.{found}" for found in re.findall(r"^class (\w+)", text, re.MULTILINE))


def _check_pickles(archive: Archive, prefix: str, classes: frozenset[str]) -> tuple[str, int]:
    """Reads both pickles as data; returns the module's class and how many numbers it holds."""
    found: list[Any] = []
    weights = 0
    for record, folder in (("data", "data"), ("constants", "constants")):
        name = f"{prefix}/{record}.pkl"
        if archive.size(name) > _LONGEST_PICKLE:
            raise FormatError(archive.path, f"expected at most {_LONGEST_PICKLE:,} bytes", name)
        reader = _ForeignReader(archive, f"{prefix}/{folder}", classes)
        try:
            found.append(reader.follow(archive.read(name)))
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise FormatError(
                archive.path, f"is damaged, or holds code that this program does not run ({error})", name
            ) from error
        weights += reader.numbers
    root, constants = found
    if not isinstance(root, StoredObject) or not isinstance(constants, tuple):
        raise FormatError(archive.path, "expected a module", f"{prefix}/data.pkl")
    return root.name.replace(" ", "."), weights


class _ForeignReader(ModuleReader):
    """Follows the pickle of any module: objects of the archive's classes, tensors, lists, tables and plain values."""

    def __init__(self, archive: Archive, folder: str, classes: frozenset[str]) -> None:
        super().__init__(archive, folder)
        self.numbers = 0
        self._classes = classes
        self._objects = 0
        self._counted: set[str] = set()
        self._operations |= {
            "EMPTY_LIST": lambda _: self._stack.append([]),
            "APPEND": lambda _: self._append([self._stack.pop()]),
            "APPENDS": lambda _: self._append(self._pop_to_mark()),
            "SETITEM": lambda _: self._set_item(),
        }

    def _append(self, items: list[Any]) -> None:
        target = self._stack[-1]
        if not isinstance(target, list):
            raise ValueError("items for what is no list")
        target.extend(items)

    def _set_item(self) -> None:
        value, name = self._stack.pop(), self._stack.pop()
        self._stack[-1][name] = value

    def _new_object(self) -> None:
        arguments = self._stack.pop()
        name = self._stack.pop().name
        self._objects += 1
        if arguments != () or not _NAME_TEXT.match(name) or name.replace(" ", ".") not in self._classes:
            raise ValueError(f"an object of class {name}, which the archive does not define")
        if self._objects > _MOST_OBJECTS:
            raise ValueError(f"more than {_MOST_OBJECTS:,} objects")
        self._stack.append(StoredObject(name))

    def _reduce(self) -> None:
        arguments = self._stack.pop()
        function = self._stack.pop().name
        if (function in _LISTS and len(arguments) == 1 and isinstance(arguments[0], list)) or (
            function == _TAG and len(arguments) == 2 and _TAG_TEXT.match(arguments[1])
        ):
            self._stack.append(arguments[0])
        else:
            self._stack.extend((StoredName(function), arguments))
            super()._reduce()

    def _storage(self, identifier: Any) -> Any:
        kind, dtype, record, device, count = identifier
        if kind != "storage" or dtype.name not in _SIZES or not re.fullmatch(r"\d{1,9}", record) or count < 0:
            raise ValueError(f"numbers of type {dtype.name} in record {record!r}")
        if not re.fullmatch(r"cpu|cuda(:\d{1,2})?", device):
            raise ValueError(f"numbers on device {device!r}")
        name = f"{self._prefix}/{record}"
        if self._archive.size(name) != count * _SIZES[dtype.name]:
            raise ValueError(f"{self._archive.size(name)} bytes in {name}, expected {count * _SIZES[dtype.name]}")
        if name not in self._counted:
            self._counted.add(name)
            self.numbers += count
        return count

    def _tensor(
        self,
        storage: Any,
        offset: int,
        shape: tuple[int, ...],
        strides: tuple[int, ...],
        _requires_grad: bool,
        _hooks: object,
    ) -> Array:
        if len(shape) != len(strides) or offset < 0 or min((*shape, *strides), default=0) < 0:
            raise ValueError("a tensor of no possible shape")
        last = offset + sum((length - 1) * stride for length, stride in zip(shape, strides, strict=True))
        if min(shape, default=1) > 0 and last >= storage:
            raise ValueError("a tensor that reaches beyond its numbers")
        if _hooks != {}:
            raise ValueError("a tensor with hooks")
        return np.empty(0)


def _write(archive: Archive, prefix: str, files: dict[str, str]) -> bytes:
    """Returns an archive of the checked text and of the records that the pickles name, without any other."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as target:

        def add(name: str, content: bytes | str) -> None:
            target.writestr(zipfile.ZipInfo(f"{prefix}/{name}"), content)

        for record in ("data.pkl", "constants.pkl"):
            add(record, archive.read(f"{prefix}/{record}"))
        for name in archive.names:
            short = name.removeprefix(f"{prefix}/")
            if re.fullmatch(r"(data|constants)/\d{1,9}", short):
                add(short, archive.read(name))
            elif short in ("version", ".data/version"):
                version = archive.read(name)
                if not _VERSION_TEXT.match(version):
                    raise FormatError(archive.path, "expected the number of a version", name)
                add(short, version)
            elif short == "byteorder":
                if archive.read(name) != b"little":
                    raise FormatError(archive.path, "expected numbers in little-endian order", name)
                add(short, b"little")
        for name, text in sorted(files.items()):
            add(f"code/{name}", text)
    return buffer.getvalue()
