"""STL files, binary and ASCII, whole and damaged."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.collision.mesh_files.registry import read_mesh_file
from tdcr_planner.errors import FormatError


@pytest.fixture
def read(tmp_path):
    def inner(content, name="mesh.stl"):
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_mesh_file(tmp_path / name)

    return inner


@pytest.mark.parametrize("header", [b"", b"solid of a binary file", b"solid \n facet normal", bytes(range(80))])
def test_a_binary_file_is_told_by_its_size_whatever_its_header(read, writers, box, header):
    assert len(read(writers.stl(*box, header)).faces) == 12


@pytest.mark.parametrize("wrong", [11, 13, 2**31, 2**32 - 1, 0])
def test_a_wrong_number_of_triangles_is_refused(read, writers, box, wrong):
    data = bytearray(writers.stl(*box))
    data[80:84] = wrong.to_bytes(4, "little")
    with pytest.raises(FormatError, match=f"declares {wrong} triangles, which take .* bytes, but holds 684"):
        read(bytes(data))


@pytest.mark.parametrize(
    "name", ["", "a b c", "of endsolid", "x" * 500, "größe", "solid", "normal", "http://x/y?z=1  ; color 1 2 3"]
)
def test_ascii_names_may_be_anything(read, writers, box, name):
    text = writers.ascii_stl(*box, name)
    np.testing.assert_array_equal(read(text).vertices, box[0][box[1]].reshape(-1, 3))
    assert len(read(text.upper()).faces) == 12
    assert len(read(text.replace("\n", "\r\n")).faces) == 12
    assert len(read(text.encode("latin-1")).faces) == 12


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
def test_ascii_text_is_decoded_by_its_byte_order_mark(read, writers, box, encoding):
    assert len(read(writers.ascii_stl(*box).encode(encoding)).faces) == 12


def test_utf_16_without_a_mark_is_refused(read, writers, box):
    with pytest.raises(FormatError, match="UTF-16 without a byte order mark"):
        read(writers.ascii_stl(*box).encode("utf-16-le"))


def test_every_solid_of_an_ascii_file_is_read_and_each_must_end(read, writers, box):
    text = writers.ascii_stl(*box) + writers.ascii_stl(*box, "other")
    assert len(read(text).faces) == 24
    lines = text.splitlines(keepends=True)
    for count in range(1, len(lines)):
        if count == len(lines) // 2:
            continue  # the first solid alone is a whole file
        with pytest.raises(FormatError, match="cut off"):
            read("".join(lines[:count]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("vertex 0.0 0.0 0.0\n", "vertex 0.0 0.0\n", "line 2: expected a facet"),
        ("vertex 0.0 0.0 0.0\n", "vertex 0.0 0.0 0.0\nvertex 1 1 1\n", "line 2: expected a facet"),
        ("vertex 0.0 0.0 0.0\n", "vertex 0.0 0,5 0.0\n", "expected a number, got '0,5'"),
        ("vertex 0.0 0.0 0.0\n", "vertex 0.0 1_0 0.0\n", "expected a number, got '1_0'"),
        ("solid part\n", "solid part facet normal 0 0 0\n", "line 1: expected 'solid'"),
        ("endsolid part\n", "endsolid part\nfacet", "expected 'solid', got 'facet'"),
        ("endsolid part\n", "endsolid solid x facet normal 0 0 1\n", "expected a facet"),
    ],
)
def test_what_breaks_the_grammar_is_refused_with_its_line(read, writers, box, old, new, message):
    text = writers.ascii_stl(*box)
    assert old in text
    with pytest.raises(FormatError, match=message):
        read(text.replace(old, new, 1))
