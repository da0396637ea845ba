"""The module that a TorchScript archive stores, read as data: class names and tensors, nothing of it is run."""

from __future__ import annotations

import math
import pickletools
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tdcr_planner.archive import Archive
from tdcr_planner.array_schema import Array
from tdcr_planner.errors import FormatError

# A module of a hundred layers takes some 20 KB.
_LONGEST_PICKLE = 1_000_000
_MOST_MODULES = 1_000
_STORAGES: dict[str, np.dtype[Any]] = {"torch FloatStorage": np.dtype("<f4"), "torch DoubleStorage": np.dtype("<f8")}
_PLAIN = ("BINUNICODE", "BININT", "BININT1", "BININT2", "BINFLOAT", "LONG1")
_MARK = object()


@dataclass(frozen=True)
class StoredModule:
    """What an archive says of its module.

    Attributes:
        root: The module's class, as "package.module class".
        classes: Its class and those of the modules in it; TorchScript numbers classes of one name
            (`___torch_mangle_1`).
        tensors: Its tensors, by the names that `state_dict` gives them.
    """

    root: str
    classes: frozenset[str]
    tensors: dict[str, Array]


@dataclass
class StoredObject:
    """An object of the pickle: its class and its attributes by name."""

    name: str
    attributes: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StoredName:
    """A class or function that the archive names; it is never looked up."""

    name: str


@dataclass(frozen=True)
class _Storage:
    """The numbers of one tensor or more."""

    record: str
    dtype: np.dtype[Any]
    count: int


def read_stored_module(archive: Archive, prefix: str) -> StoredModule:
    """Returns the module in a TorchScript archive.

    The archive's pickle is followed by a reader that knows the operations that TorchScript writes and no other. It
    imports nothing and calls nothing: classes are names, objects are tables of attributes.

    Args:
        archive: The archive.
        prefix: Folder in the archive that holds its records.

    Raises:
        FormatError: There is no module, or its pickle does something else than to list attributes and tensors.
    """
    record = f"{prefix}/data.pkl"
    if record not in archive.names:
        raise FormatError(archive.path, "is damaged or no shape model: holds no module", record)
    if archive.size(record) > _LONGEST_PICKLE:
        raise FormatError(archive.path, f"expected at most {_LONGEST_PICKLE:,} bytes", record)
    try:
        return _describe(ModuleReader(archive, prefix).follow(archive.read(record)))
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise FormatError(
            archive.path, f"is damaged, or holds code that this program does not run ({error})", record
        ) from error


def _describe(root: Any) -> StoredModule:
    if not isinstance(root, StoredObject):
        raise ValueError("no module")
    classes, tensors = [], {}
    left = [("", root)]
    while left:
        prefix, module = left.pop()
        classes.append(module.name)
        # An object that is in itself, or thousands of times in others, would never end.
        if len(classes) > _MOST_MODULES:
            raise ValueError(f"more than {_MOST_MODULES} modules")
        for name, value in module.attributes.items():
            if isinstance(value, np.ndarray):
                tensors[prefix + name] = value
            elif isinstance(value, StoredObject):
                left.append((f"{prefix}{name}.", value))
    return StoredModule(root.name, frozenset(classes), tensors)


class ModuleReader:
    """Follows the operations of a pickle on a stack, for the few that TorchScript writes."""

    def __init__(self, archive: Archive, prefix: str) -> None:
        self._archive = archive
        self._prefix = prefix
        self._stack: list[Any] = []
        self._memo: dict[int, Any] = {}
        self._numbers: dict[str, Array] = {}
        self._operations: dict[str, Callable[[Any], None]] = {
            **dict.fromkeys(_PLAIN, self._stack.append),
            "NONE": lambda _: self._stack.append(None),
            "NEWTRUE": lambda _: self._stack.append(True),
            "NEWFALSE": lambda _: self._stack.append(False),
            "MARK": lambda _: self._stack.append(_MARK),
            "PROTO": lambda _: None,
            "GLOBAL": lambda name: self._stack.append(StoredName(name)),
            "EMPTY_TUPLE": lambda _: self._stack.append(()),
            "EMPTY_DICT": lambda _: self._stack.append({}),
            "TUPLE": lambda _: self._stack.append(tuple(self._pop_to_mark())),
            "TUPLE1": lambda _: self._tuple(1),
            "TUPLE2": lambda _: self._tuple(2),
            "TUPLE3": lambda _: self._tuple(3),
            "BINPUT": self._put,
            "LONG_BINPUT": self._put,
            "BINGET": lambda index: self._stack.append(self._memo[index]),
            "LONG_BINGET": lambda index: self._stack.append(self._memo[index]),
            "BINPERSID": lambda _: self._stack.append(self._storage(self._stack.pop())),
            "REDUCE": lambda _: self._reduce(),
            "NEWOBJ": lambda _: self._new_object(),
            "SETITEMS": lambda _: self._set_items(),
            "BUILD": lambda _: self._build(),
        }

    def follow(self, pickle: bytes) -> Any:
        """Returns what the pickle describes."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of escapes in texts that are refused
            for operation, argument, _ in pickletools.genops(pickle):
                if operation.name == "STOP":
                    break
                if operation.name not in self._operations:
                    raise ValueError(f"operation {operation.name}")
                self._operations[operation.name](argument)
        return self._stack.pop()

    def _pop_to_mark(self) -> list[Any]:
        items: list[Any] = []
        while (item := self._stack.pop()) is not _MARK:
            items.append(item)
        return items[::-1]

    def _tuple(self, length: int) -> None:
        items = self._stack[-length:]
        del self._stack[-length:]
        self._stack.append(tuple(items))

    def _put(self, index: int) -> None:
        self._memo[index] = self._stack[-1]

    def _new_object(self) -> None:
        self._stack.pop()
        self._stack.append(StoredObject(self._stack.pop().name))

    def _set_items(self) -> None:
        items = self._pop_to_mark()
        self._stack[-1].update(zip(items[::2], items[1::2], strict=True))

    def _build(self) -> None:
        attributes = self._stack.pop()
        target = self._stack[-1]
        if not isinstance(target, StoredObject) or target.attributes:
            raise ValueError("attributes for what is no object")
        if not isinstance(attributes, dict):
            raise ValueError(f"class {target.name} restores itself by a function of its own")
        target.attributes = {str(name): value for name, value in attributes.items()}

    def _reduce(self) -> None:
        arguments = self._stack.pop()
        function = self._stack.pop().name
        if function == "collections OrderedDict" and arguments == ():
            self._stack.append({})
        elif function == "torch._utils _rebuild_tensor_v2":
            self._stack.append(self._tensor(*arguments))
        else:
            raise ValueError(f"a call of {function}")

    def _storage(self, identifier: Any) -> _Storage:
        kind, dtype, record, _device, count = identifier
        name = dtype.name
        if kind != "storage" or name not in _STORAGES:
            raise ValueError(f"numbers of type {name}, expected float or double")
        return _Storage(f"{self._prefix}/data/{record}", _STORAGES[name], count)

    def _tensor(
        self,
        storage: _Storage,
        offset: int,
        shape: tuple[int, ...],
        strides: tuple[int, ...],
        _requires_grad: bool,
        _hooks: object,
    ) -> Array:
        contiguous = tuple(math.prod(shape[axis + 1 :]) for axis in range(len(shape)))
        count = math.prod(shape)
        whole = storage.count * storage.dtype.itemsize
        if offset != 0 or strides != contiguous or count != storage.count or min(shape, default=0) < 0:
            raise ValueError("a tensor that is not stored as it is")
        if self._archive.size(storage.record) != whole:
            raise ValueError(f"{self._archive.size(storage.record)} bytes in {storage.record}, expected {whole}")
        # Read once, however many tensors name it.
        if storage.record not in self._numbers:
            self._numbers[storage.record] = np.frombuffer(self._archive.read(storage.record), storage.dtype)
        return self._numbers[storage.record].reshape(shape)
