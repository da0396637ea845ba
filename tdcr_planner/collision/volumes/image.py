"""A volume: voxel values and where each voxel's centre lies in the file's own world frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError

MOST_VOXELS = 2_000_000_000
"""Of a volume: a CT of the whole body has about 1e9."""
METRES_PER_MM = 1e-3
SMALLEST_VOXEL_M, LARGEST_VOXEL_M = 1e-7, 0.1


@dataclass(frozen=True, eq=False)
class VolumeGrid:
    """Where the voxels of a volume lie, as its file's header says.

    Attributes:
        shape: Number of voxels along each index i, j, k.
        world_from_index: Affine map of voxel indices to voxel centres, shape (4, 4), m, the file's world frame.
        frame: The axes of the world frame: "RAS" (x to the right, y to the front, z up) or "LPS" (x to the left, y to
            the back, z up), of a patient.
    """

    shape: tuple[int, int, int]
    world_from_index: FloatArray
    frame: str

    @property
    def surface_error(self) -> float:
        """Largest distance between the surface by marching cubes and the boundary of the voxels, m.

        The surface and the boundary pass through the same cells between eight voxel centres, and the middle of such a
        cell lies on the boundary: half of a voxel's longest diagonal is a bound in both directions.
        """
        edges = self.world_from_index[:3, :3]
        return max(0.5 * float(np.linalg.norm(edges @ np.array(signs))) for signs in product((1.0, -1.0), repeat=3))

    @property
    def voxel_volume(self) -> float:
        """Volume of a voxel, m^3."""
        return abs(float(np.linalg.det(self.world_from_index[:3, :3])))


@dataclass(frozen=True, eq=False)
class Volume:
    """A volume as it was read: its grid and its values, an array of the grid's shape."""

    grid: VolumeGrid
    values: NDArray[Any]


@dataclass(frozen=True)
class VolumeFormat:
    """A volume format.

    Attributes:
        name: What to call it in messages.
        suffixes: Endings of its files' names, in lower case; empty for folders.
        read_grid: Returns where the voxels lie, from the header alone.
        read: Returns the whole volume.
        parts: Returns the files that a volume lies in, itself first.
    """

    name: str
    suffixes: tuple[str, ...]
    read_grid: Callable[[Path], VolumeGrid]
    read: Callable[[Path], Volume]
    parts: Callable[[Path], tuple[Path, ...]] = lambda path: (path,)


def check_grid(path: Path, shape: tuple[int, ...], world_from_index: FloatArray, frame: str) -> VolumeGrid:
    """Returns the grid of a volume's header, or raises FormatError where it says no places in space.

    Args:
        path: The file, for messages.
        shape: Number of voxels along each index.
        world_from_index: Shape (4, 4), m.
        frame: "RAS" or "LPS".
    """
    if len(shape) != 3 or min(shape) < 2:
        raise FormatError(path, f"expected a volume of at least 2 voxels along each of three indices, got {shape}")
    if np.prod([float(count) for count in shape]) > MOST_VOXELS:
        raise FormatError(path, f"holds {shape} voxels, at most {MOST_VOXELS:.0e} are read; crop the volume")
    affine = np.asarray(world_from_index, dtype=np.float64)
    if not np.isfinite(affine).all():
        raise FormatError(path, "its map of voxels to places is not finite: it states no spacing")
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    if not ((spacing >= SMALLEST_VOXEL_M) & (spacing <= LARGEST_VOXEL_M)).all():
        raise FormatError(
            path,
            f"expected a spacing between {1e3 * SMALLEST_VOXEL_M:g} and {1e3 * LARGEST_VOXEL_M:g} mm, got "
            f"{' x '.join(f'{1e3 * value:g}' for value in spacing)} mm; does the file state its spacing, and in mm?",
        )
    if abs(float(np.linalg.det(affine[:3, :3] / spacing))) < 1e-3:
        raise FormatError(path, "its three axes lie in one plane: the map of voxels to places is damaged")
    return VolumeGrid((shape[0], shape[1], shape[2]), affine, frame)
