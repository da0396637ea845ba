"""FCL's part: the solids and meshes as FCL objects that are made once and moved, and their exact contacts."""

from __future__ import annotations

from dataclasses import dataclass

import fcl
import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.meshes import SceneMesh


@dataclass(frozen=True)
class Touch:
    """Where a solid touches a mesh: triangle, an index into the mesh's `wall_faces`, and point, shape (3,), m."""

    triangle: int
    point: FloatArray


class MeshObject:
    """A scene mesh in FCL, with its bounding volume hierarchy."""

    def __init__(self, mesh: SceneMesh) -> None:
        """Builds the hierarchy."""
        vertices, faces = mesh.wall_vertices, mesh.wall_faces
        self._model = fcl.BVHModel()
        self._model.beginModel(len(faces), len(vertices))
        self._model.addSubModel(vertices, faces)
        self._model.endModel()
        self.handle = fcl.CollisionObject(self._model)


class BodyObjects:
    """A body's solids in FCL; placed for one state at a time, hence not to be shared between threads."""

    def __init__(self, body: RobotBody) -> None:
        """Makes an object a solid."""
        arrays = body.arrays
        self._shapes = [
            fcl.Capsule(float(radius), 1.0) if ends else fcl.Cylinder(float(radius), 1.0)
            for radius, ends in zip(arrays.radius, arrays.round_ends, strict=True)
        ]
        self._objects = [fcl.CollisionObject(shape) for shape in self._shapes]
        self._request = fcl.CollisionRequest()
        self._contact_request = fcl.CollisionRequest(num_max_contacts=1, enable_contact=True)
        self._result = fcl.CollisionResult()
        self._placed = np.zeros(len(self._shapes), dtype=np.bool_)

    def start(self, centres: FloatArray, frames: FloatArray, halves: FloatArray) -> None:
        """Takes a state's poses as `place_solids` returns them; solids are moved when they are first asked for."""
        self._centres, self._frames, self._halves = centres, frames, halves
        self._placed[:] = False

    def touches(self, solid: int, mesh: MeshObject) -> bool:
        """Returns whether a solid touches a mesh's surface."""
        if not self._place(solid):
            return False
        return fcl.collide(self._objects[solid], mesh.handle, self._request, self._result) > 0

    def touches_solid(self, solid: int, other: int) -> bool:
        """Returns whether two solids touch."""
        if not (self._place(solid) and self._place(other)):
            return False
        return fcl.collide(self._objects[solid], self._objects[other], self._request, self._result) > 0

    def touch(self, solid: int, mesh: MeshObject) -> Touch | None:
        """Returns where a solid touches a mesh's surface, or None."""
        if not self._place(solid):
            return None
        result = fcl.CollisionResult()
        if fcl.collide(self._objects[solid], mesh.handle, self._contact_request, result) == 0:
            return None
        contact = result.contacts[0]
        # FCL orders the pair by type, so the triangle may stand on either side; the solid's side holds -1.
        return Touch(int(max(contact.b1, contact.b2)), np.asarray(contact.pos, dtype=np.float64))

    def _place(self, solid: int) -> bool:
        """Moves a solid unless that is done; false for a shaft that is not out."""
        if self._halves[solid] < 0.0:
            return False
        if not self._placed[solid]:
            # FCL measures the shape, not the object's stored box, when a solid meets a mesh, so the length may change.
            self._shapes[solid].lz = 2.0 * float(self._halves[solid])
            self._objects[solid].setRotation(self._frames[solid])
            self._objects[solid].setTranslation(self._centres[solid])
            self._placed[solid] = True
        return True
