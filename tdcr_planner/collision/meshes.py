"""Scene meshes: reading them, judging whether their role gives them an inside, and telling inside from outside."""

from __future__ import annotations

import hashlib
import logging
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray, check_array
from tdcr_planner.collision.mesh_files.registry import read_mesh_file
from tdcr_planner.collision.mesh_files.source import RawMesh
from tdcr_planner.collision.roles import MeshRole, find_role
from tdcr_planner.collision.topology import Loop, Surface, analyse, clean_mesh, fan_cap
from tdcr_planner.collision.tree import TriangleTree, build_tree, winding_numbers
from tdcr_planner.errors import FormatError, InputError, UnknownNameError

logger = logging.getLogger(__name__)

METRES_PER_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
# The units of 3MF files.
_DECLARED_UNITS = {"meter": "m", "centimeter": "cm", "millimeter": "mm", "inch": "in", "micron": "um", "foot": "ft"}
# Coordinates beyond this are damage, not a place on Earth; products of them stay far from overflow.
LARGEST = 1e9
POINT_DIGITS = 5  # of a coordinate in metres, in messages

# An opening's rim may leave its plane by this share of its diameter and still be capped flat.
FLATNESS_SHARE = 0.02
# Below this steepness (45 degrees) the wall around a rim runs on in the rim's own plane: a tear, not an opening.
TEAR_STEEPNESS = 0.5
# An entry rim may stand this share of its diameter in front of the entry plane; the plane is moved up to it.
ENTRY_SHARE = 1e-3
# The entry plane stands before the rim by 16 times a double's rounding of the largest coordinate, at least by this, m.
HAIR_SHARE, LEAST_HAIR = 16.0 * 2.0**-53, 1e-12
# Coordinates that are rounded to more than this share of the mesh's size are warned of.
ROUNDING_SHARE = 1e-4


@dataclass(frozen=True)
class Entry:
    """The plane through which the body enters a cavity.

    Attributes:
        point: A point of the plane, shape (3,), m, world frame.
        normal: Unit normal that points into the cavity, shape (3,), world frame.
    """

    point: FloatArray
    normal: FloatArray

    def depth(self, points: FloatArray) -> FloatArray:
        """Returns how far points, shape (..., 3), m, lie in front of the plane, shape (...), m."""
        return np.asarray((points - self.point) @ self.normal)


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """A mesh of the scene in its role, in metres and the world frame.

    Attributes:
        name: What to call it in messages: the file's name.
        vertices: Shape (v, 3), m.
        faces: Shape (f, 3), vertex indices; coincident vertices are merged, collapsed and repeated faces dropped.
        role: Name in `MESH_ROLES`. "cavity": the body stays inside; "obstacle": it stays outside.
        entry: For a cavity, the plane behind which the body may be outside; None where it may be outside nowhere.
        caps: Flat caps over a cavity's openings that are not the entry, shape (c, 3), indices into `wall_vertices`.
            They are walls: the body must not poke out of them.
        bounded: Whether the mesh has an inside; false for an open obstacle, of which only the surface counts.
        entrances: The rims of a cavity's openings that lie on or behind the entry plane.
        source: The file it came from, or None.
        unit: The file's unit of length, for messages; None for a mesh from arrays.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    role: str
    entry: Entry | None = None
    caps: IntArray = field(default_factory=lambda: np.empty((0, 3), dtype=np.int64))
    bounded: bool = True
    entrances: tuple[Loop, ...] = ()
    source: Path | None = None
    unit: str | None = None
    _cap_centres: FloatArray = field(default_factory=lambda: np.empty((0, 3)), repr=False)
    _closure: IntArray = field(default_factory=lambda: np.empty((0, 3), dtype=np.int64), repr=False)

    @classmethod
    def from_arrays(
        cls,
        name: str,
        vertices: ArrayLike,
        faces: ArrayLike,
        role: str,
        entry_point: ArrayLike | None = None,
        entry_normal: ArrayLike | None = None,
    ) -> SceneMesh:
        """Returns a mesh in its role, from arrays.

        Args:
            name: What to call it in messages.
            vertices: Shape (v, 3), m, world frame.
            faces: Shape (f, 3), vertex indices.
            role: Name in `MESH_ROLES`, such as "cavity" or "obstacle".
            entry_point: Shape (3,), m, a point of a cavity's entry plane; None for no entry.
            entry_normal: Shape (3,), direction into the cavity, any length above 0.

        Raises:
            InputError: An argument is not what it should be.
            FormatError: The mesh cannot serve in its role; the message says where its holes are.
        """
        return _build_mesh(name, vertices, faces, role, entry_point, entry_normal, None)

    @property
    def keeps_inside(self) -> bool:
        """Whether the body must stay inside."""
        return find_role(self.role).keeps_inside

    @property
    def wall_vertices(self) -> FloatArray:
        """The vertices and behind them the cap centres, shape (w, 3), m."""
        return np.concatenate([self.vertices, self._cap_centres])

    @property
    def wall_faces(self) -> IntArray:
        """Every triangle that the body must not touch, shape (f + c, 3): the faces, then the caps."""
        return np.concatenate([self.faces, self.caps])

    @property
    def bounds(self) -> FloatArray:
        """Lower and upper corner, shape (2, 3), m, world frame."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @cached_property
    def sha256(self) -> str:
        """SHA-256 over geometry, role and entry as hex digits: what decides every answer about this mesh."""
        digest = hashlib.sha256(f"{self.role} {self.bounded} {self.vertices.shape} {self.faces.shape}".encode())
        for array in (self.vertices, self.faces, self._cap_centres, self.caps, self._closure):
            digest.update(np.ascontiguousarray(array).tobytes())
        if self.entry is not None:
            digest.update(self.entry.point.tobytes() + self.entry.normal.tobytes())
        return digest.hexdigest()

    @cached_property
    def wall_tree(self) -> TriangleTree:
        """The tree of `wall_faces`, for distances."""
        return build_tree(self.wall_vertices, self.wall_faces)

    @cached_property
    def closed_tree(self) -> TriangleTree:
        """The tree of the closed surface (entry capped too), for winding numbers."""
        return build_tree(self.wall_vertices, self._closure)

    def contains(self, points: FloatArray) -> BoolArray:
        """Returns which points, shape (n, 3), m, world frame, lie inside the closed surface, shape (n,).

        Never inside when the mesh has no inside (an open obstacle).
        """
        if not self.bounded:
            return np.zeros(len(points), dtype=np.bool_)
        numbers = winding_numbers(self.closed_tree, np.ascontiguousarray(points, dtype=np.float64))
        return np.asarray(numbers != 0.0)


def load_scene_mesh(
    path: str | Path,
    unit: str,
    role: str,
    entry_point: ArrayLike | None = None,
    entry_normal: ArrayLike | None = None,
    name: str | None = None,
) -> SceneMesh:
    """Returns the mesh in a file.

    Args:
        path: The mesh file: STL, OBJ, PLY, OFF, glTF or 3MF.
        unit: The file's unit of length: m, cm, mm or in.
        role: "cavity" or "obstacle".
        entry_point: Shape (3,), m, world frame, a point of a cavity's entry plane; None for no entry.
        entry_normal: Shape (3,), direction into the cavity.
        name: What to call it in messages; the file's name where it is None.

    Raises:
        InputError: Unknown unit or role, entry without normal, or an entry for an obstacle.
        FormatError: The file is missing, unreadable, empty or not finite, or it cannot serve in its role.
    """
    file = Path(path)
    raw = _read(file, unit)
    if raw.unit is not None and _DECLARED_UNITS.get(raw.unit, unit) != unit:
        logger.warning("%s: declares lengths in %s and is read in %r; is that the right unit?", path, raw.unit, unit)
    _warn_of_rounding(file, raw.vertices)
    vertices = raw.vertices * METRES_PER_UNIT[unit]
    mesh = _build_mesh(name or file.name, vertices, raw.faces, role, entry_point, entry_normal, file)
    return replace(mesh, unit=unit)


def read_triangles(path: str | Path, unit: str) -> tuple[FloatArray, IntArray]:
    """Returns the vertices, shape (v, 3), m, and faces, shape (f, 3), that a mesh file holds, as they stand in it.

    Args:
        path: The mesh file: STL, OBJ, PLY, OFF, glTF or 3MF.
        unit: The file's unit of length: m, cm, mm or in.

    Raises:
        InputError: Unknown unit.
        FormatError: The file is missing, or it is not understood whole.
    """
    raw = _read(Path(path), unit)
    return raw.vertices * METRES_PER_UNIT[unit], raw.faces


def _read(file: Path, unit: str) -> RawMesh:
    if unit not in METRES_PER_UNIT:
        raise UnknownNameError("unit", str(unit), METRES_PER_UNIT, " for the mesh file's unit of length")
    return read_mesh_file(file)


def _warn_of_rounding(file: Path, vertices: FloatArray) -> None:
    """Warns of a mesh in single precision that lies so far from the origin that its shape is rounded away."""
    if not len(vertices) or not np.isfinite(vertices).all():
        return
    with np.errstate(all="ignore"):  # coordinates beyond single precision are refused later
        single = vertices.astype(np.float32)
        step = float(np.spacing(np.abs(single).max()))
    size = float(np.ptp(vertices, axis=0).max())
    if step > ROUNDING_SHARE * size and (single == vertices).all():
        logger.warning(
            "%s: its coordinates of up to %.6g in single precision are multiples of %.2g, its size is %.3g: "
            "its shape is rounded; move it near the origin before it is exported",
            file, np.abs(vertices).max(), step, size,
        )  # fmt: skip


def _build_mesh(
    name: str,
    vertices: ArrayLike,
    faces: ArrayLike,
    role: str,
    entry_point: ArrayLike | None,
    entry_normal: ArrayLike | None,
    source: Path | None,
) -> SceneMesh:
    kind = find_role(role)
    entry = _check_entry(kind, entry_point, entry_normal)
    where = source if source is not None else name
    points, triangles = _check_geometry(where, vertices, faces)
    points, triangles = clean_mesh(points, triangles)
    if not len(triangles):
        raise FormatError(where, "has no triangles of an area above 0")
    surface = analyse(points, triangles)
    mesh = SceneMesh(name, points, surface.faces, role, entry, source=source)
    return _as_cavity(where, mesh, surface) if kind.keeps_inside else _as_obstacle(mesh, surface)


def _check_entry(role: MeshRole, point: ArrayLike | None, normal: ArrayLike | None) -> Entry | None:
    if point is None and normal is None:
        return None
    if point is None or normal is None:
        missing = "entry_point" if point is None else "entry_normal"
        raise InputError(missing, "a point and a normal of the entry plane together", "only one of them")
    if not role.keeps_inside:
        raise InputError("entry_point", f"no entry for an {role.name}: it belongs to the role 'cavity'", "an entry")
    direction = check_array("entry_normal", normal, (3,))
    length = float(np.linalg.norm(direction))
    if length < 1e-9:
        raise InputError("entry_normal", "a direction of length above 0", direction.tolist())
    return Entry(check_array("entry_point", point, (3,)), direction / length)


def _check_geometry(where: str | Path, vertices: ArrayLike, faces: ArrayLike) -> tuple[FloatArray, IntArray]:
    points = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(faces, dtype=np.int64)
    if points.size == 0 or triangles.size == 0:
        raise FormatError(where, "holds no triangles")
    if points.ndim != 2 or points.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise FormatError(where, f"expected vertices (v, 3) and faces (f, 3), got {points.shape} and {triangles.shape}")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise FormatError(where, f"a face names vertex {triangles.max()}, but there are {len(points)} vertices")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise FormatError(where, f"is not finite: {points[bad[0]].tolist()}", f"vertex {bad[0]}")
    if np.abs(points).max() > LARGEST:
        far = int(np.abs(points).max(axis=1).argmax())
        raise FormatError(
            where, f"expected coordinates of up to {LARGEST:g} m, got {points[far].tolist()}", f"vertex {far}"
        )
    return points, triangles


def _as_obstacle(mesh: SceneMesh, surface: Surface) -> SceneMesh:
    """Returns the mesh with the pieces that have an inside as its closure."""
    unclosed = surface.tangled.copy()
    unclosed[[loop.piece for loop in surface.loops]] = True
    closed = ~unclosed[surface.piece]
    if unclosed.any():
        if surface.loops:
            largest = max(surface.loops, key=lambda loop: loop.diameter)
            reason = f"{len(surface.loops)} hole(s), the largest {_describe(largest)}"
        else:
            reason = "edges that three or more faces share"
        logger.warning(
            "%s: obstacle with %s: nothing keeps the body out of the inside of %s; only the surface counts there",
            mesh.name, reason, "the whole mesh" if not closed.any() else "that part",
        )  # fmt: skip
    return SceneMesh(
        mesh.name, mesh.vertices, mesh.faces, mesh.role, bounded=bool(closed.any()), source=mesh.source,
        _closure=mesh.faces[closed],
    )  # fmt: skip


def _as_cavity(where: str | Path, mesh: SceneMesh, surface: Surface) -> SceneMesh:
    """Returns the mesh closed by caps, or refuses it with the place of the hole that leaves its inside undefined."""
    if surface.tangled.any():
        face = int(np.flatnonzero(surface.tangled[surface.piece])[0])
        raise FormatError(
            where,
            "as a cavity: has edges that three or more faces share, or is one-sided, so its inside cannot be told; "
            "repair it, or use it as an 'obstacle', which keeps the body off its surface",
            f"near {format_point(mesh.vertices[mesh.faces[face]].mean(axis=0))}",
        )
    entry = _move_entry(mesh, surface.loops)
    if entry is not None and entry.depth(mesh.vertices).max() <= 0.0:
        logger.warning(
            "%s: the whole cavity lies behind its entry plane at %s; the entry's normal must point into the cavity",
            mesh.name, format_point(entry.point),
        )  # fmt: skip
    opening: list[Loop] = []
    behind: list[Loop] = []
    for loop in surface.loops:
        depth = np.full(1, np.inf) if entry is None else entry.depth(mesh.vertices[loop.edges])
        if depth.max() <= 0.0:
            behind.append(loop)
            continue
        _check_opening(where, loop, bool(depth.min() < 0.0))
        opening.append(loop)
    centres = np.array([loop.centre for loop in opening + behind]).reshape(-1, 3)
    fans = [fan_cap(loop, len(mesh.vertices) + k) for k, loop in enumerate(opening + behind)]
    empty = np.empty((0, 3), dtype=np.int64)
    return SceneMesh(
        mesh.name, mesh.vertices, mesh.faces, mesh.role, entry, np.concatenate([empty, *fans[: len(opening)]]),
        entrances=tuple(behind), source=mesh.source, _cap_centres=centres, _closure=np.concatenate([mesh.faces, *fans]),
    )  # fmt: skip


def _move_entry(mesh: SceneMesh, loops: tuple[Loop, ...]) -> Entry | None:
    """Returns the entry plane moved up to rims that stand before it by no more than rounding and modelling slack."""
    entry = mesh.entry
    if entry is None:
        return None
    shift = 0.0
    ahead = []
    for loop in loops:
        depth = entry.depth(mesh.vertices[loop.edges])
        if depth.max() <= ENTRY_SHARE * loop.diameter:
            shift = max(shift, float(depth.max()))
        elif depth.max() > 0.0:
            ahead.append((float(depth.max()), loop))
    if ahead and len(ahead) == len(loops):
        distance, loop = min(ahead, key=lambda item: item[0])
        logger.warning(
            "%s: no opening lies on or behind the entry plane; the nearest (%s) stands %.3g m in front of it and is "
            "taken for a wall. If the body enters there, give an entry plane in front of it",
            mesh.name, _describe(loop), distance,
        )  # fmt: skip
    # A hair farther than the rim, so that rounding, which grows with the coordinates, leaves none of it in front.
    size = max(float(np.abs(mesh.vertices).max()), float(np.abs(entry.point).max()))
    hair = max(LEAST_HAIR, HAIR_SHARE * size)
    return Entry(entry.point + (shift + hair) * entry.normal, entry.normal)


def _check_opening(where: str | Path, loop: Loop, crosses_entry: bool) -> None:
    """Refuses a hole that a flat cap does not close in the only sensible way."""
    advice = "close it, or use the mesh as an 'obstacle', which keeps the body off its surface"
    place = f"hole {_describe(loop)}"
    if crosses_entry:
        raise FormatError(
            where,
            "as a cavity: lies partly in front of the entry plane and partly behind it; move the entry plane so "
            "that the whole opening is behind it if the body enters here",
            place,
        )
    if loop.flatness > FLATNESS_SHARE * loop.diameter:
        raise FormatError(
            where,
            f"as a cavity: its rim leaves its plane by {loop.flatness:.3g} m, so where the inside ends cannot be told; "
            f"{advice}",
            place,
        )
    if loop.steepness < TEAR_STEEPNESS:
        raise FormatError(where, f"as a cavity: a tear in the wall, so its inside leaks out there; {advice}", place)


def _describe(loop: Loop) -> str:
    return f"at {format_point(loop.centre)}, {loop.diameter:.3g} m across"


def format_point(point: FloatArray) -> str:
    """Returns a point, shape (3,), m, for a message, to 0.01 mm."""
    rounded = np.round(point, POINT_DIGITS) + 0.0  # which makes -0 a 0
    return f"({', '.join(np.format_float_positional(value, trim='-') for value in rounded)}) m"
