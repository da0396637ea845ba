"""The line from a cavity's mouth into its depth along which a body has most room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.containment import make_side
from tdcr_planner.collision.field import build_field
from tdcr_planner.collision.meshes import Entry, SceneMesh

NODES = 120_000
_STEPS = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) > (0, 0, 0)]


@dataclass(frozen=True)
class Centreline:
    """A line along which a ball moves into a cavity.

    Attributes:
        points: Shape (n, 3), m, from the mouth inward.
        rooms: Distance of each point from the wall, shape (n,), m.
        depths: Length of the line from the mouth to each point, shape (n,), m.
    """

    points: FloatArray
    rooms: FloatArray
    depths: FloatArray

    def narrowest(self) -> tuple[float, float]:
        """Returns the least room on the line, m, and its depth, m."""
        place = int(self.rooms.argmin())
        return float(self.rooms[place]), float(self.depths[place])


def find_centreline(mesh: SceneMesh, entry: Entry, radius: float) -> Centreline | None:
    """Returns the line from a cavity's mouth to the farthest place that a ball reaches, or None where it gets nowhere.

    The line is the shortest on a grid of distances from the wall, where a step costs the more the nearer the wall is.

    Args:
        mesh: A cavity.
        entry: Its entry plane, whose point is the middle of the mouth.
        radius: Radius of the ball, m.
    """
    field = build_field(mesh, make_side(mesh), NODES, keep=False)
    shape = tuple(int(count) for count in field.shape)
    rooms = field.values.reshape(shape).astype(np.float64)
    index = np.stack(np.meshgrid(*(np.arange(count) for count in shape), indexing="ij"), axis=-1)
    points = field.origin + field.spacing * index
    inside = (rooms > radius) & (entry.depth(points) > 0.0)
    number = np.full(shape, -1)
    number[inside] = np.arange(inside.sum())
    if not inside.any():
        return None
    place, room = points[inside], rooms[inside]
    rows, columns, costs = [], [], []
    for step in _STEPS:
        here = tuple(slice(max(0, -d), count - max(0, d)) for d, count in zip(step, shape, strict=True))
        there = tuple(slice(max(0, d), count - max(0, -d)) for d, count in zip(step, shape, strict=True))
        a, b = number[here].ravel(), number[there].ravel()
        both = (a >= 0) & (b >= 0)
        a, b = a[both], b[both]
        length = field.spacing * np.sqrt(sum(d * d for d in step))
        rows.append(a)
        columns.append(b)
        costs.append(length * (1.0 + (2.0 * radius / (0.5 * (room[a] + room[b]))) ** 2))
    graph = coo_matrix(
        (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), shape=(len(place), len(place))
    ).tocsr()
    mouth = np.linalg.norm(place - entry.point, axis=1)
    near = np.flatnonzero(mouth < 4.0 * radius + 2.0 * field.spacing)
    if not len(near):
        return None
    start = int(near[room[near].argmax()])
    distance, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    reached = np.flatnonzero(np.isfinite(distance))
    # The deepest place, as the body travels: costs grow with depth.
    node = int(reached[distance[reached].argmax()])
    line = [node]
    while line[-1] != start:
        line.append(int(before[line[-1]]))
    line.reverse()
    found = _smoothed(np.concatenate([entry.point[None], place[line]]))
    depths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(found, axis=0), axis=1))])
    return Centreline(found, np.concatenate([room[[line[0]]], room[line]]), depths)


def _smoothed(points: FloatArray) -> FloatArray:
    """Returns a line with the corners of the grid rounded off; its ends stay."""
    result = points.copy()
    for _ in range(3):
        result[1:-1] = 0.25 * result[:-2] + 0.5 * result[1:-1] + 0.25 * result[2:]
    return result
