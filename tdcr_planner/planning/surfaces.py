"""The surfaces of a scene as a scenario names them: meshes, volumes and point clouds, each with all that it needs."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.bounds import PLACE_M
from tdcr_planner.collision.mesh_files.registry import find_format, mesh_sha256
from tdcr_planner.collision.roles import MESH_ROLES
from tdcr_planner.collision.volumes.cut import cut_surface
from tdcr_planner.collision.volumes.formats import read_volume, read_volume_grid, volume_sha256
from tdcr_planner.collision.volumes.surface import Region, region_surface
from tdcr_planner.files import FileModel, NotNegative, Positive, Vector3, check_file, sha256_of_file

# What loads surfaces imports numba: reading a scenario does not wait for it.
if TYPE_CHECKING:
    from tdcr_planner.collision.meshes import SceneMesh

MOST_SHOWN_POINTS = 20_000
"""Of a cloud, in pictures."""
_MM3 = 1e-9

Place = Annotated[float, AfterValidator(PLACE_M.validate)]
Point = tuple[Place, Place, Place]


def check_one_of(name: str, known: Iterable[str]) -> str:
    """Returns a name, or raises ValueError, which lists the valid ones, where it is none of them."""
    names = [repr(item) for item in known]
    if repr(name) not in names:
        raise ValueError(f"expected {', '.join(names[:-1])} or {names[-1]}, got {name!r}")
    return name


def _check_role(name: str) -> str:
    return check_one_of(name, MESH_ROLES)


Role = Annotated[str, AfterValidator(_check_role)]
"""Name of a role of meshes."""


def check_direction(direction: Vector3 | None) -> Vector3 | None:
    """Returns a direction, or raises ValueError where it has no length."""
    if direction is not None and np.linalg.norm(direction) < 1e-9:
        raise ValueError(f"expected a direction of length above 0, got {list(direction)}")
    return direction


class Entry(FileModel):
    """The plane through which the body enters a cavity: point_m and normal (pointing in), world frame."""

    point_m: Point
    normal: Vector3

    _check_normal = field_validator("normal")(check_direction)


class SurfaceEntry(FileModel):
    """What every kind of surface has.

    Attributes:
        file: Path of the file, relative to the scenario file.
        role: Name in `MESH_ROLES`. "cavity": the body stays inside; "obstacle": it stays outside of a closed surface
            and off an open one.
        entry: For a cavity, the plane behind which the body may be outside; None for the base plane at insertion 0.
    """

    table: ClassVar[str]
    file: Annotated[str, Field(min_length=1)]
    role: Role
    entry: Entry | None = None

    @model_validator(mode="after")
    def _check_entry(self) -> SurfaceEntry:
        if self.entry is not None and not MESH_ROLES[self.role].keeps_inside:
            raise ValueError(f"entry belongs to a surface of role 'cavity', this one is an {self.role!r}")
        return self

    def check_file(self, path: Path) -> None:
        """Raises FormatError unless there is such a file."""
        check_file(path)

    def sha256(self, path: Path) -> str:
        """Returns the SHA-256 of all files that the surface lies in."""
        return sha256_of_file(path)

    def error(self, path: Path) -> float:  # noqa: ARG002
        """Returns how far the triangles may lie from the true surface, m; it is added to the required clearance."""
        return 0.0

    def load(self, path: Path, name: str, point: ArrayLike | None, normal: ArrayLike | None) -> SceneMesh:
        """Returns the surface in its role, in metres and the world frame.

        Args:
            path: The file, absolute.
            name: What to call it in messages.
            point: A point of a cavity's entry plane, shape (3,), m, or None.
            normal: Its normal, into the cavity, shape (3,), or None.
        """
        raise NotImplementedError

    def triangles(self, path: Path) -> tuple[FloatArray, IntArray]:
        """Returns what to draw: vertices, shape (v, 3), m, world frame, and faces, shape (f, 3)."""
        raise NotImplementedError

    def facts(self) -> dict[str, object]:
        """Returns what decides the surface besides its file and entry plane, as JSON has it."""
        return self.model_dump(mode="json", exclude={"file", "entry"})

    def describe(self) -> str:
        """Returns a line for people."""
        return f"{self.table.removesuffix('s')} {self.file} as {self.role}"


class MeshEntry(SurfaceEntry):
    """A mesh of the scene.

    Attributes:
        unit: The file's unit of length; it may be left out for STEP and IGES, which state theirs.
    """

    table: ClassVar[str] = "meshes"
    unit: Annotated[Literal["m", "cm", "mm", "in"] | None, Field(validate_default=True)] = None

    @field_validator("unit")
    @classmethod
    def _check_unit(cls, unit: str | None, info: ValidationInfo) -> str | None:
        states_unit = str(info.data.get("file", "")).lower().endswith((".step", ".stp", ".iges", ".igs"))
        if unit is None and not states_unit:
            raise ValueError("missing, and it is required; valid: m, cm, mm, in")
        if unit is not None and states_unit:
            raise ValueError("expected none, because the file states its own; leave it out")
        return unit

    def sha256(self, path: Path) -> str:
        """Returns the SHA-256 of the file and of those that it names."""
        return mesh_sha256(path)

    def error(self, path: Path) -> float:
        """Returns the distance of a tessellation from its solid, m; 0 for a file of triangles."""
        return find_format(path).surface_error

    def load(self, path: Path, name: str, point: ArrayLike | None, normal: ArrayLike | None) -> SceneMesh:
        """Returns the mesh in its role; see `SurfaceEntry.load`."""
        from tdcr_planner.collision.meshes import load_scene_mesh

        return load_scene_mesh(path, self.unit, self.role, point, normal, name)

    def triangles(self, path: Path) -> tuple[FloatArray, IntArray]:
        """Returns the triangles of the file; see `SurfaceEntry.triangles`."""
        from tdcr_planner.collision.meshes import read_triangles

        return read_triangles(path, self.unit)

    def describe(self) -> str:
        """Returns a line for people."""
        return f"mesh {self.file} in {self.unit or 'its own unit'} as {self.role}"


class Cut(FileModel):
    """A plane that cuts a surface: what lies on the side of its normal stays, world frame."""

    point_m: Point
    normal: Vector3

    _check_normal = field_validator("normal")(check_direction)


class VolumeEntry(SurfaceEntry):
    """A region of a volume of voxels, such as a segmented CT.

    Attributes:
        label: The value of the voxels inside.
        threshold: In place of a label: the lowest value inside, or the lowest and the highest.
        least_part_mm3: Pieces of less volume are left out and said.
        cut: Planes that open the surface: what lies behind one is left out.
    """

    table: ClassVar[str] = "volumes"
    label: Annotated[int, Field(ge=0, le=2**31)] | None = None
    threshold: float | tuple[float, float] | None = None
    least_part_mm3: NotNegative = 10.0
    cut: Annotated[tuple[Cut, ...], Field(max_length=100)] = ()

    @model_validator(mode="after")
    def _check_region(self) -> VolumeEntry:
        if (self.label is None) == (self.threshold is None):
            raise ValueError("expected exactly one of label and threshold")
        if isinstance(self.threshold, tuple) and self.threshold[0] >= self.threshold[1]:
            raise ValueError(f"threshold: expected [low, high] with low below high, got {list(self.threshold)}")
        return self

    @property
    def region(self) -> Region:
        """Which voxels are inside."""
        low_high: tuple[float | None, float | None] | None = None
        if self.threshold is not None:
            low_high = self.threshold if isinstance(self.threshold, tuple) else (self.threshold, None)
        return Region(self.label, low_high, _MM3 * self.least_part_mm3)

    def check_file(self, path: Path) -> None:
        """Raises FormatError unless there is such a volume with a header that says where its voxels lie."""
        read_volume_grid(path)

    def sha256(self, path: Path) -> str:
        """Returns the SHA-256 of all files of the volume."""
        return volume_sha256(path)

    def error(self, path: Path) -> float:
        """Returns half of a voxel's diagonal, m: how far the surface may be from the boundary of the voxels."""
        return read_volume_grid(path).surface_error

    def load(self, path: Path, name: str, point: ArrayLike | None, normal: ArrayLike | None) -> SceneMesh:
        """Returns the region's surface in its role; see `SurfaceEntry.load`."""
        from tdcr_planner.collision.meshes import SceneMesh

        vertices, faces = self.triangles(path)
        return SceneMesh.from_arrays(name, vertices, faces, self.role, point, normal, source=path)

    def triangles(self, path: Path) -> tuple[FloatArray, IntArray]:
        """Returns the region's surface, cut; see `SurfaceEntry.triangles`."""
        vertices, faces = _volume_surface(path, self.sha256(path), self.region, not MESH_ROLES[self.role].keeps_inside)
        for plane in self.cut:
            vertices, faces = cut_surface(path, vertices, faces, np.array(plane.point_m), np.array(plane.normal))
        return vertices, faces


@lru_cache(maxsize=4)
def _volume_surface(path: Path, digest: str, region: Region, closed: bool) -> tuple[FloatArray, IntArray]:  # noqa: ARG001
    """Returns a region's surface; the digest of the file makes a changed file another one."""
    return region_surface(path, read_volume(path), region, closed=closed)


class CloudEntry(SurfaceEntry):
    """A point cloud, such as a laser scan: the body keeps off every point.

    Attributes:
        unit: The file's unit of length.
        point_radius_m: Distance that is kept from each point in addition to the clearance: half of the widest gap
            between neighbouring points, or more, makes a wall of them.
    """

    table: ClassVar[str] = "clouds"
    role: Role = "obstacle"
    unit: Literal["m", "cm", "mm", "in"]
    point_radius_m: Annotated[Positive, AfterValidator(PLACE_M.validate)]

    @model_validator(mode="after")
    def _check_role(self) -> CloudEntry:
        if MESH_ROLES[self.role].keeps_inside:
            raise ValueError("role: a point cloud has no inside; expected 'obstacle', which keeps the body off it")
        return self

    def error(self, path: Path) -> float:  # noqa: ARG002
        """Returns the radius of the points, m."""
        from tdcr_planner.collision.clouds.obstacle import cloud_error

        return cloud_error(self.point_radius_m)

    def load(self, path: Path, name: str, point: ArrayLike | None, normal: ArrayLike | None) -> SceneMesh:  # noqa: ARG002
        """Returns the cloud as an obstacle; see `SurfaceEntry.load`."""
        from tdcr_planner.collision.clouds.obstacle import load_cloud

        return load_cloud(path, self.unit, self.point_radius_m, name)

    def triangles(self, path: Path) -> tuple[FloatArray, IntArray]:
        """Returns an octahedron at each point, of at most `MOST_SHOWN_POINTS`."""
        from tdcr_planner.collision.clouds.obstacle import read_points

        points = read_points(path, self.unit)
        shown = points[:: -(-len(points) // MOST_SHOWN_POINTS)]
        corners = self.point_radius_m * np.concatenate([np.eye(3), -np.eye(3)])
        sides = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
        vertices = (shown[:, None] + corners).reshape(-1, 3)
        return vertices, (sides + 6 * np.arange(len(shown))[:, None, None]).reshape(-1, 3)

    def describe(self) -> str:
        """Returns a line for people."""
        return f"cloud {self.file} in {self.unit}, points of {1e3 * self.point_radius_m:g} mm radius"


def place_names(entries: Iterable[SurfaceEntry]) -> list[str]:
    """Returns the key of each surface in its scenario, counted from 1 within its table, as "volumes[2]"."""
    counts: dict[str, int] = {}
    names = []
    for entry in entries:
        counts[entry.table] = counts.get(entry.table, 0) + 1
        names.append(f"{entry.table}[{counts[entry.table]}]")
    return names
