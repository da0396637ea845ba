"""The surface of a region of a volume: marching cubes between the voxels inside and those outside."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import BoolArray, FloatArray, IntArray
from tdcr_planner.collision.volumes.image import Volume, VolumeGrid
from tdcr_planner.errors import FormatError, MissingLibraryError

logger = logging.getLogger(__name__)

LABELS_SHOWN = 12


@dataclass(frozen=True)
class Region:
    """Which voxels of a volume are inside.

    Attributes:
        label: The value of the voxels inside; None where a range decides.
        threshold: Lowest and highest value inside, either of them None for no bound; None where a label decides.
        least_part: Pieces of less volume, m^3, are left out.
    """

    label: int | None = None
    threshold: tuple[float | None, float | None] | None = None
    least_part: float = 0.0


def region_surface(path: Path, volume: Volume, region: Region, *, closed: bool) -> tuple[FloatArray, IntArray]:
    """Returns the surface of a region: vertices, shape (v, 3), m, the file's world frame, and faces, shape (f, 3).

    Normals point out of the region. The distance between this surface and the boundary of the voxels is at most
    `VolumeGrid.surface_error`, in both directions (marching cubes: Lorensen and Cline 1987; here in the variant of
    Lewiner et al. 2003, whose surfaces are closed).

    Args:
        path: The file, for messages.
        volume: The volume.
        region: What is inside.
        closed: Whether the surface is closed where the region meets the volume's border; else it has an opening there.

    Raises:
        FormatError: No voxel is inside, or all are; the message says which values the volume holds.
    """
    inside = _inside(path, volume, region)
    corner, inside = _cropped(inside)
    inside = _without_crumbs(path, inside, volume.grid, region.least_part)
    # A layer of voxels around what was cropped; at the volume's border only where the surface is to be closed.
    pads = []
    for axis in range(3):
        at_low = corner[axis] == 0
        at_high = corner[axis] + inside.shape[axis] == volume.grid.shape[axis]
        pads.append((int(closed or not at_low), int(closed or not at_high)))
    padded = np.pad(inside, pads)
    if padded.all() or min(padded.shape) < 2:
        raise FormatError(path, "its region fills the whole volume: it has no surface")
    vertices, faces = _marching_cubes(path, padded)
    vertices += corner - np.array([low for low, _ in pads])
    affine = volume.grid.world_from_index
    points = vertices @ affine[:3, :3].T + affine[:3, 3]
    if np.linalg.det(affine[:3, :3]) < 0.0:  # a mirrored frame turns triangles around
        faces = faces[:, ::-1]
    return points, np.ascontiguousarray(faces, dtype=np.int64)


def _inside(path: Path, volume: Volume, region: Region) -> BoolArray:
    values = volume.values
    if region.label is not None:
        inside = np.asarray(values == region.label)
        if not inside.any():
            raise FormatError(path, f"has no voxel of label {region.label}; it holds {_held(values)}")
        return inside
    low, high = region.threshold or (None, None)
    inside = np.ones(values.shape, dtype=np.bool_)
    if low is not None:
        inside &= values >= low
    if high is not None:
        inside &= values <= high
    if not inside.any():
        raise FormatError(path, f"has no voxel within the threshold; its values are {_held(values)}")
    return inside


def _held(values: FloatArray) -> str:
    """Returns what values a volume holds, for a message."""
    if values.dtype.kind in "uib":
        found = np.unique(values)
        if len(found) <= LABELS_SHOWN:
            return "the labels " + ", ".join(str(value) for value in found.tolist())
    return f"between {values.min():g} and {values.max():g}"


def _cropped(inside: BoolArray) -> tuple[IntArray, BoolArray]:
    """Returns the first index of the smallest box around the voxels inside, shape (3,), and that box."""
    spans = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        used = np.flatnonzero(inside.any(axis=others))
        spans.append(slice(int(used[0]), int(used[-1]) + 1))
    return np.array([span.start for span in spans]), inside[tuple(spans)]


def _without_crumbs(path: Path, inside: BoolArray, grid: VolumeGrid, least: float) -> BoolArray:
    """Returns the voxels inside without pieces of less than some volume, m^3, and says how many were left out."""
    from scipy import ndimage

    pieces, count = ndimage.label(inside, structure=np.ones((3, 3, 3)))
    sizes = np.bincount(pieces.ravel())[1:] * grid.voxel_volume
    kept = sizes >= least
    if not kept.any():
        raise FormatError(
            path, f"its largest piece has {1e9 * sizes.max():.3g} mm^3, less than least_part_mm3 = {1e9 * least:g}"
        )
    if not kept.all():
        logger.info(
            "%s: %d of %d pieces, of up to %.3g mm^3, are left out",
            path,
            (~kept).sum(),
            count,
            1e9 * sizes[~kept].max(),
        )
    return np.asarray(np.concatenate([[False], kept])[pieces])


def _marching_cubes(path: Path, inside: BoolArray) -> tuple[FloatArray, IntArray]:
    try:
        from skimage.measure import marching_cubes
    except ImportError as error:
        raise MissingLibraryError(
            "scikit-image", f"to find the surface in {path}", "all systems (pip install 'tdcr-planner[volumes]')"
        ) from error
    vertices, faces, _, _ = marching_cubes(inside.astype(np.float32), 0.5, gradient_direction="ascent")
    return vertices.astype(np.float64), faces
