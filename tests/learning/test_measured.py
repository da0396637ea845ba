"""Measured shapes: bad files are named, the robot's stiffness is found, and the model follows it."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.learning.dataset import draw_cases
from tdcr_planner.learning.measured import (
    fit_stiffness,
    format_robot,
    read_measured_shapes,
    scale_stiffness,
    train_on_measured,
)
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.shape.learned import load_shape_model
from tdcr_planner.statics.solver import solve_statics

TRUE_STIFFNESS = 1.15
NOISE = 5e-4


def write_csv(path, header, rows):
    path.write_text("\n".join([",".join(header), *(",".join(str(value) for value in row) for row in rows)]) + "\n")
    return path


@pytest.fixture
def bench(small_robot, tmp_path, random):
    """50 noisy shapes of a robot 15 % stiffer than its file says, gravity down, three disks tracked."""
    domain = DomainSettings().for_robot(small_robot)
    cases = draw_cases(small_robot, domain, "planner", 50, random)
    gravity = np.broadcast_to([0.0, 0.0, -9.81], (50, 3))
    solution = solve_statics(scale_stiffness(small_robot, TRUE_STIFFNESS), cases.tensions, gravity=gravity)
    assert solution.converged.all()
    points = solution.positions[:, [2, 4, 6]] + random.normal(0.0, NOISE, (50, 3, 3))
    header = [f"tension_{i}_n" for i in range(3)]
    header += [f"gravity_{axis}_m_s2" for axis in "xyz"]
    header += [f"disk_{disk}_{axis}_m" for disk in (2, 4, 6) for axis in "xyz"]
    rows = np.hstack([cases.tensions, gravity, points.reshape(50, 9)])
    return write_csv(tmp_path / "bench.csv", header, rows)


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_reads_what_was_measured(small_robot, bench):
    measured = read_measured_shapes(bench, small_robot)
    assert measured.disks == (2, 4, 6)
    assert measured.positions.shape == (50, 3, 3)
    assert measured.cases.tensions.shape == (50, 3)
    np.testing.assert_allclose(measured.cases.gravity[:, 2], -9.81)
    assert (measured.cases.tip_force == 0.0).all()


def test_an_unseen_marker_is_an_empty_field(small_robot, bench):
    lines = bench.read_text().splitlines()
    fields = lines[3].split(",")
    fields[6:9] = ["", "", ""]
    bench.write_text("\n".join([*lines[:3], ",".join(fields), *lines[4:]]))
    measured = read_measured_shapes(bench, small_robot)
    assert np.isnan(measured.positions[2, 0]).all()
    _, calibration = fit_stiffness(small_robot, measured, 1.0, NOISE)
    assert calibration.stiffness_scale == pytest.approx(TRUE_STIFFNESS, abs=0.01)


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


def test_unknown_columns_are_named(small_robot, tmp_path):
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
def test_values_are_checked(small_robot, tmp_path, row, words):
    header = ["tension_0_n", "tension_1_n", "tension_2_n", "disk_6_x_m", "disk_6_y_m", "disk_6_z_m"]
    path = write_csv(tmp_path / "bench.csv", header, [row])
    with pytest.raises(FormatError, match=words):
        read_measured_shapes(path, small_robot)


def test_missing_and_empty_files_are_named(small_robot, tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        read_measured_shapes(tmp_path / "bench.csv", small_robot)
    with pytest.raises(FormatError, match="at least one row"):
        read_measured_shapes(write_csv(tmp_path / "bench.csv", ["tension_0_n"], []), small_robot)


def test_finds_the_stiffness(small_robot, bench):
    fitted, calibration = fit_stiffness(small_robot, read_measured_shapes(bench, small_robot), 1.0, NOISE)
    # 450 coordinates with 0.5 mm of noise, and some 10 mm of difference for 15 %: the factor is known to about 0.1 %.
    assert calibration.stiffness_scale == pytest.approx(TRUE_STIFFNESS, abs=0.005)
    assert fitted.backbone.youngs_modulus_pa == pytest.approx(60e9 * calibration.stiffness_scale)
    assert calibration.rms_after_mm == pytest.approx(1e3 * NOISE * np.sqrt(3.0), rel=0.1)
    assert calibration.rms_before_mm > 3.0 * calibration.rms_after_mm


def test_a_small_weight_leaves_the_robot_as_its_file_says(small_robot, bench):
    _, calibration = fit_stiffness(small_robot, read_measured_shapes(bench, small_robot), 1e-9, NOISE)
    assert calibration.stiffness_scale == pytest.approx(1.0, abs=1e-3)


def test_fine_tuning_brings_the_error_down_fivefold(small_robot, small_model, small_settings, bench, tmp_path, random):
    settings = small_settings(
        dataset={"cases": 1500, "validation_cases": 100, "threads": 1},
        optimiser={"epochs": 5, "batch_size": 128, "learning_rate": 2e-3},
        loss={"measured": 1.0},
        measured={"file": str(bench), "start_from": str(small_model.path)},
    )
    out = tmp_path / "tuned.pt"
    card = train_on_measured(small_robot, settings, out)
    assert card.calibration is not None
    assert card.calibration.shapes == 50
    assert "calibrated on 50 measured shapes" in card.describe()
    true_robot = scale_stiffness(small_robot, TRUE_STIFFNESS)
    cases = draw_cases(small_robot, DomainSettings().for_robot(small_robot), "uniform", 400, random)
    truth = solve_statics(true_robot, cases.tensions, gravity=cases.gravity, tip_force=cases.tip_force)
    errors = []
    for model in (small_model, load_shape_model(out)):
        poses = model.disk_poses(cases.tensions, gravity=cases.gravity, tip_force=cases.tip_force)
        errors.append(np.median(np.linalg.norm(poses.positions - truth.positions, axis=2)[truth.converged, 1:]))
    assert errors[1] < errors[0] / 5.0
    fitted = load_robot(out.with_suffix(".robot.toml"))
    assert fitted.mechanics_hash == card.robot_mechanics_hash


def test_start_from_needs_the_same_layers(small_robot, small_model, small_settings, bench, tmp_path):
    settings = small_settings(
        dataset={"cases": 100, "validation_cases": 10, "threads": 1},
        shooting={"hidden": [8]},
        loss={"measured": 1.0},
        measured={"file": str(bench), "start_from": str(small_model.path)},
    )
    with pytest.raises(FormatError, match="other layers"):
        train_on_measured(small_robot, settings, tmp_path / "tuned.pt")


def test_a_robot_written_is_the_robot_read(any_robot, tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(format_robot(any_robot))
    assert load_robot(path) == any_robot


def test_segments_keep_their_own_backbones(two_segment_robot, tmp_path):
    content = two_segment_robot.model_dump()
    own = content["segments"][1] | {"backbone": content["backbone"] | {"radius_m": 0.0004}}
    robot = RobotSpec.model_validate(content | {"segments": [content["segments"][0], own], "name": 'say "robot"'})
    path = tmp_path / "robot.toml"
    path.write_text(format_robot(scale_stiffness(robot, 2.0)))
    read = load_robot(path)
    assert [backbone.youngs_modulus_pa for backbone in read.segment_backbones] == [120e9, 120e9]
    assert read.name == 'say "robot"'
