"""The grid: cubes that fill a box, and which of them holds a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Grid:
    """Cubes that fill a box.

    Attributes:
        lower: Lower corner, shape (3,), m, world frame.
        size: Edge of a cell, m.
        shape: Number of cells along x, y and z.
    """

    lower: FloatArray
    size: float
    shape: tuple[int, int, int]

    @classmethod
    def of(cls, lower: FloatArray, upper: FloatArray, cells: int) -> Grid:
        """Returns a grid over a box of about so many cells."""
        sides = np.maximum(upper - lower, 1e-6)
        size = float((sides.prod() / cells) ** (1.0 / 3.0))
        counts = np.maximum(np.ceil(sides / size - 1e-9).astype(int), 1)
        return cls(np.asarray(lower, dtype=np.float64), size, (int(counts[0]), int(counts[1]), int(counts[2])))

    @property
    def cells(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))

    @property
    def centres(self) -> FloatArray:
        """Middle of each cell, shape (cells, 3), m."""
        places = np.stack(np.meshgrid(*(np.arange(count) for count in self.shape), indexing="ij"), axis=-1)
        return np.asarray(self.lower + self.size * (places.reshape(-1, 3) + 0.5))

    def find(self, points: FloatArray, margin: float = 0.0) -> IntArray:
        """Returns the cell of each point, shape (n,); -1 outside, or within a margin (m) of its cell's faces."""
        with np.errstate(invalid="ignore"):
            scaled = (points - self.lower) / self.size
            place = np.floor(scaled)
            off = np.abs(scaled - place - 0.5)
            inside = ((place >= 0) & (place < self.shape) & (off <= 0.5 - margin / self.size)).all(axis=1)
        cells = np.full(len(points), -1)
        cells[inside] = np.ravel_multi_index(tuple(place[inside].astype(np.int64).T), self.shape)
        return cells
