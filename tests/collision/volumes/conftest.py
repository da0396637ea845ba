"""A ball of voxels in every format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import nibabel
import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813

SHAPE = (22, 26, 18)
# Axes that are turned, mirrored and of three spacings, mm, RAS.
RAS_FROM_INDEX = np.array([[0.0, 0.8, 0.0, -9.0], [-0.5, 0.0, 0.0, 4.0], [0.0, 0.0, 1.1, 20.0], [0.0, 0.0, 0.0, 1.0]])
CENTRE = np.array([1.0, -1.0, 29.0])
RADIUS = 5.0


def ball_labels() -> np.ndarray:
    """Returns label 3 inside a ball about `CENTRE`, label 1 in one crumb, 0 elsewhere."""
    index = np.stack(np.meshgrid(*(np.arange(count) for count in SHAPE), indexing="ij"), axis=-1)
    points = index @ RAS_FROM_INDEX[:3, :3].T + RAS_FROM_INDEX[:3, 3]
    labels = np.where(np.linalg.norm(points - CENTRE, axis=-1) < RADIUS, 3, 0)
    labels[0, 0, 0] = 1
    return labels.astype(np.uint8)


def write_nifti(path: Path, values: np.ndarray, affine: np.ndarray = RAS_FROM_INDEX) -> Path:
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path


def write_itk(path: Path, values: np.ndarray) -> Path:
    """Writes the same volume through SimpleITK, whose places are LPS."""
    lps = np.diag([-1.0, -1.0, 1.0, 1.0]) @ RAS_FROM_INDEX
    spacing = np.linalg.norm(lps[:3, :3], axis=0)
    image = sitk.GetImageFromArray(np.ascontiguousarray(values.transpose()))
    image.SetSpacing(spacing.tolist())
    image.SetDirection((lps[:3, :3] / spacing).ravel().tolist())
    image.SetOrigin(lps[:3, 3].tolist())
    sitk.WriteImage(image, str(path))
    return path


def write_dicom(folder: Path, values: np.ndarray, skip: int = -1) -> Path:
    """Writes a folder of slices, one of them left out where `skip` names it."""
    lps = np.diag([-1.0, -1.0, 1.0, 1.0]) @ RAS_FROM_INDEX
    spacing = np.linalg.norm(lps[:3, :3], axis=0)
    direction = lps[:3, :3] / spacing
    folder.mkdir()
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for k in range(values.shape[2]):
        if k == skip:
            continue
        image = sitk.GetImageFromArray(np.ascontiguousarray(values[:, :, k].transpose().astype(np.int16)))
        image.SetSpacing(spacing[:2].tolist())
        tags = {
            "0008|0060": "CT", "0020|000e": "1.2.826.0.1.3680043.2.1125.1", "0020|000d": "1.2.826.0.1.3680043.2.1125",
            "0008|0018": f"1.2.826.0.1.3680043.2.1125.1.{k + 1}", "0020|0013": str(k + 1),
            "0020|0032": "\\".join(f"{x:.6f}" for x in lps[:3, 3] + lps[:3, 2] * k),
            "0020|0037": "\\".join(f"{x:.6f}" for x in np.concatenate([direction[:, 0], direction[:, 1]])),
        }  # fmt: skip
        for tag, value in tags.items():
            image.SetMetaData(tag, value)
        writer.SetFileName(str(folder / f"slice{k:03d}.dcm"))
        writer.Execute(image)
    return folder


WRITERS: dict[str, Callable[..., Path]] = {
    "ball.nii": write_nifti, "ball.nii.gz": write_nifti, "ball.nrrd": write_itk, "ball.nhdr": write_itk,
    "ball.mha": write_itk, "ball.mhd": write_itk, "slices": write_dicom,
}  # fmt: skip


class Ball:
    """A ball of label 3 about `centre`, mm, RAS, with a crumb of label 1."""

    shape = SHAPE
    ras_from_index = RAS_FROM_INDEX
    centre = CENTRE
    radius = RADIUS

    def __init__(self) -> None:
        self.labels = ball_labels()

    def write(self, path: Path, values: np.ndarray | None = None, **how: object) -> Path:
        """Writes it, or other values in its place, in the format that the name of the file says."""
        name = "slices" if path.suffix == "" else "ball" + "".join(path.suffixes)
        return WRITERS[name](path, self.labels if values is None else values, **how)


@pytest.fixture
def ball() -> Ball:
    """The ball."""
    return Ball()


@pytest.fixture(params=list(WRITERS))
def ball_file(request: pytest.FixtureRequest, ball: Ball, tmp_path: Path) -> Path:
    """The ball in one of the formats."""
    return ball.write(tmp_path / request.param)
