"""Reading NIfTI volumes: the map of the header's sform or qform is honoured whole, sheared axes included."""

from __future__ import annotations

import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.collision.volumes.image import METRES_PER_MM, Volume, VolumeFormat, VolumeGrid, check_grid
from tdcr_planner.errors import FormatError, MissingLibraryError
from tdcr_planner.inputs import open_file

_NIFTI_UNITS = {"mm": 1e-3, "meter": 1.0, "micron": 1e-6}
_MOST_AFTER = 1 << 20
"""Bytes of an unpacked file behind its voxels: extensions stand before them."""


def _import_nibabel(path: Path) -> Any:
    try:
        import nibabel
    except ImportError as error:
        raise MissingLibraryError(
            "nibabel", f"to read {path}", "all systems (pip install 'tdcr-planner[volumes]')"
        ) from error
    return nibabel


def _open_nifti(path: Path) -> tuple[Any, VolumeGrid]:
    nibabel = _import_nibabel(path)
    try:
        image = nibabel.load(path)
        header = image.header
        code = int(header["sform_code"]) or int(header["qform_code"])
        unit = str(header.get_xyzt_units()[0])
        affine = np.asarray(image.affine, dtype=np.float64)
        zooms = np.asarray(header["pixdim"][1:4], dtype=np.float64)
    except Exception as error:  # nibabel raises what zlib, numpy and its own checks raise
        raise FormatError(path, f"cannot be read as NIfTI: {error}") from error
    if not (np.isfinite(zooms).all() and (np.abs(zooms) > 0.0).all()):
        raise FormatError(path, f"states no spacing: pixdim is {zooms.tolist()}")
    if code == 0:
        raise FormatError(
            path, "states no orientation (sform and qform codes are 0): where its voxels lie is not known"
        )
    scale = _NIFTI_UNITS.get(unit, METRES_PER_MM)
    shape = tuple(int(count) for count in image.shape)
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    return image, check_grid(path, shape, np.diag([scale, scale, scale, 1.0]) @ affine, "RAS")


def _read_nifti(path: Path) -> Volume:
    image, grid = _open_nifti(path)
    try:
        if path.suffix.lower() == ".gz":
            image = _unpacked(path, image)
        proxy = image.dataobj
        plain = proxy.slope == 1.0 and proxy.inter == 0.0
        values = np.asarray(proxy.get_unscaled()) if plain else image.get_fdata(dtype=np.float32)
    except Exception as error:  # what zlib and the file system raise for a damaged file
        raise FormatError(path, f"is cut off or damaged: {error}") from error
    return Volume(grid, values.reshape(grid.shape))


def _unpacked(path: Path, image: Any) -> Any:
    """Returns a packed image read to its end: nibabel reads no farther than it must, and would miss the checksum."""
    itemsize = int(image.header.get_data_dtype().itemsize)
    expected = int(image.dataobj.offset) + itemsize * math.prod(int(count) for count in image.shape)
    with open_file(path) as stream, gzip.GzipFile(fileobj=stream) as packed:
        data = packed.read(expected + _MOST_AFTER + 1)
    if not expected <= len(data) <= expected + _MOST_AFTER:
        raise ValueError(f"expected {expected} bytes of header and voxels, got {len(data)}")
    return type(image).from_bytes(data)


NIFTI = VolumeFormat("NIfTI", (".nii", ".nii.gz"), lambda path: _open_nifti(path)[1], _read_nifti)
