"""The part of glTF 2.0's JSON that decides geometry, as a schema."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tdcr_planner.collision.mesh_files.source import decode_text
from tdcr_planner.errors import FormatError

Count = Annotated[int, Field(ge=1, le=2**40, strict=True)]
Index = Annotated[int, Field(ge=0, le=2**40, strict=True)]


class _Part(BaseModel):
    """Base of all objects: what the specification does not name is refused, for it may change the geometry."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: str | None = None
    extensions: dict[str, Any] = {}
    extras: Any = None


class Scene(_Part):
    """Root nodes that are shown together."""

    nodes: tuple[Index, ...] = ()


class Node(_Part):
    """A place in the scene's tree: a matrix (column by column), or scale, rotation (x, y, z, w) and translation."""

    camera: Index | None = None
    children: tuple[Index, ...] = ()
    skin: Index | None = None
    matrix: Annotated[tuple[float, ...], Field(min_length=16, max_length=16)] | None = None
    mesh: Index | None = None
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    weights: tuple[float, ...] = ()


class Primitive(_Part):
    """Triangles, strips, fans, lines or points of one material."""

    attributes: dict[str, Index]
    indices: Index | None = None
    material: Index | None = None
    mode: Index = 4
    targets: tuple[Any, ...] = ()


class Mesh(_Part):
    """Primitives that are placed together."""

    primitives: Annotated[tuple[Primitive, ...], Field(min_length=1)]
    weights: tuple[float, ...] = ()


class SparseIndices(_Part):
    """Which elements of an accessor are replaced."""

    bufferView: Index  # noqa: N815
    byteOffset: Index = 0  # noqa: N815
    componentType: Index  # noqa: N815


class SparseValues(_Part):
    """What they are replaced by."""

    bufferView: Index  # noqa: N815
    byteOffset: Index = 0  # noqa: N815


class Sparse(_Part):
    """Elements of an accessor that are replaced."""

    count: Count
    indices: SparseIndices
    values: SparseValues


class Accessor(_Part):
    """A typed array in a buffer view."""

    bufferView: Index | None = None  # noqa: N815
    byteOffset: Index = 0  # noqa: N815
    componentType: Index  # noqa: N815
    normalized: Annotated[bool, Field(strict=True)] = False
    count: Count
    type: str
    max: tuple[float, ...] | None = None
    min: tuple[float, ...] | None = None
    sparse: Sparse | None = None


class BufferView(_Part):
    """A stretch of a buffer."""

    buffer: Index
    byteOffset: Index = 0  # noqa: N815
    byteLength: Count  # noqa: N815
    byteStride: Annotated[int, Field(ge=4, le=252, multiple_of=4, strict=True)] | None = None  # noqa: N815
    target: Index | None = None


class Buffer(_Part):
    """Bytes in the GLB file, in another file, or in the JSON itself."""

    uri: str | None = None
    byteLength: Count  # noqa: N815


class Asset(_Part):
    """Version of the format."""

    copyright: str | None = None
    generator: str | None = None
    version: str
    minVersion: str | None = None  # noqa: N815


class Document(_Part):
    """The whole JSON; what holds no geometry is not looked into."""

    extensionsUsed: tuple[str, ...] = ()  # noqa: N815
    extensionsRequired: tuple[str, ...] = ()  # noqa: N815
    accessors: tuple[Accessor, ...] = ()
    animations: tuple[Any, ...] = ()
    asset: Asset
    buffers: tuple[Buffer, ...] = ()
    bufferViews: tuple[BufferView, ...] = ()  # noqa: N815
    cameras: Any = None
    images: Any = None
    materials: Any = None
    meshes: tuple[Mesh, ...] = ()
    nodes: tuple[Node, ...] = ()
    samplers: Any = None
    scene: Index | None = None
    scenes: tuple[Scene, ...] = ()
    skins: Any = None
    textures: Any = None


def parse_document(path: Path, data: bytes) -> Document:
    """Returns the document that a glTF file's JSON describes, or raises FormatError naming what is wrong in it."""
    try:
        content = json.loads(decode_text(path, data), object_pairs_hook=_unique, parse_constant=_refuse_constant)
    except RecursionError as error:
        raise FormatError(path, "is nested too deeply for a glTF file") from error
    except ValueError as error:  # json.JSONDecodeError, a number of too many digits, and those below
        raise FormatError(path, f"is not valid glTF JSON: {error}") from error
    if not isinstance(content, dict):
        raise FormatError(path, "expected a JSON object, damaged or no glTF file")
    try:
        return Document.model_validate(content)
    except ValidationError as error:
        fault = error.errors()[0]
        place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"]).lstrip(".")
        message = fault["msg"][0].lower() + fault["msg"][1:]
        raise FormatError(path, f"{message}: damaged or no glTF 2.0", place) from error


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise ValueError("an object names a key twice")
    return table


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")
