"""Every cloud format gives the same points, or is refused with the reason."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pye57
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.collision.clouds.formats import read_cloud
from tdcr_planner.errors import FormatError

POINTS = np.round(np.random.default_rng(2).uniform(-0.5, 0.5, (50, 3)), 3)


def write_xyz(path: Path, points: np.ndarray) -> None:
    path.write_text("x,y,z,intensity\n" + "".join(f"{x},{y},{z},7\n" for x, y, z in points))


def write_ply(path: Path, points: np.ndarray) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz") + "property uchar red\nend_header\n"
    rows = np.zeros(len(points), dtype=[("p", "<f8", 3), ("red", "u1")])
    rows["p"] = points
    path.write_bytes(head.encode() + rows.tobytes())


def pcd_head(points: np.ndarray, kind: str) -> bytes:
    return (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS rgb x y z _\nSIZE 4 8 8 8 1\nTYPE U F F F U\nCOUNT 1 1 1 1 3\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {kind}\n"
    ).encode()


def write_pcd(path: Path, points: np.ndarray) -> None:
    rows = np.zeros(len(points), dtype=[("rgb", "<u4"), ("p", "<f8", 3), ("pad", "u1", 3)])
    rows["p"] = points
    path.write_bytes(pcd_head(points, "binary") + rows.tobytes())


def write_pcd_text(path: Path, points: np.ndarray) -> None:
    path.write_bytes(pcd_head(points, "ascii") + b"".join(f"5 {x} {y} {z} 0 0 0\n".encode() for x, y, z in points))


def write_las(path: Path, points: np.ndarray) -> None:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.full(3, 1e-3)
    file = laspy.LasData(header)
    file.x, file.y, file.z = points.T
    file.write(path)


def write_e57(path: Path, points: np.ndarray) -> None:
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw({f"cartesian{axis}": column.copy() for axis, column in zip("XYZ", points.T, strict=True)})
    file.close()


WRITERS: dict[str, Callable[[Path, np.ndarray], None]] = {
    "scan.xyz": write_xyz, "scan.csv": write_xyz, "scan.ply": write_ply, "scan.pcd": write_pcd,
    "text.pcd": write_pcd_text, "scan.las": write_las, "scan.laz": write_las, "scan.e57": write_e57,
}  # fmt: skip


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_points(name: str, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / name, POINTS)
    # LAS stores whole multiples of a millimetre, the others doubles.
    np.testing.assert_allclose(read_cloud(tmp_path / name), POINTS, atol=1e-12)


@pytest.mark.parametrize("name", ["scan.xyz", "scan.ply", "scan.pcd", "text.pcd"])
def test_points_that_are_not_finite_are_counted_and_refused(name: str, tmp_path: Path) -> None:
    points = POINTS.copy()
    points[[4, 9]] = np.nan
    WRITERS[name](tmp_path / name, points)
    with pytest.raises(FormatError, match=r"point 5: 2 points are not finite"):
        read_cloud(tmp_path / name)


@pytest.mark.parametrize("name", [name for name in WRITERS if name not in ("scan.xyz", "scan.csv", "scan.e57")])
@pytest.mark.parametrize("fraction", [0.01, 0.3, 0.9])
def test_a_cloud_that_is_cut_off_is_refused(name: str, fraction: float, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / name, POINTS)
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(FormatError):
        read_cloud(tmp_path / name)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_damaged_pcd_header_is_a_message(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    file = tmp_path_factory.mktemp("pcd") / "scan.pcd"
    content = bytearray(pcd_head(POINTS, "ascii") + b"5 1 2 3 0 0 0\n" * len(POINTS))
    place = data.draw(st.integers(0, 160))
    content[place] = data.draw(st.integers(0, 255))
    file.write_bytes(bytes(content))
    try:
        found = read_cloud(file)
    except FormatError:
        return
    assert found.shape == (len(POINTS), 3)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "holds no points"),
        ("1 2 3\n4 5\n", "line 2: expected three numbers"),
        ("1 2 3\n4 five 6\n", "line 2: expected three numbers"),
    ],
)
def test_text_that_is_no_cloud_is_refused(text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text(text)
    with pytest.raises(FormatError, match=reason):
        read_cloud(tmp_path / "a.xyz")


def test_an_unknown_ending_names_the_valid_ones(tmp_path: Path) -> None:
    (tmp_path / "scan.abc").write_text("1 2 3\n")
    with pytest.raises(FormatError, match=r"unknown ending '\.abc'; valid: \.ply, \.pcd, \.xyz"):
        read_cloud(tmp_path / "scan.abc")
