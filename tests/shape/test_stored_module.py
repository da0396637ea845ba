"""Pickles of stored modules: followed as data, and refused where they do anything else."""

from __future__ import annotations

import contextlib
import io
import pickle
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.archive import open_archive
from tdcr_planner.errors import FormatError
from tdcr_planner.shape.stored_module import StoredModule, read_stored_module

HEAD = b"\x80\x02c__torch__.net\nNet\n)\x81}("
TAIL = b"ub."


def read(content: bytes, **records: bytes) -> StoredModule:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("a/data.pkl", content)
        for name, numbers in records.items():
            archive.writestr(f"a/data/{name}", numbers)
    with open_archive("a.pt", "shape model", 10_000_000, buffer.getvalue()) as opened:
        return read_stored_module(opened, "a")


def text(value: str) -> bytes:
    return b"X" + struct.pack("<i", len(value)) + value.encode()


def tensor(record: str, count: int, shape: tuple[int, ...], strides: tuple[int, ...], kind: str = "Float") -> bytes:
    def numbers(values: tuple[int, ...]) -> bytes:
        return b"(" + b"".join(b"J" + struct.pack("<i", value) for value in values) + b"t"

    storage = b"(" + text("storage") + f"ctorch\n{kind}Storage\n".encode() + text(record) + text("cpu")
    storage += b"J" + struct.pack("<i", count) + b"tQ"
    hooks = b"ccollections\nOrderedDict\n)R"
    layout = b"K\0" + numbers(shape) + numbers(strides)
    return b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage + layout + b"\x89" + hooks + b"tR"


def test_attributes_and_tensors_are_listed() -> None:
    inner = b"c__torch__.net\nLayer\n)\x81}(" + text("weight") + tensor("0", 6, (2, 3), (3, 1)) + b"ub"
    values = np.arange(6, dtype="<f4")
    module = read(HEAD + text("layer") + inner + text("size") + b"K\x05" + TAIL, **{"0": values.tobytes()})
    assert module.root == "__torch__.net Net"
    assert module.classes == {"__torch__.net Net", "__torch__.net Layer"}
    assert list(module.tensors) == ["layer.weight"]
    np.testing.assert_array_equal(module.tensors["layer.weight"], values.reshape(2, 3))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (HEAD + text("x") + tensor("0", 6, (2, 3), (1, 2)) + TAIL, "not stored as it is"),
        (HEAD + text("x") + tensor("0", 6, (2, 4), (4, 1)) + TAIL, "not stored as it is"),
        (HEAD + text("x") + tensor("0", 6, (-2, -3), (-3, 1)) + TAIL, "not stored as it is"),
        (HEAD + text("x") + tensor("0", 7, (7,), (1,)) + TAIL, "24 bytes"),
        (HEAD + text("x") + tensor("1", 6, (6,), (1,)) + TAIL, "a/data/1"),
        (HEAD + text("x") + tensor("0", 6, (6,), (1,), "Half") + TAIL, "expected float or double"),
        # A class that sets itself up by a function of its own.
        (b"\x80\x02c__torch__.net\nNet\n)\x81(K\x01tb.", "restores itself"),
        # A module that is in itself.
        (b"\x80\x02c__torch__.net\nNet\n)\x81q\0}(" + text("me") + b"h\0" + TAIL, "more than 1000 modules"),
        (b"\x80\x02cos\nsystem\n(" + text("true") + b"tR.", "a call of os system"),
        (b"\x80\x02K\x05.", "no module"),
        (b"\x80\x02.", "pop"),
        (HEAD, "damaged"),
        (b"", "damaged"),
    ],
)
def test_what_is_no_list_of_attributes_is_refused(content: bytes, words: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(content, **{"0": bytes(24)})
    assert "a.pt: a/data.pkl" in str(caught.value)
    assert words in str(caught.value)


class Caller:
    """Pickles as a call of a function, by every protocol."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.call = function, arguments

    def __reduce__(self) -> Any:
        return self.call


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_pickles_that_call_are_refused_and_not_run(tmp_path: Path, protocol: int) -> None:
    target = tmp_path / "written"
    program = Caller(exec, f"open({str(target)!r}, 'w')")
    for value in (Caller(Path.touch, target), program, {"a": Caller(open, str(target), "w")}):
        with pytest.raises(FormatError):
            read(pickle.dumps(value, protocol))
    assert not target.exists()


def test_a_pickle_that_is_too_long_is_refused() -> None:
    with pytest.raises(FormatError, match="at most 1,000,000 bytes"):
        read(b"\x80\x02" + b"N" * 1_000_000)


@given(st.binary(max_size=300), st.integers(0, 200))
@settings(max_examples=300, deadline=None)
def test_any_bytes_are_a_module_or_refused(noise: bytes, place: int) -> None:
    whole = HEAD + text("x") + tensor("0", 6, (2, 3), (3, 1)) + TAIL
    content = whole[:place] + noise + whole[place + len(noise) // 2 :]
    with contextlib.suppress(FormatError):
        assert isinstance(read(content, **{"0": bytes(24)}), StoredModule)
