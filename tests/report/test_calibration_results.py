"""The numbers that a calibration's figure shows: what bends, and on which side the model errs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.calibrate import calibrate
from tdcr_planner.calibration.data import read_measured_states
from tdcr_planner.calibration.simulate import smooth_motion, write_simulated
from tdcr_planner.report.calibration_plots import actuation_size, too_far
from tdcr_planner.report.calibration_results import draw_calibration, error_numbers, write_calibration
from tdcr_planner.robot import load_robot


@pytest.fixture(scope="module")
def found(root, tmp_path_factory):
    robot = load_robot(root / "models/robots/opencr.toml")
    random = np.random.default_rng(6)
    path = tmp_path_factory.mktemp("bench") / "bench.csv"
    write_simulated(path, Bench.nominal(robot), smooth_motion(9, 30, 0.002, random), 1e-3, random)
    return calibrate(robot, read_measured_states(path, robot), ["offsets"], folds=2)


def test_errors_leave_out_what_was_not_seen():
    numbers = error_numbers(np.array([3.0, 4.0, np.nan]))
    assert numbers["rms_m"] == pytest.approx(np.sqrt(12.5))
    assert numbers["max_m"] == 4.0


def test_what_all_tendons_of_a_segment_have_in_common_bends_nothing(found):
    same = found.states.displacements * 0.0
    same[:, :3] = np.linspace(0.0, 0.005, 30)[:, None]
    sizes = actuation_size(replace(found, states=replace(found.states, displacements=same)))
    np.testing.assert_allclose(sizes, 0.0, atol=1e-12)
    same[:, 0] += 0.003
    sizes = actuation_size(replace(found, states=replace(found.states, displacements=same)))
    # Counted from the first state, which has the same.
    np.testing.assert_allclose(sizes, 0.0, atol=1e-12)


def test_a_model_that_bends_too_far_is_seen_as_such(found):
    place = found.states.positions
    middle = place.mean(axis=0) * np.array([1.0, 1.0, 0.0])
    farther = {"calibrated": 0.1 * (place - middle) * np.array([1.0, 1.0, 0.0])}
    signed = too_far(replace(found, held_out=farther))
    assert np.median(signed) > 0.0
    assert (signed > -1e-6).all()


def test_files_are_written_together_and_the_figure_after_them(found, root, tmp_path):
    write_calibration(found, tmp_path, root / "models/robots/opencr.toml")
    assert draw_calibration(found, tmp_path) == ["residuals.png"]
    text = (tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert text.startswith("# Calibrated by `tdcr calibrate` from opencr.toml and 30 states in bench.csv.")
    assert load_robot(tmp_path / "robot.toml").bench.data == "bench.csv"
