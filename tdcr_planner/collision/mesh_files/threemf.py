"""3MF files: the objects that a file builds, from its zip archive of XML.

The XML is read as a stream; document types, and with them entities, are refused. What is not decoded (models in other
parts, beam lattices, slices) is refused by name.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from xml.parsers import expat

from tdcr_planner.collision.mesh_files.source import MeshFormat, RawMesh
from tdcr_planner.collision.mesh_files.threemf_model import ModelParser
from tdcr_planner.errors import FormatError

# A part unpacks to at most this size and this many times its packed size; text of numbers packs 3 to 30 times.
MAX_PART_BYTES = 1 << 30
MAX_RATIO = 250
_CHUNK = 1 << 20
_MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
# What Python's zip reader raises for archives that are damaged, encrypted or packed in a way that it does not know.
_BROKEN = (
    zipfile.BadZipFile, zlib.error, struct.error, NotImplementedError, RuntimeError, EOFError, OSError, ValueError,
    OverflowError, KeyError, IndexError,
)  # fmt: skip

_Start = Callable[[str, dict[str, str]], None]


def _read(path: Path) -> RawMesh:
    model = ModelParser(path)
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if len(set(names)) < len(names):
                raise FormatError(path, "holds two parts of one name: damaged")
            part = _model_part(path, archive)
            parser = _make_parser(path, part, model.start)
            parser.EndElementHandler = model.end
            parser.StartNamespaceDeclHandler = model.declare
            _parse(path, archive, part, parser)
    except _BROKEN as error:
        raise FormatError(path, f"is no whole 3MF archive: {error}; export it again") from error
    return model.build()


def _model_part(path: Path, archive: zipfile.ZipFile) -> str:
    """Returns the name of the part that holds the model."""
    found: list[str] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag.rpartition(" ")[2] == "Relationship" and attributes.get("Type") == _MODEL_TYPE:
            found.append(attributes.get("Target", "").lstrip("/"))

    _parse(path, archive, "_rels/.rels", _make_parser(path, "_rels/.rels", start))
    if len(found) != 1:
        raise FormatError(path, f"expected one 3D model in the archive, got {len(found)}", "_rels/.rels")
    return found[0]


def _make_parser(path: Path, part: str, start: _Start) -> expat.XMLParserType:
    parser = expat.ParserCreate(namespace_separator=" ")

    def refuse(*_: object) -> None:
        raise FormatError(path, "declares a document type or entities, which a 3MF file must not", part)

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = start
    parser.buffer_text = True
    return parser


def _parse(path: Path, archive: zipfile.ZipFile, part: str, parser: expat.XMLParserType) -> None:
    """Feeds a part of the archive to a parser; zipfile checks its size and checksum on the way."""
    try:
        info = archive.getinfo(part)
    except KeyError as error:
        raise FormatError(path, f"has no part {part!r}: damaged or no 3MF file") from error
    if info.file_size > min(MAX_PART_BYTES, MAX_RATIO * max(info.compress_size, 1)):
        raise FormatError(
            path,
            f"unpacks from {info.compress_size} to {info.file_size} bytes; at most {MAX_PART_BYTES}, and {MAX_RATIO} "
            "times the packed size, are unpacked",
            part,
        )
    try:
        with archive.open(info) as stream:
            while chunk := stream.read(_CHUNK):
                parser.Parse(chunk, False)
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise FormatError(path, f"is not valid XML: {error}", part) from error


THREE_MF = MeshFormat("3MF", (".3mf",), _read)
