"""OBJ files: indices of both kinds, polygons, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.collision.mesh_files.registry import read_mesh_file
from tdcr_planner.errors import FormatError

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    folder = tmp_path_factory.mktemp("obj")

    def inner(text):
        (folder / "mesh.obj").write_text(text)
        return read_mesh_file(folder / "mesh.obj")

    return inner


@settings(max_examples=40, deadline=None)
@given(blocks=st.lists(st.tuples(st.integers(3, 6), st.booleans()), min_size=1, max_size=5), seed=st.integers(0, 99))
def test_relative_indices_count_back_from_the_line_that_holds_them(read, blocks, seed):
    rng = np.random.default_rng(seed)
    lines, expected, before = [], [], 0
    for size, relative in blocks:
        points = rng.integers(-99, 99, (size, 3))
        lines += [f"v {x} {y} {z}" for x, y, z in points.tolist()]
        for _ in range(3):
            corners = rng.choice(size, 3, replace=False)
            expected.append(points[corners])
            shown = corners - size if relative else corners + before + 1
            lines.append("f " + " ".join(f"{k}/{k}/{k}" if rng.random() < 0.5 else f"{k}" for k in shown.tolist()))
        before += size
    raw = read("\n".join(lines))
    np.testing.assert_array_equal(raw.vertices[raw.faces], expected)


def test_absolute_indices_may_name_later_vertices_and_lines_may_be_continued(read):
    raw = read("# made\nmtllib /etc/passwd\no part\ng a b\ns off\nf 1 2 \\\n 3 4\n" + SQUARE + "vt 0 0\nvn 0 0 1\n")
    assert len(raw.faces) == 2


def test_colours_and_unit_weights_behind_a_vertex_are_left_aside(read):
    raw = read("v 0 0 0 1\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0 0.5 0.5 0.5 1\nf 1 2 3\n")
    np.testing.assert_array_equal(raw.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("f 1 2 5\n", "face 1: names vertex 4, but there are 4 vertices"),
        ("f 1 2 -5\n", "line 5: expected a vertex from 1, or from -4 to -1"),
        ("f 0 1 2\n", "line 5: expected a vertex"),
        ("f 1 2\n", "face 1: expected three or more corners, got 2"),
        ("f 1 2 3.0\n", "line 5: expected a vertex"),
        ("f 1 2 3/x\n", "line 5: expected a vertex"),
        ("v 1 2\n", "line 5: expected three coordinates"),
        ("v 1 2 3 0.5\n", "line 5: has a vertex of weight 0.5"),
        ("v 1 2 x\nf 1 2 3", "a vertex: expected a number, got 'x'"),
        ("l 1 2\n", "line 5: holds a line"),
        ("p 1\n", "line 5: holds points"),
        ("cstype bezier\ndeg 3\ncurv 0 1 1 2 3 4\nend\n", "line 5: holds a free-form curve or surface"),
        ("surf 0 1 0 1 1 2 3 4\n", "free-form"),
        ("call other.obj\n", "runs or includes another file"),
        ("csh rm x\n", "runs or includes another file"),
        ("wall 1 2 3\n", "unknown keyword 'wall'"),
        ("f 1 3 2 4\n", "face 1: a polygon of 4 corners crosses itself"),
    ],
)
def test_what_is_not_understood_is_refused_with_its_place(read, text, message):
    with pytest.raises(FormatError, match=message):
        read(SQUARE + text)


def test_a_missing_vertex_before_any_is_refused(read):
    with pytest.raises(FormatError, match="line 1: expected vertices"):
        read("f -1 -2 -3\n" + SQUARE)
