"""Fitting to measured shapes: the robot's stiffness is found, and the model follows it."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.learning.dataset import draw_cases
from tdcr_planner.learning.fitting import fit_stiffness, train_on_measured
from tdcr_planner.learning.measured import read_measured_shapes
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.robot import RobotSpec, format_robot, load_robot
from tdcr_planner.shape.learned import load_shape_model
from tdcr_planner.statics.solver import solve_statics

# Of the robot that the fixture `bench` measures, and of its measurement in metres.
TRUE_STIFFNESS, NOISE = 1.15, 5e-4


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


def test_tensions_in_the_wrong_unit_are_explained_by_no_stiffness(small_robot, write_csv, bench):
    header, *lines = (line.split(",") for line in bench.read_text(encoding="utf-8").splitlines())
    scaled = [[*(f"{1e-3 * float(value):.9g}" for value in line[:3]), *line[3:]] for line in lines]
    measured = read_measured_shapes(write_csv(bench, header, scaled), small_robot)
    with pytest.raises(FormatError, match="no stiffness explains the shapes.*are the units newton"):
        fit_stiffness(small_robot, measured, 1.0, NOISE)


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
    true_robot = small_robot.scaled(stiffness=TRUE_STIFFNESS)
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
    path.write_text(format_robot(robot.scaled(stiffness=2.0)))
    read = load_robot(path)
    assert [backbone.youngs_modulus_pa for backbone in read.segment_backbones] == [120e9, 120e9]
    assert read.name == 'say "robot"'
