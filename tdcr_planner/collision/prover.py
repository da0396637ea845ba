"""The prover: whether a body keeps its required distance between states, from what each state keeps beyond it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.body import BodyArrays
from tdcr_planner.collision.containment import Side
from tdcr_planner.collision.field import Field
from tdcr_planner.collision.self_contact import SelfPairs
from tdcr_planner.collision.self_slack import prove_apart, self_slack
from tdcr_planner.collision.slack import SlackRecord, least_slack, part_distance, prove_intervals
from tdcr_planner.collision.tree import TriangleTree


class ClearanceProver:
    """Bounds a body's slack, which is what it keeps beyond its margins, in and between free states.

    Distances from walls are those of the body without margins less the margin of the part. For two parts of the body
    the margins of both count.

    Attributes:
        required: Distance that each part must keep from a wall, shape (q,), m.
    """

    def __init__(
        self,
        required: FloatArray,
        bare: BodyArrays,
        body: BodyArrays,
        pairs: SelfPairs,
        meshes: Sequence[tuple[Field, TriangleTree, Side]],
    ) -> None:
        """Prepares the prover.

        Args:
            required: Distance that each part must keep from a wall, shape (q,), m.
            bare: The body's solids without margins.
            body: The body's solids with the margins that count between its own parts.
            pairs: The pairs of its parts that count as self-collision.
            meshes: Field, tree of the walls and sides of each mesh.
        """
        self.required = required
        self._bare, self._body, self._pairs = bare, body, pairs
        self._meshes = tuple(meshes)

    def record(self, states: int) -> SlackRecord:
        """Returns a record for `open_intervals` of states of which nothing is known but that they are free."""
        return SlackRecord.empty(len(self._meshes), states, len(self.required))

    def open_intervals(
        self,
        positions: FloatArray,
        rotations: FloatArray,
        order: IntArray,
        motion: FloatArray,
        stray: FloatArray,
        record: SlackRecord,
        exact_below: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Returns which intervals between neighbouring free states are not proved to be free.

        Args:
            positions: Disk centres of the states, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).
            order: Indices that put the states in order, shape (n,).
            motion: How far the points of each disk move at most between neighbours, shape (n - 1, d), m.
            stray: How far they stray from straight lines at most, shape (n - 1, d), m; infinite where it is not known.
            record: What is known of the states' slack; what is found is written into it.
            exact_below: The slack of states is measured for motions up to this, m.

        Returns:
            Shape (n - 1,), m, each: the motion that there is room for, and the motion, where an interval is open; zeros
            where it is proved.
        """
        room, moved = np.zeros(len(order) - 1), np.zeros(len(order) - 1)
        prove_apart(
            self._pairs, self._body, positions, rotations, order, motion, record.apart, record.apart_exact, room, moved
        )
        for index, (field, wall, side) in enumerate(self._meshes):
            prove_intervals(
                field, wall, side, self._bare, self.required, positions, rotations, order, motion, stray, exact_below,
                record.slack[index], record.exact[index], room, moved,
            )  # fmt: skip
        return room, moved

    def slack(self, positions: FloatArray, rotations: FloatArray, cap: float) -> FloatArray:
        """Returns lower bounds on the slack of free states, `cap` at most, shape (n,), m.

        A state that moves by less than its slack stays free, as far as walls go; for the body's own parts by less than
        half of what they are apart, which the bound takes into account.

        Args:
            positions: Disk centres, shape (n, d, 3), m, world frame.
            rotations: world_from_disk, shape (n, d, 3, 3).
            cap: The most that is of interest, m; smaller values are found faster.
        """
        least = np.full(len(positions), float(cap))
        for row in range(len(positions)):
            least[row] = 0.5 * self_slack(self._pairs, self._body, positions[row], rotations[row], 2.0 * cap)
        for field, wall, side in self._meshes:
            least_slack(field, wall, side, self._bare, self.required, positions, rotations, least)
        return least

    def nearest(self, positions: FloatArray, rotations: FloatArray) -> tuple[int, int, float]:
        """Returns the part of one state's body with the least slack, the mesh that it is near to, and the distance, m.

        Args:
            positions: Disk centres, shape (d, 3), m, world frame.
            rotations: world_from_disk, shape (d, 3, 3).
        """
        found, least = (-1, -1, np.inf), np.inf
        for mesh, (_, wall, _) in enumerate(self._meshes):
            for part, required in enumerate(self.required.tolist()):
                distance = part_distance(wall, self._bare, part, positions, rotations, least + required)
                if distance - required < least:
                    found, least = (part, mesh, float(distance)), distance - required
        return found
