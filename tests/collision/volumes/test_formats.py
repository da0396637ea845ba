"""Every volume format gives the same voxels in the same places, or is refused with the reason."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest

from tdcr_planner.collision.volumes.formats import read_volume, read_volume_grid, volume_sha256
from tdcr_planner.errors import FormatError

TO_RAS = {"RAS": np.eye(3), "LPS": np.diag([-1.0, -1.0, 1.0])}


def test_every_format_puts_the_voxels_in_the_same_places(ball, ball_file: Path) -> None:
    volume = read_volume(ball_file)
    inside = np.argwhere(volume.values == 3)
    places = inside @ volume.grid.world_from_index[:3, :3].T + volume.grid.world_from_index[:3, 3]
    places = places @ TO_RAS[volume.grid.frame].T
    expected = np.argwhere(ball.labels == 3) @ ball.ras_from_index[:3, :3].T + ball.ras_from_index[:3, 3]
    # NIfTI states its map in single precision, of up to 3e-6 mm here.
    found = places[np.lexsort(np.round(places, 6).T)]
    np.testing.assert_allclose(found, 1e-3 * expected[np.lexsort(np.round(1e-3 * expected, 6).T)], atol=1e-8)


def test_the_header_alone_gives_the_same_grid(ball, ball_file: Path) -> None:
    volume, grid = read_volume(ball_file), read_volume_grid(ball_file)
    assert grid.shape == volume.grid.shape == ball.shape
    np.testing.assert_array_equal(grid.world_from_index, volume.grid.world_from_index)


def test_the_hash_covers_the_data_file_of_a_detached_header(ball, tmp_path: Path) -> None:
    file = ball.write(tmp_path / "ball.mhd")
    before = volume_sha256(file)
    data = bytearray((tmp_path / "ball.raw").read_bytes())
    data[100] ^= 1
    (tmp_path / "ball.raw").write_bytes(bytes(data))
    assert volume_sha256(file) != before


@pytest.mark.parametrize("name", ["ball.nii", "ball.nii.gz", "ball.nrrd", "ball.mha"])
@pytest.mark.parametrize("fraction", [0.02, 0.5, 0.98])
def test_a_file_that_is_cut_off_is_refused(ball, name: str, fraction: float, tmp_path: Path) -> None:
    file = ball.write(tmp_path / name)
    data = file.read_bytes()
    file.write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(FormatError):
        read_volume(file)


def test_sheared_axes_of_nifti_are_honoured(ball, tmp_path: Path) -> None:
    sheared = ball.ras_from_index.copy()
    sheared[0, 2] = 0.4
    file = ball.write(tmp_path / "sheared.nii", affine=sheared)
    found = read_volume_grid(file).world_from_index
    np.testing.assert_allclose(found[:3], 1e-3 * sheared[:3], atol=1e-8)


@pytest.mark.parametrize(
    ("head", "reason"),
    [
        ("NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n", "states no spacing"),
        (
            "NDims = 3\nTransformMatrix = 1 0 0 0.5 1 0 0 0 1\nElementSpacing = 1 1 1\nDimSize = 2 2 2\n"
            "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
            "not at right angles",
        ),
        (
            "NDims = 3\nElementSpacing = 1 1 0\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
            "spacing",
        ),
        (
            "NDims = 3\nElementSpacing = 700 700 700\nDimSize = 2 2 2\nElementType = MET_UCHAR\n"
            "ElementDataFile = LOCAL\n",
            "in mm",
        ),
    ],
)
def test_a_header_that_does_not_say_where_voxels_lie_is_refused(head: str, reason: str, tmp_path: Path) -> None:
    file = tmp_path / "head.mha"
    file.write_bytes(head.encode() + bytes(8))
    with pytest.raises(FormatError, match=reason):
        read_volume_grid(file)


def test_nifti_without_orientation_is_refused(ball, tmp_path: Path) -> None:
    image = nibabel.Nifti1Image(ball.labels, None)
    nibabel.save(image, tmp_path / "none.nii")
    with pytest.raises(FormatError, match="states no orientation"):
        read_volume_grid(tmp_path / "none.nii")


def test_a_missing_slice_is_named(ball, tmp_path: Path) -> None:
    folder = ball.write(tmp_path / "slices", skip=7)
    with pytest.raises(FormatError, match=r"between slice006\.dcm and slice008\.dcm"):
        read_volume(folder)


def test_a_folder_without_slices_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no DICOM slices"):
        read_volume(tmp_path)


def test_an_unknown_ending_names_the_valid_ones(ball, tmp_path: Path) -> None:
    (tmp_path / "ball.vti").write_bytes(b"x")
    with pytest.raises(FormatError, match=r"\.nii, \.nii\.gz, \.nrrd"):
        read_volume_grid(tmp_path / "ball.vti")


@pytest.mark.parametrize("name", ["../ball.raw", "/etc/passwd", "LIST"])
def test_a_header_reads_no_file_outside_of_its_folder(name: str, tmp_path: Path) -> None:
    file = tmp_path / "head.mhd"
    file.write_text(
        f"NDims = 3\nElementSpacing = 1 1 1\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = {name}\n"
    )
    with pytest.raises(FormatError, match="in the header's own folder"):
        read_volume(file)


def test_values_that_are_not_finite_are_refused(ball, tmp_path: Path) -> None:
    values = ball.labels.astype(np.float32)
    values[3, 4, 5] = np.nan
    file = ball.write(tmp_path / "nan.nii", values)
    with pytest.raises(FormatError, match=r"voxel \[3, 4, 5\]: is not finite"):
        read_volume(file)
