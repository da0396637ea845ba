"""Damaged and absurd inputs: changes of text, tables, arrays and bytes, each with what a schema says of it."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

Random = np.random.Generator
# What must come of an input: exit code 2; the outcome of the whole file or exit code 2; anything but a fault.
REFUSED, SAME, ANY = "refused", "same", "any"
Change = tuple[bytes, str, str]
"""Content, what must come of it, and what was changed."""


class Raw(str):
    """Text that stands in a file as it is: a number that Python cannot write, or what is no value at all."""


_DEEP = Raw("[" * 5000 + "]" * 5000)
_NO_NUMBERS = (True, "1", "", [], {}, [1.0], Raw("9" * 5000), Raw("1e308"), Raw("-1e308"), Raw("1e999"), 1e40, _DEEP)
_NO_TEXT = (True, 1, 2.5, [], {}, ["a"], Raw("9" * 5000), _DEEP)
_NO_BOOLEANS = (1, 0.0, "true", [], {}, Raw("9" * 5000))
_NO_CONTAINERS = (5, "x", True, 1.5)


def change_table(content: dict[str, Any], random: Random, write: Callable[[Any], str], free: tuple[str, ...]) -> Change:
    """Returns a table with one value that its schema does not allow, or an unknown key.

    Args:
        content: The table; every leaf must have the type that the schema asks for.
        random: Decides what is changed.
        write: The table as text.
        free: Names of tables that may hold anything.
    """
    changed = json.loads(json.dumps(content))
    places = list(_places(changed, free))
    holder, key, value = places[random.integers(len(places))]
    if isinstance(holder, dict) and random.random() < 0.1:
        holder["unknown_key"] = []  # nor may a table of any names hold a list
        return write(changed).encode(), REFUSED, "unknown key"
    forbidden: tuple[Any, ...]
    if isinstance(value, bool):
        forbidden = _NO_BOOLEANS
    elif isinstance(value, int | float):
        forbidden = _NO_NUMBERS
    else:
        forbidden = _NO_TEXT if isinstance(value, str) else _NO_CONTAINERS
    holder[key] = forbidden[random.integers(len(forbidden))]
    return write(changed).encode("utf-8", "surrogatepass"), REFUSED, f"{key} = {holder[key]!r:.40}"


def _places(value: Any, free: tuple[str, ...]) -> Iterator[tuple[Any, Any, Any]]:
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            if key not in free:
                if item is not None:
                    yield value, key, item
                yield from _places(item, free)


def write_json(value: Any) -> str:
    """Returns a table as JSON, raw texts as they are."""
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)}: {write_json(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(write_json, value)) + "]"
    return json.dumps(value)


def write_toml(table: dict[str, Any]) -> str:
    """Returns a table as TOML, raw texts as they are."""
    return "".join(f"{json.dumps(key)} = {_toml_value(value)}\n" for key, value in table.items())


def _toml_value(value: Any) -> str:
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    return json.dumps(value)


_SNIPPETS = (
    b"\0",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"NaN",
    b"-1",
    b"1e308",
    b"9" * 400,
    b"[" * 3000,
    b'"',
    b"\\ud800",
    b"\n",
)


def change_text(content: bytes, random: Random) -> Change:
    """Returns a text with bytes flipped, cut, doubled, moved, or foreign bytes in it."""
    place = int(random.integers(len(content) + 1))
    length = int(random.integers(1, 40))
    kind = int(random.integers(5))
    if kind == 0:
        changed = bytearray(content)
        for _ in range(int(random.integers(1, 4))):
            changed[random.integers(len(content))] ^= 1 << int(random.integers(8))
        return bytes(changed), ANY, "bits flipped"
    if kind == 1:
        return content[:place], ANY, f"cut at {place}"
    if kind == 2:
        return content[:place] + content[place + length :], ANY, f"{length} bytes left out"
    if kind == 3:
        return content[:place] + content[max(place - length, 0) :], ANY, f"{length} bytes twice"
    snippet = _SNIPPETS[random.integers(len(_SNIPPETS))]
    return content[:place] + snippet + content[place:], ANY, f"{snippet[:8]!r} put in"


def damage(content: bytes, random: Random) -> Change:
    """Returns a binary file with bits flipped, or cut short."""
    if random.random() < 0.3:
        place = int(random.integers(len(content)))
        return content[:place], SAME, f"cut at {place}"
    changed = bytearray(content)
    for _ in range(int(random.integers(1, 3))):
        changed[random.integers(len(content))] ^= 1 << int(random.integers(8))
    return bytes(changed), SAME, "bits flipped"


def change_arrays(arrays: dict[str, Any], random: Random) -> tuple[dict[str, Any], str]:
    """Returns arrays of which one is what no schema allows: type, shape, value, missing or too many."""
    changed = dict(arrays)
    names = [name for name, array in arrays.items() if np.asarray(array).dtype.kind in "fi"]
    name = names[random.integers(len(names))]
    array = np.array(arrays[name])
    kinds: dict[str, Callable[[], Any]] = {
        "text": lambda: array.astype(str),
        "complex": lambda: array.astype(np.complex128),
        "half precision": lambda: array.astype(np.float16),
        "objects": lambda: array.astype(object),
        "dates": lambda: array.astype("datetime64[s]"),
        "one axis more": lambda: array[None],
        "flat": lambda: array.ravel() if array.ndim > 1 else array[None],
        "records": lambda: np.zeros(array.shape, dtype=[("a", "f8"), ("b", "f8")]),
    }
    if array.dtype.kind == "f":
        kinds["infinite"] = lambda: np.full_like(array, np.inf)
    kind = ["missing", "unknown", *kinds][random.integers(len(kinds) + 2)]
    if kind == "missing":
        del changed[name]
    elif kind == "unknown":
        changed["unknown_array"] = array
    else:
        changed[name] = kinds[kind]()
    return changed, f"{name}: {kind}"


def npz_bytes(arrays: dict[str, Any]) -> bytes:
    """Returns arrays as an NPZ file, pickled objects included."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def lying_npz(arrays: dict[str, Any], random: Random) -> bytes:
    """Returns an NPZ file one of whose headers promises more numbers than there are: terabytes."""
    buffer = io.BytesIO()
    chosen = list(arrays)[random.integers(len(arrays))]
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            record = io.BytesIO()
            np.lib.format.write_array(record, np.asarray(array))
            content = record.getvalue()
            if name == chosen:
                shape = repr(np.asarray(array).shape).encode()
                more = b"(999999999999,)" if len(shape) < 15 else b"(" + b"9" * (len(shape) - 3) + b",)"
                content = content[:128].replace(shape, more)[:127] + b"\n" + content[128:]
            archive.writestr(f"{name}.npy", content)
    return buffer.getvalue()


def replace_records(archive: bytes, changes: dict[str, bytes | None], method: int = zipfile.ZIP_STORED) -> bytes:
    """Returns a zip file with some records replaced by the end of their names, or left out for None."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(archive)) as source, zipfile.ZipFile(buffer, "w", method) as target:
        for name in source.namelist():
            found = [end for end in changes if name.endswith(end)]
            content = changes[found[0]] if found else source.read(name)
            if content is not None:
                target.writestr(name, content)
    return buffer.getvalue()
