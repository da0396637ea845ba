"""PLY files: ASCII and both byte orders, further properties, strips, polygons of many sizes, and damage."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from tdcr_planner.collision.mesh_files.registry import read_mesh_file
from tdcr_planner.errors import FormatError

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], dtype=np.float64)
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}


@pytest.fixture
def read(tmp_path):
    def inner(content):
        (tmp_path / "mesh.ply").write_bytes(content)
        return read_mesh_file(tmp_path / "mesh.ply")

    return inner


def write(order, elements, newline="\n"):
    """Returns a PLY file; elements are (name, [(property, type or (length type, type))], rows)."""
    lines, body = ["ply", f"format {order} 1.0", "comment a b c", "obj_info x"], b""
    for name, properties, rows in elements:
        lines.append(f"element {name} {len(rows)}")
        for key, kind in properties:
            lines.append(f"property {kind} {key}" if isinstance(kind, str) else f"property list {' '.join(kind)} {key}")
        for row in rows:
            values, codes = [], ""
            for (_, kind), value in zip(properties, row, strict=True):
                if isinstance(kind, str):
                    values.append(value)
                    codes += CODES[kind]
                else:
                    values += [len(value), *value]
                    codes += CODES[kind[0]] + CODES[kind[1]] * len(value)
            text = " ".join(map(str, values)) + newline
            body += text.encode() if order == "ascii" else struct.pack(ORDERS[order] + codes, *values)
    return newline.join([*lines, "end_header", ""]).encode() + body


def vertices(kind="float", extra=()):
    properties = [("x", kind), *((f"e{k}", item) for k, item in enumerate(extra)), ("y", kind), ("z", kind)]
    take = int if kind not in ("float", "double") else float
    others = [7 if isinstance(item, str) else [1, 2, 3] for item in extra]
    rows = [(take(x), *others, take(y), take(z)) for x, y, z in POINTS]
    return "vertex", properties, rows


FACES = ("face", [("vertex_indices", ("uchar", "int"))], [([0, 1, 2],), ([0, 2, 3],), ([1, 4, 5, 2],)])


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("extra", [(), ("uchar", "double"), ("short", ("uchar", "float"))])
@pytest.mark.parametrize("kind", ["float", "double", "int", "char"])
def test_further_properties_are_passed_over_in_every_encoding(read, order, newline, extra, kind):
    raw = read(write(order, [vertices(kind, extra), FACES], newline))
    np.testing.assert_array_equal(raw.vertices, POINTS)
    assert raw.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("length", ["uchar", "ushort", "int"])
def test_faces_before_vertices_and_beside_strips_are_all_read(read, order, length):
    faces = ("face", [("flag", "char"), ("vertex_index", (length, "uint"))], [(-1, [0, 1, 2]), (1, [0, 2, 3])])
    strips = ("tristrips", [("vertex_indices", ("int", "int"))], [([1, 4, 2, 5, -1, 0, 1, 2],)])
    raw = read(write(order, [faces, vertices(), strips]))
    assert raw.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2], [2, 4, 5], [0, 1, 2]]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    ("element", "message"),
    [
        (("edge", [("vertex1", "int"), ("vertex2", "int")], [(0, 1)]), "holds an element 'edge' that is not read"),
        (("range_grid", [("vertex_indices", ("uchar", "int"))], [([0],)]), "holds an element 'range_grid'"),
        (("face", [("vertex_indices", ("uchar", "int"))], [([0, 1, 6],)]), "face 1: names vertex 6"),
        (("face", [("vertex_indices", ("uchar", "int"))], [([0, 1, -1],)]), "expected vertex indices, got -1"),
        (("face", [("vertex_indices", ("uchar", "int"))], [([0, 1],)]), "three or more corners, got 2"),
        (("face", [("corner", ("uchar", "int"))], [([0, 1, 2],)]), "expected one list vertex_indices"),
        (("tristrips", [("vertex_indices", ("uchar", "int"))], [([0, 1],)]), "a triangle strip: expected three"),
        (("tristrips", [("vertex_indices", ("uchar", "int"))], [([0, 1, 9],)]), "a triangle strip: names vertex 9"),
    ],
)
def test_what_is_not_understood_is_refused(read, order, element, message):
    with pytest.raises(FormatError, match=message):
        read(write(order, [vertices(), element]))


@pytest.mark.parametrize("order", ORDERS)
def test_rows_missing_or_left_over_are_refused(read, order):
    whole = write(order, [vertices(), FACES])
    header = whole.index(b"end_header")
    for length in range(header, len(whole) - 1):
        with pytest.raises(FormatError):
            read(whole[:length])
    with pytest.raises(FormatError, match="more than its header declares"):
        read(whole + b"1 2 3")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"format ascii 1.0", b"format ascii 2.0", "line 'format ascii 2.0' is not understood"),
        (b"format ascii 1.0\n", b"", "expected a line 'format'"),
        (b"property float x", b"property half x", "is not understood"),
        (b"property float x", b"property float y", "names property 'y' of element 'vertex' twice"),
        (b"property float x", b"property float w", "expected properties x, y and z"),
        (b"element vertex 6", b"element vertex 7", "."),
        (b"element vertex 6", b"element vertex 99999999999", "cut off"),
        (b"element vertex 6", b"element vertex -6", "expected a count of 0 or more"),
        (b"element vertex 6", b"element vertex 6_0", "expected an integer, got '6_0'"),
        (b"0.0 0.0 0.0", b"0.0 0.0 0.0.0", "expected a number"),
    ],
)
def test_a_damaged_header_is_refused(read, old, new, message):
    whole = write("ascii", [vertices(), FACES])
    assert old in whole
    with pytest.raises(FormatError, match=message):
        read(whole.replace(old, new, 1))
