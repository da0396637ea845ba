"""OFF files: wrapped lines, colours, normals, comments, and damage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.collision.mesh_files.registry import read_mesh_file
from tdcr_planner.errors import FormatError

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 2)]
FACES = [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4)]
TRIANGLES = [[0, 1, 2], [0, 2, 3], [0, 1, 4], [1, 2, 4]]


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    folder = tmp_path_factory.mktemp("off")

    def inner(text):
        (folder / "mesh.off").write_text(text)
        return read_mesh_file(folder / "mesh.off")

    return inner


def _text(keyword="OFF", behind_vertex="", behind_face=""):
    lines = [keyword, f"{len(POINTS)} {len(FACES)} 0"]
    lines += [f"{x} {y} {z} {behind_vertex}" for x, y, z in POINTS]
    lines += [f"{len(face)} {' '.join(map(str, face))} {behind_face}" for face in FACES]
    return "\n".join(lines) + "\n"


@settings(max_examples=50, deadline=None)
@given(breaks=st.lists(st.booleans(), min_size=40, max_size=40))
def test_lines_may_be_wrapped_anywhere(read, breaks):
    words = _text().split()
    text = words[0] + "".join(("\n" if breaks[k % len(breaks)] else " ") + word for k, word in enumerate(words[1:]))
    raw = read(text)
    np.testing.assert_array_equal(raw.vertices, POINTS)
    assert raw.faces.tolist() == TRIANGLES


@pytest.mark.parametrize("colour", ["", "3", "255 0 0", "0.5 0.5 0.5 1.0"])
@pytest.mark.parametrize(
    ("keyword", "extra"),
    [
        ("OFF", ""),
        ("COFF", "1 2 3 4"),
        ("COFF", "1 2 3"),
        ("NOFF", "0 0 1"),
        ("STOFF", "0 1"),
        ("STCNOFF", "0 0 1 1 2 3 4 0 1"),
    ],
)
def test_colours_normals_and_texture_coordinates_are_passed_over(read, keyword, extra, colour):
    raw = read("# made\n" + _text(keyword, extra, colour) + "# end\n")
    np.testing.assert_array_equal(raw.vertices, POINTS)
    assert raw.faces.tolist() == TRIANGLES


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("OFF", "4OFF", "four or n dimensions"),
        ("OFF", "OFF BINARY", "binary"),
        ("OFF", "OF", "expected 'OFF' as its first word, got 'OF'"),
        ("5 3 0", "6 3 0", "."),
        ("5 3 0", "5 2 0", "values more than its header declares"),
        ("5 3 0", "5 4 0", "cut off"),
        ("5 3 0", "5 999999999 0", "holds fewer"),
        ("3 0 1 4", "3 0 1 5", "face 2: names vertex 5"),
        ("3 0 1 4", "3 0 1.0 4", "expected an integer"),
        ("3 0 1 4", "2 0 1", "face 2: expected three or more corners, got 2"),
        ("1 1 0", "1 1", "."),
        ("1 1 0", "1 1 0 0.5 0.5 0.5", "."),
    ],
)
def test_damage_is_refused(read, old, new, message):
    text = _text()
    assert old in text
    with pytest.raises(FormatError, match=message):
        read(text.replace(old, new, 1))


def test_a_cut_file_is_refused(read):
    words = _text().split()
    for count in range(len(words)):
        with pytest.raises(FormatError):
            read(" ".join(words[:count]))
