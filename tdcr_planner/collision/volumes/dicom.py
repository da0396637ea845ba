"""Reading a folder of DICOM slices with SimpleITK, after checks that none is missing."""

from __future__ import annotations

from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_planner.collision.volumes.image import Volume, VolumeFormat, VolumeGrid
from tdcr_planner.collision.volumes.itk import grid_of, import_sitk, last_line
from tdcr_planner.errors import FormatError


def _slice_names(path: Path, sitk: Any) -> tuple[str, ...]:
    reader = sitk.ImageSeriesReader()
    series = reader.GetGDCMSeriesIDs(str(path))
    if len(series) != 1:
        found = "no DICOM slices" if not series else f"{len(series)} series: {', '.join(series[:3])}"
        raise FormatError(path, f"expected a folder with the slices of one DICOM series, got {found}")
    return tuple(reader.GetGDCMSeriesFileNames(str(path), series[0]))


def _read_dicom(path: Path) -> Volume:
    sitk = import_sitk(path)
    with redirect_stderr(StringIO()):
        names = _slice_names(path, sitk)
        reader = sitk.ImageSeriesReader()
        reader.SetFileNames(names)
        try:
            image = reader.Execute()
        except RuntimeError as error:
            raise FormatError(path, f"cannot be read as DICOM slices: {last_line(error)}") from error
    _check_slices(path, sitk, names)
    grid = grid_of(path, image, "LPS")
    return Volume(grid, sitk.GetArrayFromImage(image).transpose().reshape(grid.shape))


def _check_slices(path: Path, sitk: Any, names: tuple[str, ...]) -> None:
    """Refuses slices that are missing or not evenly spaced, which the reader would close up."""
    places = []
    for name in names:
        reader = sitk.ImageFileReader()
        reader.SetFileName(name)
        reader.ReadImageInformation()
        places.append(reader.GetOrigin())
    steps = np.linalg.norm(np.diff(np.array(places), axis=0), axis=1)
    if len(steps) and np.ptp(steps) > 0.01 * np.median(steps):
        worst = int(np.abs(steps - np.median(steps)).argmax())
        raise FormatError(
            path,
            f"expected evenly spaced slices, {np.median(steps):g} mm apart, got {steps[worst]:g} mm between "
            f"{Path(names[worst]).name} and {Path(names[worst + 1]).name}; is a slice missing?",
        )


def _dicom_grid(path: Path) -> VolumeGrid:
    return _read_dicom(path).grid


def _slices(path: Path) -> tuple[Path, ...]:
    return tuple(sorted(item for item in path.iterdir() if item.is_file()))


DICOM = VolumeFormat("DICOM slices", (), _dicom_grid, _read_dicom, _slices)
