"""The volume formats that are read: NIfTI, NRRD, MetaImage and folders of DICOM slices."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from tdcr_planner.collision.volumes.dicom import DICOM
from tdcr_planner.collision.volumes.image import Volume, VolumeFormat, VolumeGrid
from tdcr_planner.collision.volumes.itk import METAIMAGE, NRRD
from tdcr_planner.collision.volumes.nifti import NIFTI
from tdcr_planner.errors import FormatError
from tdcr_planner.inputs import check_file, check_name, read_bytes

FORMATS = (NIFTI, NRRD, METAIMAGE)


def find_volume_format(path: Path) -> VolumeFormat:
    """Returns the format of a file, by its name's ending, or of a folder of slices.

    Raises:
        FormatError: There is no such file, or its ending is not known.
    """
    check_name(path)
    if path.is_dir():
        return DICOM
    check_file(path)
    for candidate in FORMATS:
        if path.name.lower().endswith(candidate.suffixes):
            return candidate
    valid = ", ".join(suffix for candidate in FORMATS for suffix in candidate.suffixes)
    raise FormatError(
        path, f"cannot be read as a volume: unknown ending {path.suffix!r}; valid: {valid}, or a folder of DICOM slices"
    )


def read_volume_grid(path: Path) -> VolumeGrid:
    """Returns where the voxels of a volume lie, from its header; raises FormatError where it does not say."""
    return find_volume_format(path).read_grid(path)


def read_volume(path: Path) -> Volume:
    """Returns a volume; a file that is cut off or damaged is refused with FormatError."""
    volume = find_volume_format(path).read(path)
    if volume.values.dtype.kind not in "uib":
        bad = np.argwhere(~np.isfinite(volume.values))
        if len(bad):
            raise FormatError(path, "is not finite", f"voxel {bad[0].tolist()}")
    return volume


def volume_sha256(path: Path) -> str:
    """Returns the SHA-256 of all files that a volume lies in."""
    digests = [hashlib.sha256(read_bytes(part)).digest() for part in find_volume_format(path).parts(path)]
    return hashlib.sha256(b"".join(digests)).hexdigest()
