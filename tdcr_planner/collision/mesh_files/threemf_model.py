"""The model of a 3MF file: objects, components and what is built of them, from the events of an XML parser."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.mesh_files.source import (
    RawMesh,
    check_range,
    check_triangle_count,
    parse_integer,
    parse_numbers,
)
from tdcr_planner.errors import FormatError

MAX_DEPTH = 32
# Components of components multiply: this many placed objects are more than any model needs.
MAX_PLACED = 20_000

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
# Extensions that change no geometry; production names parts in other files, which `start` refuses.
_HARMLESS = (
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/production/2015/06",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
)
# Core elements within an object and what each stands in.
_PARENTS = {
    "mesh": "object", "vertices": "mesh", "vertex": "vertices", "triangles": "mesh", "triangle": "triangles",
    "components": "object", "component": "components", "item": "build", "object": "resources",
}  # fmt: skip
_OTHERS = frozenset(["model", "metadata", "metadatagroup", "resources", "basematerials", "base", "build"])


@dataclass
class _Object:
    """An object of a model: a mesh, or components with their transforms."""

    coordinates: array[float] = field(default_factory=lambda: array("d"))
    corners: array[int] = field(default_factory=lambda: array("q"))
    components: list[tuple[str, FloatArray]] = field(default_factory=list)

    def check(self, path: Path, name: str) -> None:
        """Raises FormatError where a triangle names a missing vertex."""
        check_range(path, np.array(self.corners, dtype=np.int64), len(self.coordinates) // 3, f"object {name}")


class ModelParser:
    """Takes the elements of a model's XML and builds its triangles.

    Attributes:
        unit: The unit of length that the model declares, or None.
    """

    def __init__(self, path: Path) -> None:
        """Takes the file, for messages."""
        self.unit: str | None = None
        self._path = path
        self._objects: dict[str, _Object] = {}
        self._items: list[tuple[str, FloatArray]] = []
        self._open: list[str] = []
        self._prefixes: dict[str, str] = {}
        self._object = _Object()

    def declare(self, prefix: str | None, namespace: str) -> None:
        """Takes the declaration of a namespace."""
        self._prefixes[prefix or ""] = namespace

    def end(self, tag: str) -> None:
        """Takes the end of an element."""
        del tag
        self._open.pop()

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Takes the beginning of an element."""
        namespace, _, name = tag.rpartition(" ")
        within = self._open[-1] if self._open else ""
        self._open.append(name if namespace == _CORE else f"{namespace} {name}")
        if len(self._open) > MAX_DEPTH:
            raise FormatError(self._path, f"nests elements more than {MAX_DEPTH} deep")
        if len(self._open) == 1 and (namespace, name) != (_CORE, "model"):
            raise FormatError(self._path, f"expected a 3MF model, got an element {name!r}")
        if namespace != _CORE:
            if "object" in self._open and namespace not in _HARMLESS:
                raise FormatError(self._path, f"holds {name!r} of {namespace}, which is not decoded; export triangles")
            return
        if name not in _OTHERS and _PARENTS.get(name) != within:
            raise FormatError(self._path, f"holds an element {name!r} within {within!r}, which is not decoded")
        place = f"{name} of object {len(self._objects)}"
        match name:
            case "vertex":
                words = [self._take(attributes, key, place) for key in "xyz"]
                self._object.coordinates.extend(parse_numbers(self._path, words, place))
            case "triangle":
                for key in ("v1", "v2", "v3"):
                    self._object.corners.append(parse_integer(self._path, self._take(attributes, key, place), place))
            case "object":
                self._begin_object(self._take(attributes, "id", place))
            case "component" | "item":
                self._place(name, attributes, place)
            case "model":
                self._check_model(attributes)

    def _take(self, attributes: dict[str, str], key: str, place: str) -> str:
        if key not in attributes:
            raise FormatError(self._path, f"misses the attribute {key!r}: damaged", place)
        return attributes[key]

    def _begin_object(self, name: str) -> None:
        if name in self._objects:
            raise FormatError(self._path, f"has two objects of id {name!r}: damaged")
        self._object = self._objects[name] = _Object()

    def _place(self, kind: str, attributes: dict[str, str], place: str) -> None:
        if any(key.endswith(" path") for key in attributes):
            raise FormatError(self._path, "names a model in another part, which is not read; export one model", place)
        target = self._take(attributes, "objectid", place)
        numbers = parse_numbers(self._path, attributes.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split(), place)
        if len(numbers) != 12 or not np.isfinite(numbers).all():
            raise FormatError(self._path, f"expected a transform of 12 numbers, got {len(numbers)}", place)
        (self._object.components if kind == "component" else self._items).append((target, numbers.reshape(4, 3)))

    def _check_model(self, attributes: dict[str, str]) -> None:
        self.unit = attributes.get("unit")
        for prefix in attributes.get("requiredextensions", "").split():
            namespace = self._prefixes.get(prefix, prefix)
            if namespace not in _HARMLESS:
                raise FormatError(
                    self._path, f"needs the extension {namespace}, which is not decoded; export plain triangles"
                )

    def build(self) -> RawMesh:
        """Returns the triangles of all that the model builds."""
        for name, item in self._objects.items():
            item.check(self._path, name)
        vertices, faces = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)]
        total, triangles = 0, 0
        used = set()
        for name, item, transform in self._placed():
            used.add(name)
            points = np.array(item.coordinates).reshape(-1, 3) @ transform[:3] + transform[3]
            corners = np.array(item.corners, dtype=np.int64).reshape(-1, 3)
            triangles += len(corners)
            check_triangle_count(self._path, max(triangles, (total + len(points)) // 3))
            if np.linalg.det(transform[:3]) < 0.0:
                corners = corners[:, ::-1]  # a mirror turns the outside in
            vertices.append(points)
            faces.append(corners + total)
            total += len(points)
        left = [name for name in self._objects if name not in used]
        if left:
            raise FormatError(self._path, "is not built; place it by an item or delete it", f"object {left[0]}")
        return RawMesh(np.concatenate(vertices), np.concatenate(faces), self.unit)

    def _placed(self) -> Iterator[tuple[str, _Object, FloatArray]]:
        """Yields each object that is built with its transform, shape (4, 3): x' = x R + t, rows as vectors."""
        waiting = [(name, transform, 0) for name, transform in reversed(self._items)]
        for _ in range(MAX_PLACED):
            if not waiting:
                return
            name, outer, depth = waiting.pop()
            item = self._objects.get(name)
            if item is None or depth > MAX_DEPTH:
                problem = "is missing" if item is None else f"is nested more than {MAX_DEPTH} deep, or in itself"
                raise FormatError(self._path, f"{problem}: damaged", f"object {name}")
            yield name, item, outer
            for target, inner in reversed(item.components):
                joined = np.concatenate([inner[:3] @ outer[:3], inner[3:] @ outer[:3] + outer[3]])
                waiting.append((target, joined, depth + 1))
        raise FormatError(self._path, f"places more than {MAX_PLACED} objects; reduce the model")
