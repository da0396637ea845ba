"""The file of measured shapes: what it holds is read, and what cannot have been measured is named."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.learning.fitting import fit_stiffness
from tdcr_planner.learning.measured import read_measured_shapes


def change(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new))


def test_reads_what_was_measured(small_robot, bench):
    measured = read_measured_shapes(bench, small_robot)
    assert measured.disks == (2, 4, 6)
    assert measured.positions.shape == (50, 3, 3)
    assert measured.cases.tensions.shape == (50, 3)
    np.testing.assert_allclose(measured.cases.gravity[:, 2], -9.81)
    assert (measured.cases.tip_force == 0.0).all()


def test_tensions_count_from_one_as_in_a_trajectory_or_from_zero(small_robot, bench):
    from_zero = read_measured_shapes(bench, small_robot)
    header, rest = bench.read_text(encoding="utf-8").split("\n", 1)
    for tendon in (2, 1, 0):
        header = header.replace(f"tension_{tendon}_n", f"tension_{tendon + 1}_n")
    bench.write_text(header + "\n" + rest)
    from_one = read_measured_shapes(bench, small_robot)
    np.testing.assert_array_equal(from_one.cases.tensions, from_zero.cases.tensions)
    change(bench, "tension_1_n", "tension_4_n")
    with pytest.raises(FormatError, match="missing columns: tension_1_n$"):
        read_measured_shapes(bench, small_robot)


def test_a_table_as_a_spreadsheet_saves_it(small_robot, bench):
    expected = read_measured_shapes(bench, small_robot)
    text = bench.read_text(encoding="utf-8")
    bench.write_bytes(text.replace("\n", "\r\n").encode("utf-8-sig"))
    np.testing.assert_array_equal(read_measured_shapes(bench, small_robot).positions, expected.positions)
    bench.write_text(text.replace(",", ";"))
    with pytest.raises(FormatError, match="separated by commas, got semicolons"):
        read_measured_shapes(bench, small_robot)
    bench.write_bytes(text.encode("utf-16"))
    with pytest.raises(FormatError, match="save it as UTF-8"):
        read_measured_shapes(bench, small_robot)
    bench.write_text('tension_1_n,"' + 200_000 * "a")
    with pytest.raises(FormatError, match="not valid CSV"):
        read_measured_shapes(bench, small_robot)


def test_a_fault_is_named_as_the_file_counts(small_robot, write_csv, tmp_path):
    header = [f"tension_{i}_n" for i in (1, 2, 3)] + [f"disk_6_{axis}_m" for axis in "xyz"]
    path = write_csv(tmp_path / "bench.csv", header, [[0, 0, -1, 0, 0, 0.2]])
    with pytest.raises(FormatError, match="tension_3_n: expected 0 to 3.5 N, got -1"):
        read_measured_shapes(path, small_robot)


def test_an_unseen_marker_is_an_empty_field(small_robot, bench):
    lines = bench.read_text(encoding="utf-8").splitlines()
    fields = lines[3].split(",")
    fields[6:9] = ["", "", ""]
    bench.write_text("\n".join([*lines[:3], ",".join(fields), *lines[4:]]))
    measured = read_measured_shapes(bench, small_robot)
    assert np.isnan(measured.positions[2, 0]).all()
    _, calibration = fit_stiffness(small_robot, measured, 1.0, 5e-4)
    assert calibration.stiffness_scale == pytest.approx(1.15, abs=0.01)


def test_columns_are_checked(small_robot, bench):
    change(bench, "tension_1_n", "tension_one")
    with pytest.raises(FormatError, match="missing columns: tension_1_n"):
        read_measured_shapes(bench, small_robot)
    change(bench, "tension_one", "tension_1_n")
    change(bench, "disk_4_y_m", "disk_9_y_m")
    with pytest.raises(FormatError, match="missing columns: disk_4_y_m"):
        read_measured_shapes(bench, small_robot)
    change(bench, "disk_9_y_m", "tension_0_n")
    with pytest.raises(FormatError, match="tension_0_n: column appears more than once"):
        read_measured_shapes(bench, small_robot)


def test_unknown_columns_are_named(small_robot, write_csv, tmp_path):
    header = ["tension_0_n", "tension_1_n", "tension_2_n", "disk_1_x_m", "disk_1_y_m", "disk_1_z_m", "note"]
    path = write_csv(tmp_path / "bench.csv", header, [[0, 0, 0, 0, 0, 0.03, 1]])
    with pytest.raises(FormatError, match="note: unknown column"):
        read_measured_shapes(path, small_robot)
    path = write_csv(tmp_path / "bench.csv", header[:3], [[0, 0, 0]])
    with pytest.raises(FormatError, match="no disk is tracked"):
        read_measured_shapes(path, small_robot)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ([1, 0, 0, 0, 0, "nan"], "disk_6_z_m: expected a finite number, got nan"),
        ([1, "", 0, 0, 0, 0.2], "line 2, tension_1_n: is empty"),
        ([1, "lots", 0, 0, 0, 0.2], "expected a number, got 'lots'"),
        ([-1, 0, 0, 0, 0, 0.2], "tension_0_n: expected 0 to 3.5 N, got -1"),
        ([1200, 0, 0, 0, 0, 0.2], "is the unit newton"),
        ([1, 0, 0, 30.0, 0, 180.0], "disk 6 is 182.483 m from the base.*is the unit metre"),
        ([1, 0, 0, 3e-5, 0, 1.8e-4], "within 0.0001.* m of the base.*is the unit metre"),
        ([1, 0, 0, 0, 0], "expected 6 fields"),
        ([1, 0, 0, "", "", ""], "no marker was seen"),
    ],
)
def test_values_are_checked(small_robot, write_csv, tmp_path, row, words):
    header = ["tension_0_n", "tension_1_n", "tension_2_n", "disk_6_x_m", "disk_6_y_m", "disk_6_z_m"]
    path = write_csv(tmp_path / "bench.csv", header, [row])
    with pytest.raises(FormatError, match=words):
        read_measured_shapes(path, small_robot)


@pytest.mark.parametrize(
    ("pattern", "load", "words"),
    [
        ("gravity_{}_m_s2", [0, 0, -9810.0], "line 3: expected a gravity of at most 100 m/s.2, got 9810; is the unit"),
        ("tip_force_{}_n", [50.0, 0, 0], "line 3: a tip force of 50 N is far beyond.*is the unit newton"),
    ],
)
def test_loads_in_the_wrong_unit_are_named(small_robot, write_csv, tmp_path, pattern, load, words):
    header = [f"tension_{i}_n" for i in range(3)] + [f"disk_6_{axis}_m" for axis in "xyz"]
    header += [pattern.format(axis) for axis in "xyz"]
    rows = [[1, 0, 0, 0, 0.05, 0.18, 0, 0, 0], [1, 0, 0, 0, 0.05, 0.18, *load]]
    with pytest.raises(FormatError, match=words):
        read_measured_shapes(write_csv(tmp_path / "bench.csv", header, rows), small_robot)


def test_missing_and_empty_files_are_named(small_robot, write_csv, tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        read_measured_shapes(tmp_path / "bench.csv", small_robot)
    with pytest.raises(FormatError, match="at least one row"):
        read_measured_shapes(write_csv(tmp_path / "bench.csv", ["tension_0_n"], []), small_robot)


def test_a_field_without_end_is_refused(tmp_path, small_robot):
    path = tmp_path / "long.csv"
    path.write_text("tension_0_n\n" + "1" * 200_000 + "\n")
    with pytest.raises(FormatError, match="is not valid CSV: field larger than field limit"):
        read_measured_shapes(path, small_robot)
