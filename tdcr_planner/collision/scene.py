"""The scene: whether, where and how closely the robot's body meets the meshes and itself."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tdcr_planner.arrays import BoolArray, FloatArray
from tdcr_planner.collision.body import RobotBody, place_solids
from tdcr_planner.collision.clearance import clearances
from tdcr_planner.collision.containment import make_side, wrong_part
from tdcr_planner.collision.field import CELLS, build_field, share_nodes
from tdcr_planner.collision.meshes import SceneMesh, format_point
from tdcr_planner.collision.narrow import BodyObjects, MeshObject
from tdcr_planner.collision.part_room import HELD, part_rooms
from tdcr_planner.collision.prover import ClearanceProver
from tdcr_planner.collision.room import SplitCells, make_split_cells, signed_distance
from tdcr_planner.collision.self_contact import make_self_pairs, near_pairs
from tdcr_planner.collision.settle import screen, settle_batch
from tdcr_planner.errors import InputError

logger = logging.getLogger(__name__)

Codes = NDArray[np.int8]
MAX_SELF_PAIRS = 4096
# Without a settling field a small one still orders the search for clearances.
COARSE_CELLS = 1000
# A field's spacing is no finer than the smallest disk's radius divided by this.
NODES_PER_RADIUS = 8.0
# A mesh of a length beyond these shares of the robot's was most likely read in the wrong unit.
TOO_LARGE, TOO_SMALL = 20.0, 0.01


class Verdict(IntEnum):
    """What a state's body does.

    FREE: it touches nothing and is on the right side of every mesh. OBSTACLE: it touches an obstacle or is inside one.
    CAVITY: it touches a cavity's wall or is outside of it. SELF: it touches itself. UNDEFINED: a pose is not finite.
    """

    FREE = 0
    OBSTACLE = 1
    CAVITY = 2
    SELF = 3
    UNDEFINED = 4


@dataclass(frozen=True)
class Contact:
    """The first contact of a state, tip first.

    Attributes:
        mesh: Name of the mesh, or "robot" for self-collision, or "" where a pose is not finite.
        part: "disk 7", "gap 3" or "shaft"; two of them joined by " and " for self-collision.
        triangle: Index into the mesh's faces; len(faces) and above for the flat cap of an opening; -1 where no
            surface is touched (the part is on the wrong side, or touches the robot itself).
        point: Where, shape (3,), m, world frame: on the surface, or the part's middle where none is touched.
        verdict: What it means.
    """

    mesh: str
    part: str
    triangle: int
    point: FloatArray
    verdict: Verdict

    def __str__(self) -> str:
        """Returns a sentence for a message."""
        place = format_point(self.point)
        part = " and ".join(_name_disks(name) for name in self.part.split(" and "))
        if self.verdict is Verdict.SELF:
            return f"{part} touch each other near {place}"
        if self.verdict is Verdict.UNDEFINED:
            return f"the pose of {part} is not finite"
        if self.triangle >= 0:
            return f"{part} touches {self.mesh} (triangle {self.triangle}) at {place}"
        side = "inside of" if self.verdict is Verdict.OBSTACLE else "outside of"
        return f"{part} is {side} {self.mesh} at {place}"


UNDEFINED_CODE = np.int8(Verdict.UNDEFINED)


def _name_disks(part: str) -> str:
    """Returns a part's name, for a gap with the disks on either side."""
    kind, _, number = part.partition(" ")
    return f"{part} (between disk {int(number) - 1} and disk {number})" if kind == "gap" else part


def _mesh_verdict(mesh: SceneMesh) -> Verdict:
    return Verdict.CAVITY if mesh.keeps_inside else Verdict.OBSTACLE


def _hint_at_units(meshes: Sequence[SceneMesh], body: RobotBody) -> None:
    for mesh in meshes:
        size = np.ptp(mesh.bounds, axis=0)
        ratio = float(size.max()) / body.robot.length
        if not TOO_SMALL <= ratio <= TOO_LARGE:
            read = f" after unit {mesh.unit!r}" if mesh.unit else ""
            logger.warning(
                "%s: its size%s is %s mm, %s times the robot's length; is its unit the right one?",
                mesh.name, read, " x ".join(f"{1e3 * length:.4g}" for length in size),
                f"{ratio:.0f}" if ratio > 1.0 else f"{ratio:.2g}",
            )  # fmt: skip


class CollisionScene:
    """The meshes of a scene and a robot's body among them.

    A scene moves its own FCL objects, so one scene serves one thread at a time.

    Attributes:
        meshes: The meshes.
        body: The body, grown by its margins.
        prover: Bounds what the body keeps beyond its margins, in and between states.
    """

    def __init__(
        self,
        meshes: Sequence[SceneMesh],
        body: RobotBody,
        *,
        field: Literal["auto"] | None = "auto",
        cells: int = CELLS,
    ) -> None:
        """Builds what is needed to answer.

        Args:
            meshes: The meshes; none at all leaves only self-collision.
            body: The body with its margins.
            field: "auto" to build or load a distance field a mesh; None to let FCL decide alone, which is slow. The
                answers are the same.
            cells: About how many nodes a field has at most.
        """
        self.meshes = tuple(meshes)
        self._mesh_objects = tuple(MeshObject(mesh) for mesh in self.meshes)
        self._sides = tuple(make_side(mesh) for mesh in self.meshes)
        self._settles = field is not None
        finest = float(body.robot.disk_radii.min()) / NODES_PER_RADIUS
        nodes = share_nodes(self.meshes, finest, cells if self._settles else COARSE_CELLS)
        self._fields = tuple(
            build_field(mesh, side, count, keep=self._settles)
            for mesh, side, count in zip(self.meshes, self._sides, nodes, strict=True)
        )
        self._codes = tuple(np.int8(_mesh_verdict(mesh)) for mesh in self.meshes)
        _hint_at_units(self.meshes, body)
        self._grown: dict[bytes, CollisionScene] = {}
        # Made at the first question about room; scenes grown by other margins share it.
        self._split: list[SplitCells] = []
        self._set_body(body)

    def _set_body(self, body: RobotBody) -> None:
        self.body = body
        self._objects = BodyObjects(body)
        self._self_pairs = make_self_pairs(body)
        self._near = np.zeros((MAX_SELF_PAIRS, 2), dtype=np.int64)
        self._bare = body.with_margins(np.zeros(body.robot.disk_count)).arrays
        self.prover = self.make_prover(body.margins)

    def with_margins(self, margins: ArrayLike) -> CollisionScene:
        """Returns the scene with the body grown by other margins, shape (d,), m; what was built is shared.

        The same margins give the same scene again: FCL's objects take milliseconds to make and leak a little.
        """
        key = np.asarray(margins, dtype=np.float64).tobytes()
        if key not in self._grown:
            scene = object.__new__(CollisionScene)
            scene.__dict__.update(self.__dict__)
            scene._set_body(self.body.with_margins(margins))
            self._grown[key] = scene
        return self._grown[key]

    def make_prover(self, margins: FloatArray) -> ClearanceProver:
        """Returns what bounds the body's slack beyond margins from walls, shape (d,), m.

        Between two parts of the body the scene's own margins count.
        """
        walls = (mesh.wall_tree for mesh in self.meshes)
        meshes = tuple(zip(self._fields, walls, self._sides, strict=True))
        required = self.body.part_margins(margins)
        return ClearanceProver(required, self._bare, self.body.arrays, self._self_pairs, meshes)

    def check(self, positions: ArrayLike, rotations: ArrayLike) -> Codes:
        """Returns the verdict on each state.

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).

        Returns:
            `Verdict` codes, shape (n,), int8. A state with several causes gets one of them.

        Raises:
            InputError: Wrong shapes. Poses that are not finite are no error but the verdict UNDEFINED.
        """
        return self._judge(*self._check_poses(positions, rotations), stop=False)

    def find_hit(self, positions: FloatArray, rotations: FloatArray) -> tuple[int, int]:
        """Looks for a state that is not free and stops at the first found, for when one decides about all.

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).

        Returns:
            The place of such a state and its verdict, or -1 and `Verdict.FREE` where all are free.
        """
        codes = self._judge(positions, rotations, stop=True)
        hits = np.flatnonzero(codes)
        return (int(hits[0]), int(codes[hits[0]])) if len(hits) else (-1, 0)

    def _judge(self, points: FloatArray, frames: FloatArray, stop: bool) -> Codes:
        """Returns the verdicts, shape (n,); with `stop` it ends once a state is not free, and zeros mean nothing."""
        arrays = self.body.arrays
        rows = len(points)
        codes = np.empty(rows, dtype=np.int8)
        near, open_rows = np.empty(rows, dtype=np.bool_), np.empty(rows, dtype=np.bool_)
        near_rows = screen(self._self_pairs, points, frames, UNDEFINED_CODE, codes, near)
        for index, mesh in enumerate(self.meshes):
            if stop and codes.any():
                return codes
            code = self._codes[index]
            if self._settles:
                undecided = np.zeros((rows, len(arrays.kind)), dtype=np.bool_)
                field, wall = self._fields[index], mesh.wall_tree
                if settle_batch(field, wall, code, arrays, points, frames, codes, undecided, open_rows, stop) == 0:
                    continue
            else:
                undecided = np.ones((rows, len(arrays.kind)), dtype=np.bool_)
                open_rows = codes == 0
            for row in np.flatnonzero(open_rows).tolist():
                if stop and codes.any():
                    return codes
                if self._meets(index, points[row], frames[row], np.flatnonzero(undecided[row]).tolist()):
                    codes[row] = code
        if near_rows:
            for row in np.flatnonzero(near & (codes == 0)).tolist():
                if stop and codes.any():
                    return codes
                self._objects.start(*place_solids(arrays, points[row], frames[row]))
                if self._self_contact(points[row]) is not None:
                    codes[row] = Verdict.SELF
        return codes

    def _meets(self, index: int, positions: FloatArray, rotations: FloatArray, solids: list[int]) -> bool:
        """Returns whether one of some solids touches a mesh or, none touching, the body is on its wrong side.

        The other solids are known to touch nothing.
        """
        self._objects.start(*place_solids(self.body.arrays, positions, rotations))
        handle = self._mesh_objects[index]
        if any(self._objects.touches(solid, handle) for solid in solids):
            return True
        return bool(wrong_part(self._sides[index], self.body.arrays, positions, rotations) >= 0)

    def first_contact(self, positions: ArrayLike, rotations: ArrayLike) -> Contact | None:
        """Returns what one state's body meets first, tip first, or None where it is free.

        Surfaces come before sides and these before self-collision, as FCL alone decides them: the field is not asked.

        Args:
            positions: Disk centres, shape (d, 3), m, world frame.
            rotations: world_from_disk, shape (d, 3, 3).
        """
        points, frames = self._check_poses(np.asarray(positions)[None], np.asarray(rotations)[None])
        point, frame = points[0], frames[0]
        undefined = np.flatnonzero(~(np.isfinite(point).all(axis=1) & np.isfinite(frame).all(axis=(1, 2))))
        if len(undefined):
            disk = int(undefined[0])
            return Contact("", f"disk {disk}", -1, point[disk], Verdict.UNDEFINED)
        arrays = self.body.arrays
        centres, axes, halves = place_solids(arrays, point, frame)
        self._objects.start(centres, axes, halves)
        touched = next(self._surface_contacts(), None)
        if touched is not None:
            return touched
        for mesh, side in zip(self.meshes, self._sides, strict=True):
            part = int(wrong_part(side, arrays, point, frame))
            if part >= 0:
                middle = centres[arrays.part_first[part]].copy()
                return Contact(mesh.name, self.body.part_names[part], -1, middle, _mesh_verdict(mesh))
        pair = self._self_contact(point)
        if pair is not None:
            names = f"{self.body.part_names[pair[0]]} and {self.body.part_names[pair[1]]}"
            middle = centres[arrays.part_first[list(pair)]].mean(axis=0)
            return Contact("robot", names, -1, middle, Verdict.SELF)
        return None

    def contacts(self, positions: ArrayLike, rotations: ArrayLike) -> list[Contact]:
        """Returns what every part of one state's body meets, tip first: a contact for each surface that a part touches.

        Where no surface is touched, what `first_contact` says of sides and of the body itself is the only entry; an
        empty list stands for a free state.

        Args:
            positions: Disk centres, shape (d, 3), m, world frame.
            rotations: world_from_disk, shape (d, 3, 3).
        """
        first = self.first_contact(positions, rotations)
        if first is None or first.triangle < 0:
            return [] if first is None else [first]
        points, frames = self._check_poses(np.asarray(positions)[None], np.asarray(rotations)[None])
        self._objects.start(*place_solids(self.body.arrays, points[0], frames[0]))
        return list(self._surface_contacts())

    def _surface_contacts(self) -> Iterator[Contact]:
        """Yields the first contact of each part with each mesh's surface, tip first; the solids must be placed."""
        first = self.body.arrays.part_first
        for part, name in enumerate(self.body.part_names):
            met: set[int] = set()
            for solid in range(first[part], first[part + 1]):
                for index, (mesh, handle) in enumerate(zip(self.meshes, self._mesh_objects, strict=True)):
                    touch = None if index in met else self._objects.touch(solid, handle)
                    if touch is not None:
                        met.add(index)
                        yield Contact(mesh.name, name, touch.triangle, touch.point, _mesh_verdict(mesh))

    def clearance(self, positions: ArrayLike, rotations: ArrayLike) -> FloatArray:
        """Returns the distance of each state's body, without its margins, from the nearest surface.

        Where the body touches a surface or is on its wrong side the number is negative: minus the depth of the deepest
        of many balls inscribed in the body, a lower bound on how far it would have to move. Self-collision does not
        count. Without meshes it is infinite.

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).

        Returns:
            Shape (n,), m; minus infinity where a pose is not finite.
        """
        points, frames = self._check_poses(positions, rotations)
        # A sum is finite only if every term is.
        finite = np.isfinite(points.sum(axis=(1, 2)) + frames.sum(axis=(1, 2, 3)))
        best = np.full(len(points), np.inf)
        points, frames, measured = points[finite], frames[finite], best[finite]
        for index, mesh in enumerate(self.meshes):
            clearances(self._fields[index], mesh.wall_tree, self._sides[index], self._bare, points, frames, measured)
        best[finite] = measured
        best[~finite] = -np.inf
        return best

    def part_rooms(
        self, positions: FloatArray, rotations: FloatArray, most: float, held: FloatArray | None = None
    ) -> FloatArray:
        """Returns an estimate of each part's distance from the nearest surface, margins taken off, as a guide.

        It is negative where the part, grown by its margin, touches a surface or is on its wrong side: how deep. It is
        no bound; see `collision.part_room`. Self-collision does not count.

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).
            most: What is not exceeded, m: parts that have more are not looked at closely.
            held: Written where given: where the parts with less than `most` have it, shape (n, q, `part_room.HELD`).

        Returns:
            Shape (n, q), m, in the order of `RobotBody.part_names`; minus infinity where a pose is not finite.
        """
        finite = np.isfinite(positions.sum(axis=(1, 2)) + rotations.sum(axis=(1, 2, 3)))
        if not finite.all():
            found = np.full((len(positions), len(self.body.part_names)), -np.inf)
            places = None if held is None else held[finite]
            found[finite] = self.part_rooms(positions[finite], rotations[finite], most, places)
            if held is not None:
                held[finite] = places
            return found
        rooms = np.full((len(positions), len(self.body.part_names)), float(most))
        if not self._split:
            self._split.extend(
                make_split_cells(field, mesh.wall_tree, side)
                for mesh, side, field in zip(self.meshes, self._sides, self._fields, strict=True)
            )
        places = np.empty((0, 0, HELD)) if held is None else held
        for mesh, side, field, split in zip(self.meshes, self._sides, self._fields, self._split, strict=True):
            part_rooms(field, mesh.wall_tree, side, split, self.body.arrays, positions, rotations, rooms, places)
        return rooms

    def nearest_mesh(self, point: ArrayLike) -> tuple[float, str]:
        """Returns a point's distance from the nearest surface, m, negative on a mesh's wrong side, and the mesh's name.

        Where several meshes are in question, the one of least signed distance; infinity and "" without meshes.

        Args:
            point: Shape (3,), m, world frame.
        """
        x, y, z = (float(value) for value in np.asarray(point, dtype=np.float64))
        found = [
            (float(signed_distance(mesh.wall_tree, side, x, y, z)), mesh.name)
            for mesh, side in zip(self.meshes, self._sides, strict=True)
        ]
        return min(found, default=(float("inf"), ""))

    def touches_itself(self, positions: ArrayLike, rotations: ArrayLike) -> BoolArray:
        """Returns which states' bodies, margins included, touch themselves, shape (n,), whatever the meshes say.

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).
        """
        points, frames = self._check_poses(positions, rotations)
        codes, near = np.empty(len(points), dtype=np.int8), np.empty(len(points), dtype=np.bool_)
        screen(self._self_pairs, points, frames, UNDEFINED_CODE, codes, near)
        touching = np.zeros(len(points), dtype=np.bool_)
        for row in np.flatnonzero(near & (codes == 0)).tolist():
            self._objects.start(*place_solids(self.body.arrays, points[row], frames[row]))
            touching[row] = self._self_contact(points[row]) is not None
        return touching

    def _self_contact(self, positions: FloatArray) -> tuple[int, int] | None:
        """Returns two parts that touch, or None; the state's solids must be placed."""
        found = int(near_pairs(self._self_pairs, positions, 0.0, self._near))
        if found > len(self._near):
            self._near = np.zeros((found, 2), dtype=np.int64)
            near_pairs(self._self_pairs, positions, 0.0, self._near)
        first = self.body.arrays.part_first
        disks = len(positions)
        for k, j in self._near[:found].tolist():
            own = (2 * (disks - 1 - k), 2 * (disks - 1 - k) + 1)
            others = (2 * (disks - 1 - j), 2 * (disks - 1 - j) + 1) if j > 0 else (len(first) - 2,)
            for one in own:
                for other in others:
                    if self._self_pairs.allowed[one, other] and self._parts_touch(one, other):
                        return one, other
        return None

    def _parts_touch(self, one: int, other: int) -> bool:
        first = self.body.arrays.part_first
        return any(
            self._objects.touches_solid(a, b)
            for a in range(first[one], first[one + 1])
            for b in range(first[other], first[other + 1])
        )

    def _check_poses(self, positions: ArrayLike, rotations: ArrayLike) -> tuple[FloatArray, FloatArray]:
        disks = self.body.robot.disk_count
        points = np.ascontiguousarray(positions, dtype=np.float64)
        frames = np.ascontiguousarray(rotations, dtype=np.float64)
        if points.ndim != 3 or points.shape[1:] != (disks, 3):
            raise InputError("positions", f"shape (n, {disks}, 3)", f"shape {points.shape}")
        if frames.shape != (len(points), disks, 3, 3):
            raise InputError("rotations", f"shape ({len(points)}, {disks}, 3, 3)", f"shape {frames.shape}")
        return points, frames
