"""The visibility engine: a camera, the points of a surface and everything that may stand between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.meshes import SceneMesh
from tdcr_planner.collision.tree import build_tree
from tdcr_planner.inspection.camera import Camera
from tdcr_planner.inspection.targets import Targets
from tdcr_planner.inspection.visibility_kernels import Clusters, Lens, nearest_miss, see

_GROUP = 24  # points of a group at most


@dataclass(frozen=True)
class Views:
    """What states see of p points, with how they see it.

    Attributes:
        seen: Shape (n, p).
        distances: From the camera, shape (n, p), m; NaN where a point is not seen.
        cosines: Of the angle of incidence, shape (n, p); NaN where a point is not seen.
    """

    seen: BoolArray
    distances: FloatArray
    cosines: FloatArray


class Visibility:
    """Decides which points are seen from states of the robot.

    A point is seen where it lies in the camera's picture and range, within the angle of incidence on its visible side,
    and neither a triangle of the scene nor a solid of the robot stands between. Caps over a cavity's openings are no
    surface and hide nothing; the solids that hold the camera's centre carry it and hide nothing.

    Attributes:
        camera: The camera.
        targets: The points.
    """

    def __init__(self, camera: Camera, targets: Targets, meshes: Sequence[SceneMesh], body: RobotBody) -> None:
        """Prepares the tests.

        Args:
            camera: The camera.
            targets: The points.
            meshes: Everything that hides, world frame.
            body: The robot's solids, without margins.
        """
        self.camera = camera
        self.targets = targets
        self.body = body.arrays
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
        self.tree = build_tree(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))
        low, high = camera.range_m
        tangent_x, tangent_y = (float(value) for value in camera.tangents)
        self.lens = Lens(
            camera.position,
            np.ascontiguousarray(camera.axes),
            tangent_x,
            tangent_y,
            camera.rectangular,
            low,
            high,
            camera.cosine_of_incidence,
        )
        self.order, self.clusters = make_clusters(targets)
        self._back = np.argsort(self.order)
        self._warm_up(body.robot.disk_count)

    def _warm_up(self, disks: int) -> None:
        """Runs the compiled kernels once, so that compiling them does not count against a query's time limit."""
        positions, rotations = np.zeros((1, disks, 3)), np.tile(np.eye(3), (1, disks, 1, 1))
        self.seen(positions, rotations)
        self.views(positions, rotations)
        self.single_faults(positions, rotations, np.zeros(1, dtype=np.int64))

    def seen(self, positions: FloatArray, rotations: FloatArray) -> BoolArray:
        """Returns which points states see, shape (n, p).

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame; a state whose camera's pose is not finite sees
                nothing.
            rotations: world_from_disk, shape (n, d, 3, 3).
        """
        return self._see(positions, rotations, np.empty((0, 0, 2)))

    def views(self, positions: FloatArray, rotations: FloatArray) -> Views:
        """Returns which points states see and how; arguments as of `seen`."""
        how = np.full((len(positions), len(self.order), 2), np.nan)
        seen = self._see(positions, rotations, how)
        return Views(seen, how[:, self._back, 0], how[:, self._back, 1])

    def _see(self, positions: FloatArray, rotations: FloatArray, how: FloatArray) -> BoolArray:
        """Returns what `seen` does and writes how, in the order of the groups; see `visibility_kernels.see`."""
        seen = np.zeros((len(positions), len(self.order)), dtype=np.bool_)
        places, frames = np.ascontiguousarray(positions), np.ascontiguousarray(rotations)
        see(self.lens, self.clusters, self.tree, self.body, places, frames, seen, how)
        return np.asarray(seen[:, self._back])

    def single_faults(self, positions: FloatArray, rotations: FloatArray, which: IntArray) -> IntArray:
        """Returns what alone keeps points from being seen in some of the states, as bits, shape (q,).

        The bits are those of `visibility_kernels`; 32 where a state sees the point but for the robot's own body.

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).
            which: Numbers of the points, shape (q,).
        """
        found = np.zeros(len(which), dtype=np.int64)
        places, frames = np.ascontiguousarray(positions), np.ascontiguousarray(rotations)
        nearest_miss(self.lens, self.clusters, self.tree, places, frames, self._back[which], found)
        return found


def make_clusters(targets: Targets) -> tuple[IntArray, Clusters]:
    """Returns the order that puts neighbouring points together, shape (p,), and the points in it.

    The points are halved along the widest side of their box until a group is small enough.
    """
    groups: list[IntArray] = []
    waiting = [np.arange(len(targets.points))]
    while waiting:
        group = waiting.pop()
        if len(group) <= _GROUP:
            groups.append(group)
            continue
        points = targets.points[group]
        axis = int(np.ptp(points, axis=0).argmax())
        ordered = group[np.argsort(points[:, axis], kind="stable")]
        waiting += [ordered[len(ordered) // 2 :], ordered[: len(ordered) // 2]]
    order = np.concatenate(groups)
    centres = np.array([targets.points[group].mean(axis=0) for group in groups])
    radii = [
        float(np.linalg.norm(targets.points[group] - centre, axis=1).max())
        for group, centre in zip(groups, centres, strict=True)
    ]
    first = np.cumsum([0, *(len(group) for group in groups)])
    return order, Clusters(
        np.ascontiguousarray(targets.points[order]),
        np.ascontiguousarray(targets.normals[order]),
        targets.two_sided[order].astype(np.int64),
        first.astype(np.int64),
        centres,
        np.array(radii),
    )
