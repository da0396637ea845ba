"""Reading NRRD and MetaImage volumes with SimpleITK, after checks of what it would pass over."""

from __future__ import annotations

import warnings
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.volumes.image import METRES_PER_MM, Volume, VolumeFormat, VolumeGrid, check_grid
from tdcr_planner.errors import FormatError, MissingLibraryError
from tdcr_planner.inputs import check_file, read_bytes

_RAS_FROM_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


def import_sitk(path: Path) -> Any:
    """Returns SimpleITK, or raises MissingLibraryError that names the file to be read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of its SWIG classes
            import SimpleITK
    except ImportError as error:
        raise MissingLibraryError(
            "SimpleITK", f"to read {path}", "all systems (pip install 'tdcr-planner[volumes]')"
        ) from error
    return SimpleITK


def grid_of(path: Path, holder: Any, frame: str) -> VolumeGrid:
    """Returns the grid of what SimpleITK read, whose places are mm in LPS."""
    size = [int(count) for count in holder.GetSize()]
    spacing, origin = np.array(holder.GetSpacing()), np.array(holder.GetOrigin())
    direction = np.array(holder.GetDirection())
    while len(size) > 3 and size[-1] == 1:
        count = len(size)
        direction = direction.reshape(count, count)[:-1, :-1].ravel()
        size, spacing, origin = size[:-1], spacing[:-1], origin[:-1]
    if len(size) != 3:
        raise FormatError(path, f"expected a volume of three indices, got {len(size)}")
    affine = np.eye(4)
    affine[:3, :3] = METRES_PER_MM * direction.reshape(3, 3) * spacing
    affine[:3, 3] = METRES_PER_MM * origin
    if frame == "RAS":
        affine = _RAS_FROM_LPS @ affine
    return check_grid(path, tuple(size), affine, frame)


def _itk_reader(path: Path) -> tuple[Any, Any]:
    """Returns SimpleITK and a reader that has read the header."""
    sitk = import_sitk(path)
    _check_stated(path)
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        with redirect_stderr(StringIO()):
            reader.ReadImageInformation()
    except RuntimeError as error:
        raise FormatError(path, f"cannot be read: {last_line(error)}") from error
    if reader.GetNumberOfComponents() != 1:
        raise FormatError(path, f"expected one number a voxel, got {reader.GetNumberOfComponents()}")
    return sitk, reader


def _check_stated(path: Path) -> None:
    """Refuses a header without spacing, for which ITK would take 1 mm, or with axes that ITK would bend."""
    head = _header_lines(path)
    if path.suffix.lower() in (".mha", ".mhd"):
        keys = ("ElementSpacing", "ElementSize")
        if not any(line.split("=")[0].strip() in keys for line in head):
            raise FormatError(path, "states no spacing: ElementSpacing is missing")
    else:
        keys = ("space directions", "spacings")
        if not any(line.split(":")[0].strip().lower() in keys for line in head):
            raise FormatError(path, "states no spacing: neither `space directions` nor `spacings`")
    axes = _stated_axes(path, head)
    if axes is not None:
        lengths = np.linalg.norm(axes, axis=1)
        unit = axes / np.where(lengths > 0.0, lengths, 1.0)[:, None]
        if np.abs(unit @ unit.T - np.eye(3)).max() > 1e-3:
            raise FormatError(path, "its axes are not at right angles, which its reader does not honour; resample it")


def _header_lines(path: Path) -> list[str]:
    with path.open("rb") as stream:
        text = stream.read(65536).decode("latin-1")
    lines = []
    for line in text.splitlines():
        if not line.strip():  # NRRD: the header ends
            break
        lines.append(line)
        if line.startswith("ElementDataFile"):
            break
    return lines


def _stated_axes(path: Path, head: list[str]) -> FloatArray | None:
    """Returns the direction of each index as the header states it, shape (3, 3), or None."""
    for line in head:
        key, _, value = line.partition("=" if path.suffix.lower() in (".mha", ".mhd") else ":")
        if key.strip() in ("TransformMatrix", "Rotation", "Orientation") or key.strip() == "space directions":
            words = value.replace("(", " ").replace(")", " ").replace(",", " ").split()
            try:
                numbers = np.array([float(word) for word in words if word != "none"])
            except ValueError as error:
                raise FormatError(path, f"expected numbers, got {value.strip()!r}", key.strip()) from error
            if numbers.size == 9:
                return numbers.reshape(3, 3)
    return None


def _frame(path: Path) -> str:
    """Returns the world frame of an NRRD or MetaImage file: RAS where its header says so, else LPS."""
    for line in _header_lines(path):
        key, _, value = line.partition(":")
        if key.strip().lower() == "space" and value.strip().lower() in ("right-anterior-superior", "ras"):
            return "RAS"
    return "LPS"


def _itk_grid(path: Path) -> VolumeGrid:
    data_file(path)
    _, reader = _itk_reader(path)
    return grid_of(path, reader, _frame(path))


def _itk_volume(path: Path) -> Volume:
    data_file(path)
    sitk, reader = _itk_reader(path)
    try:
        with redirect_stderr(StringIO()):
            image = reader.Execute()
    except RuntimeError as error:
        raise FormatError(path, f"is cut off or damaged: {last_line(error)}") from error
    grid = grid_of(path, image, _frame(path))
    return Volume(grid, sitk.GetArrayFromImage(image).transpose().reshape(grid.shape))


def last_line(error: Exception) -> str:
    """Returns the last line of an error of ITK's: those before it name its source files."""
    return str(error).strip().splitlines()[-1].strip()


def data_file(path: Path) -> Path:
    """Returns the file that holds the voxels: of a detached header (MHD, NHDR) the one beside it that it names."""
    if path.suffix.lower() not in (".mhd", ".nhdr"):
        return path
    separator = "=" if path.suffix.lower() == ".mhd" else ":"
    for line in read_bytes(path).decode("latin-1").splitlines():
        key, _, value = line.partition(separator)
        if key.strip().lower() in ("elementdatafile", "data file", "datafile"):
            name = value.strip()
            if not name or name.upper() in ("LOCAL", "LIST") or Path(name).name != name:
                raise FormatError(path, f"expected one data file in the header's own folder, got {name!r}")
            check_file(path.parent / name)
            return path.parent / name
    raise FormatError(path, "names no data file")


def volume_parts(path: Path) -> tuple[Path, ...]:
    """Returns the files that a volume lies in: itself, and the data file that a detached header names."""
    data = data_file(path)
    return (path,) if data == path else (path, data)


NRRD = VolumeFormat("NRRD", (".nrrd", ".nhdr"), _itk_grid, _itk_volume, volume_parts)
METAIMAGE = VolumeFormat("MetaImage", (".mha", ".mhd"), _itk_grid, _itk_volume, volume_parts)
