"""Arrays against their schema: what fits is read as it was written, anything else is refused before it takes memory."""

from __future__ import annotations

import contextlib
import io
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.array_schema import ArraySchema, ArraySpec, check_arrays, read_arrays
from tdcr_planner.errors import FormatError

SCHEMA = ArraySchema(
    "track",
    {
        "points": ArraySpec("float64", ("points", 3), low=-10.0, high=10.0, may_be_nan=True),
        "weights": ArraySpec("float32", ("points",), low=0.0),
        "pairs": ArraySpec("integer", ("pairs", 2), low=0),
        "seen": ArraySpec("boolean", ("points",), required=False),
        "name": ArraySpec("text"),
    },
    {"points": 1000, "pairs": 1000, "text": 100},
)


def track(points: int = 4, pairs: int = 2) -> dict[str, Any]:
    return {
        "points": np.arange(3.0 * points).reshape(points, 3) / (3.0 * points + 1.0),
        "weights": np.ones(points, dtype=np.float32),
        "pairs": np.zeros((pairs, 2), dtype=np.int32),
        "seen": np.ones(points, dtype=np.bool_),
        "name": np.array("a track"),
    }


def npz(arrays: dict[str, Any], **options: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays, **options)
    return buffer.getvalue()


@given(st.integers(0, 50), st.integers(0, 50), st.booleans())
@settings(max_examples=40, deadline=None)
def test_what_fits_is_read_as_it_was_written(points: int, pairs: int, columns_first: bool) -> None:
    arrays = track(points, pairs)
    if columns_first:
        arrays["points"] = np.asfortranarray(arrays["points"])
    read, sizes = read_arrays("a.npz", SCHEMA, content=npz(arrays))
    assert sizes == {"points": points, "pairs": pairs}
    assert read.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(read[name], array)
    read["points"][...] = 0.0  # arrays may be written to


CHANGES: list[tuple[dict[str, Any], list[str]]] = [
    ({"points": np.zeros((4, 3), dtype=np.float32)}, ["points", "float64", "float32"]),
    ({"points": np.zeros((4, 3), dtype=complex)}, ["points", "complex128"]),
    ({"points": np.zeros((4, 3)).astype(str)}, ["points", "<U"]),
    ({"points": np.zeros((4, 2))}, ["points", "(points, 3)", "(4, 2)"]),
    ({"points": np.zeros(12)}, ["points", "(12,)"]),
    ({"points": np.full((4, 3), np.inf)}, ["points", "finite numbers or NaN", "inf at index (0, 0)"]),
    ({"points": np.full((4, 3), 11.0)}, ["points", "at most 10"]),
    ({"weights": np.ones(5, dtype=np.float32)}, ["weights", "(4)", "(5,)"]),
    ({"weights": np.full(4, np.nan, dtype=np.float32)}, ["weights", "finite numbers", "nan"]),
    ({"weights": np.full(4, -1.0, dtype=np.float32)}, ["weights", "at least 0", "-1.0"]),
    ({"pairs": np.zeros((1001, 2), dtype=np.int32)}, ["pairs", "pairs at most 1,000", "(1001, 2)"]),
    ({"pairs": np.full((2, 2), -1, dtype=np.int64)}, ["pairs", "at least 0"]),
    ({"pairs": np.zeros((2, 2))}, ["pairs", "integer", "float64"]),
    ({"name": np.array(["a"])}, ["name", "(1,)"]),
    ({"name": np.array(b"bytes")}, ["name", "text", "|S5"]),
    ({"pionts": np.zeros(3)}, ["pionts", "did you mean 'points'"]),
    ({"points": np.array([[None] * 3] * 4, dtype=object)}, ["points", "object"]),
]


@pytest.mark.parametrize(("changes", "words"), CHANGES)
def test_what_does_not_fit_is_named(changes: dict[str, Any], words: list[str]) -> None:
    arrays = {**track(), **changes}
    with pytest.raises(FormatError) as caught:
        read_arrays("a.npz", SCHEMA, content=npz(arrays))
    for word in ["a.npz", *words]:
        assert word in str(caught.value)
    with pytest.raises(FormatError) as in_memory:
        check_arrays("a.npz", SCHEMA, arrays)
    assert caught.value.place == in_memory.value.place


def test_a_missing_array_is_named_unless_it_may_be() -> None:
    arrays = track()
    del arrays["seen"]
    read_arrays("a.npz", SCHEMA, content=npz(arrays))
    del arrays["pairs"]
    with pytest.raises(FormatError, match="pairs: .* missing"):
        read_arrays("a.npz", SCHEMA, content=npz(arrays))


def test_known_sizes_must_agree() -> None:
    read_arrays("a.npz", SCHEMA, {"points": 4}, npz(track(4)))
    with pytest.raises(FormatError, match=r"points: expected shape \(5, 3\), got \(4, 3\)"):
        read_arrays("a.npz", SCHEMA, {"points": 5}, npz(track(4)))


@pytest.mark.parametrize("shape", ["(999999999999, 3)", "(10**9, 3)", "(-4, 3)", "(900, 3)", "[4, 3]", "(4, 3, '')"])
def test_a_header_that_promises_more_than_there_is_takes_no_memory(shape: str) -> None:
    content = npz(track())
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    record = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little") + header.ljust(117) + b"\n" + bytes(96)
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as source, zipfile.ZipFile(buffer, "w") as target:
        for name in source.namelist():
            target.writestr(name, record if name == "points.npy" else source.read(name))
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match=r"points|damaged|weights"):
            read_arrays("a.npz", SCHEMA, content=buffer.getvalue())
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


@given(st.integers(6, 127), st.binary(min_size=1, max_size=3))
@settings(max_examples=400, deadline=None)
def test_any_header_is_read_or_refused(place: int, noise: bytes) -> None:
    arrays = track()
    record = io.BytesIO()
    np.lib.format.write_array(record, arrays["points"])
    content = record.getvalue()
    content = content[:place] + noise + content[place + len(noise) :]
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(npz(arrays))) as source, zipfile.ZipFile(buffer, "w") as target:
        for name in source.namelist():
            target.writestr(name, content if name == "points.npy" else source.read(name))
    with contextlib.suppress(FormatError):
        assert read_arrays("a.npz", SCHEMA, content=buffer.getvalue())[0]["points"].shape == (4, 3)


def test_text_that_is_none_is_refused() -> None:
    name = np.frombuffer(b"\xff\xff\xff\x7f", dtype="<U1").reshape(())
    with pytest.raises(FormatError, match="name: is damaged"):
        read_arrays("a.npz", SCHEMA, content=npz({**track(), "name": name}))


def test_nothing_pickled_is_run(tmp_path: Path) -> None:
    class Writer:
        def __reduce__(self) -> Any:
            return Path.touch, (tmp_path / "written",)

    arrays = {**track(), "points": np.array([Writer()], dtype=object)}
    with pytest.raises(FormatError, match="points: .* object"):
        read_arrays("a.npz", SCHEMA, content=npz(arrays))
    assert not (tmp_path / "written").exists()


def test_three_hundred_damaged_files_are_refused_or_read_as_the_whole(random: np.random.Generator) -> None:
    whole = npz(track(40, 60))
    expected, _ = read_arrays("a.npz", SCHEMA, content=whole)
    refused = 0
    for index in range(600):
        content = bytearray(whole)
        if index < 300:
            content[random.integers(len(whole))] ^= 1 << random.integers(8)
        else:
            del content[random.integers(len(whole)) :]
        try:
            read, _ = read_arrays("a.npz", SCHEMA, content=bytes(content))
        except FormatError:
            refused += 1
            continue
        for name, array in expected.items():
            np.testing.assert_array_equal(read[name], array)
    assert refused > 500
