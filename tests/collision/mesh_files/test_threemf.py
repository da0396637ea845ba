"""3MF files: transforms, components, units, and archives and XML that are refused."""

from __future__ import annotations

import logging
import sys
import zipfile

import numpy as np
import pytest

from tdcr_planner.collision.mesh_files.registry import read_mesh_file
from tdcr_planner.collision.meshes import load_scene_mesh
from tdcr_planner.errors import FormatError

PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "mesh.3mf"


@pytest.fixture
def read(writers, path):
    def inner(model, compression=zipfile.ZIP_DEFLATED):
        path.write_bytes(writers.three_mf(model, compression))
        return read_mesh_file(path)

    return inner


def test_an_item_is_placed_and_a_mirror_turns_its_faces(writers, read, box):
    raw = read(writers.model(*box, transform="-1 0 0 0 2 0 0 0 3 10 20 30"))
    np.testing.assert_array_equal(raw.vertices, box[0] * [-1, 2, 3] + [10, 20, 30])
    np.testing.assert_array_equal(raw.faces, box[1][:, ::-1])


def test_components_of_components_are_placed_in_turn(writers, read, box):
    model = writers.model(*box).replace(
        "</resources>",
        '<object id="2"><components><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 1 0 0"/>'
        '<component objectid="1"/></components></object></resources>',
    )
    raw = read(model.replace('<item objectid="1"/>', '<item objectid="2" transform="2 0 0 0 2 0 0 0 2 0 0 5"/>'))
    turned = box[0] @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [1, 0, 0]
    np.testing.assert_array_equal(raw.vertices, np.concatenate([turned, box[0]]) * 2 + [0, 0, 5])
    assert len(raw.faces) == 24


def test_nothing_but_the_standard_library_is_needed(writers, read, box, monkeypatch):
    for name in ("lxml", "networkx", "trimesh"):
        monkeypatch.setitem(sys.modules, name, None)
    assert len(read(writers.model(*box), zipfile.ZIP_STORED).faces) == 12


def test_another_unit_than_the_files_own_is_warned_of(writers, path, box, caplog):
    path.write_bytes(writers.three_mf(writers.model(*box, attributes='unit="inch"')))
    with caplog.at_level(logging.WARNING):
        load_scene_mesh(path, "in", "obstacle")
        assert not caplog.records
        load_scene_mesh(path, "mm", "obstacle")
    assert "declares lengths in inch and is read in 'mm'" in caplog.text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<model", '<!DOCTYPE x [<!ENTITY a "aaaa">]><model', "declares a document type or entities"),
        ("<model", '<!DOCTYPE x SYSTEM "file:///etc/passwd"><model', "declares a document type or entities"),
        ("<mesh>", "<mesh>&a;", "is not valid XML"),
        ('v1="0"', 'v1="8"', "object 1: names vertex 8"),
        ('v1="0"', 'v1="-1"', "object 1: names vertex -1"),
        ('v1="0"', "", "misses the attribute 'v1'"),
        ('v1="0"', 'v1="0.5"', "expected an integer"),
        ('x="0.0"', 'x="a"', "expected a number, got 'a'"),
        ("<vertices>", "<vertices><triangle/>", "holds an element 'triangle' within 'vertices'"),
        ("</triangles>", "</strips>", "is not valid XML"),
        ("</vertices>", "</vertices><strips/>", "holds an element 'strips' within 'mesh'"),
        ("</vertices>", '</vertices><b:lattice xmlns:b="http://lattice"/>', "holds 'lattice' of http://lattice"),
        ('objectid="1"', 'objectid="2"', "object 2: is missing"),
        ('<item objectid="1"/>', "", "object 1: is not built"),
        ('<item objectid="1"/>', '<item objectid="1" transform="1 0 0"/>', "a transform of 12 numbers, got 3"),
        ("<model ", '<model xmlns:s="http://slice" requiredextensions="s" ', "needs the extension http://slice"),
        (
            '<item objectid="1"/>',
            f'<item objectid="1" p:path="/3D/o.model" xmlns:p="{PRODUCTION}"/>',
            "names a model in another part",
        ),
        ("</resources>", '<object id="1"/></resources>', "two objects of id '1'"),
        (
            "</resources>",
            '<object id="2"><components><component objectid="2"/></components></object></resources>',
            "object 2: is not built",
        ),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_refused(writers, read, box, old, new, message):
    model = writers.model(*box)
    assert old in model
    with pytest.raises(FormatError, match=message):
        read(model.replace(old, new, 1))


def test_components_that_multiply_or_hold_themselves_are_refused(writers, read, box):
    objects = "".join(
        f'<object id="{k + 1}"><components>{f"""<component objectid="{k}"/>""" * 10}</components></object>'
        for k in range(1, 20)
    )
    model = writers.model(*box).replace("</resources>", f"{objects}</resources>")
    with pytest.raises(FormatError, match="places more than 20000 objects"):
        read(model.replace('<item objectid="1"/>', '<item objectid="20"/>'))
    itself = '<object id="2"><components><component objectid="2"/></components></object></resources>'
    with pytest.raises(FormatError, match="object 2: is nested more than"):
        read(writers.model(*box).replace("</resources>", itself).replace('item objectid="1"', 'item objectid="2"'))


def test_a_zip_bomb_is_refused_before_it_is_unpacked(writers, read, box):
    model = writers.model(*box).replace("<resources>", "<resources>" + " " * 20_000_000)
    with pytest.raises(FormatError, match="at most 1073741824, and 250 times the packed size, are unpacked"):
        read(model)


@pytest.mark.parametrize("content", [b"", b"PK", b"no archive at all", b"PK\5\6" + bytes(18)])
def test_what_is_no_archive_or_an_empty_one_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(FormatError, match="is no whole 3MF archive|has no part '_rels/.rels'"):
        read_mesh_file(path)


@pytest.mark.filterwarnings("ignore:Duplicate name:UserWarning")
def test_two_parts_of_one_name_are_refused(writers, path, box):
    path.write_bytes(writers.three_mf(writers.model(*box)))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("3D/3dmodel.model", "<other/>")
    with pytest.raises(FormatError, match="two parts of one name"):
        read_mesh_file(path)
