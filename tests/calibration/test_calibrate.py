"""Calibration: what a simulated robot was made with is found, within the errors that are stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdcr_planner.calibration.bench import Bench, as_version_2
from tdcr_planner.calibration.calibrate import bench_of_robot, calibrate
from tdcr_planner.calibration.data import read_measured_states
from tdcr_planner.calibration.forward import Forward, UnloadedMechanics
from tdcr_planner.calibration.parameters import make_blocks
from tdcr_planner.calibration.reference import ReferenceMechanics
from tdcr_planner.calibration.simulate import commanded_states, smooth_motion, write_simulated
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.robot import format_robot, load_robot
from tdcr_planner.statics.solver import solve_statics

TRUTH = {"modulus": [np.log(1.15)], "friction": [0.05], "pretension": [0.5, -0.4], "angles": np.deg2rad([3, -3] * 3)}


@pytest.fixture(scope="module")
def repetitions(tmp_path_factory, make_robot):
    """Two simulated benches of 150 states, 1 mm of noise, and their calibrations."""
    robot = make_robot(friction=0.05)
    bench = Bench.nominal(robot)
    blocks = make_blocks(bench, tuple(TRUTH), 75.0)
    truth = bench
    for block in blocks:
        truth = block.apply(truth, np.array(TRUTH[block.name], dtype=float))
    found = []
    for seed in range(2):
        random = np.random.default_rng(seed)
        path = tmp_path_factory.mktemp("simulated") / "bench.csv"
        write_simulated(path, truth, smooth_motion(6, 150, 0.003, random), 1e-3, random)
        found.append(calibrate(robot, read_measured_states(path, robot), list(TRUTH), use_reference=False, folds=2))
    return truth, blocks, found


def test_parameters_lie_within_their_standard_errors(repetitions):
    _, blocks, found = repetitions
    truth = np.concatenate([TRUTH[block.name] for block in blocks])
    off = np.concatenate([(one.fit.numbers - truth) / one.uncertainty.deviations for one in found])
    # Of 20 numbers one in twenty lies beyond two standard errors; four beyond would be 2 %, any beyond four, 0.1 %.
    assert (np.abs(off) > 2.0).sum() <= 3
    assert np.abs(off).max() < 4.0
    assert all(one.uncertainty.undetermined == () for one in found)


def test_fresh_states_are_predicted_to_within_1_3_times_the_noise(repetitions):
    truth, _, found = repetitions
    random = np.random.default_rng(99)
    states = commanded_states(truth, smooth_motion(6, 80, 0.003, random))
    forward = Forward(states, UnloadedMechanics())
    error = np.linalg.norm(forward.points(found[0].fit.bench) - forward.points(truth), axis=2)
    noise = np.sqrt(3.0) * 1e-3
    assert np.sqrt(np.mean(error**2) + noise**2) < 1.3 * noise


def test_the_calibrated_beats_the_uncalibrated_and_constant_curvature(repetitions):
    _, _, found = repetitions
    rms = {model: np.sqrt(np.nanmean(found[0].errors(model) ** 2)) for model in found[0].held_out}
    assert rms["calibrated"] < 1.3 * np.sqrt(3.0) * 1e-3
    assert rms["calibrated"] < 0.9 * rms["uncalibrated"]
    assert rms["uncalibrated"] < rms["constant curvature"]


def test_the_robot_file_predicts_what_the_fit_did(repetitions, tmp_path):
    _, _, found = repetitions
    path = tmp_path / "robot.toml"
    path.write_text(format_robot(found[0].robot))
    robot = load_robot(path)
    assert robot == found[0].robot
    points = Forward(found[0].states, UnloadedMechanics()).points(bench_of_robot(robot))
    np.testing.assert_allclose(points - found[0].states.positions, found[0].fitted, atol=1e-9)
    bound = robot.measured_error
    assert bound.disks_m[0] == 0.0
    assert (np.diff(bound.disks_m) >= 0.0).all()
    covered = np.mean(found[0].errors()[:, 0] <= bound.disks_m[-1])
    assert 0.95 <= covered <= 0.97


def test_what_the_data_cannot_tell_is_left_out_with_a_reason(robot, states):
    found = calibrate(robot, states, use_reference=False, folds=2)
    reasons = dict(found.selection.left_out)
    assert "offsets" in found.selection.names
    assert reasons["modulus"].startswith("the measurements do not tell it from transmission")
    assert "offsets" in reasons["pretension"]
    assert reasons["mass"] == "no gravity acts"
    zeros = 1e4 * found.fit.bench.zeros
    np.testing.assert_allclose(zeros, [3.0, -2.0, 1.0, 4.0, -1.0, 2.0], atol=4e4 * 1e-4)


def test_names_that_cannot_be_told_apart_are_refused_by_name(robot, states):
    with pytest.raises(InputError, match=r"offsets and pretension: they do not tell .* leave one out"):
        calibrate(robot, states, ["pretension", "offsets"], folds=2)


@pytest.mark.parametrize(
    ("names", "message"),
    [(["angle"], "did you mean 'angles'"), (["angles", "angles"], "'angles' twice")],
)
def test_unknown_and_repeated_names_are_refused(robot, states, names, message):
    with pytest.raises(InputError, match=message):
        calibrate(robot, states, names)


def test_swapped_columns_are_refused(robot, states, changed):
    path = changed("tip_x_m,tip_y_m,tip_z_m", "tip_z_m,tip_x_m,tip_y_m")
    with pytest.raises(FormatError, match="no parameters explain the positions.*x, y and z in place"):
        calibrate(robot, read_measured_states(path, robot, base_is_known=True), ["offsets"], folds=2)


def test_outliers_do_not_move_the_fit(robot, states):
    clean = calibrate(robot, states, ["offsets"], use_reference=False, folds=2)
    spoilt = states.positions.copy()
    spoilt[::12] += 0.03
    found = calibrate(robot, replace(states, positions=spoilt), ["offsets"], use_reference=False, folds=2)
    shift = (found.fit.numbers - clean.fit.numbers) / clean.uncertainty.deviations
    assert np.abs(shift).max() < 3.0


@pytest.fixture(scope="module")
def slippery(make_robot):
    """Without friction, straight tendons between three disks a segment, where reference and arcs differ."""
    return make_robot(friction=0.0)


def test_the_reference_is_fitted_by_way_of_the_arcs(slippery, tmp_path):
    random = np.random.default_rng(11)
    truth = Bench.nominal(slippery)
    truth = make_blocks(truth, ["transmission"], 30.0)[0].apply(truth, np.array([0.3, -0.2]))
    motion = smooth_motion(6, 60, 0.0015, random)
    path = write_simulated(tmp_path / "bench.csv", truth, motion, 1e-6, random, mechanics=ReferenceMechanics())
    states = read_measured_states(path, slippery)
    by_arcs = calibrate(slippery, states, ["transmission"], use_reference=False, folds=2)
    found = calibrate(slippery, states, ["transmission"], folds=2)
    # Beside the noise of a micrometre the difference between arcs and reference counts.
    assert np.nanmax(np.linalg.norm(by_arcs.fitted, axis=2)) > 3e-5
    assert np.nanmax(np.linalg.norm(found.fitted, axis=2)) < 1e-5
    np.testing.assert_allclose(found.fit.numbers, [0.3, -0.2], atol=2e-3)


def test_masses_are_found_under_gravity(slippery, tmp_path):
    heavy = slippery.model_copy(update={"tip": {"mass_kg": 0.01}})
    random = np.random.default_rng(12)
    truth = Bench.nominal(heavy)
    truth = make_blocks(truth, ["mass"], 20.0)[0].apply(truth, np.array([0.2]))
    states = commanded_states(truth, smooth_motion(6, 30, 0.002, random))
    states = replace(states, gravity=np.tile([0.0, -9.81, 0.0], (30, 1)))
    points = Forward(states, ReferenceMechanics()).points(truth)
    header = ["time_s", *(f"tendon_displacement_{i + 1}_m" for i in range(6)), *(f"tip_{axis}_m" for axis in "xyz")]
    header += [f"gravity_{axis}_m_s2" for axis in "xyz"]
    noisy = points[:, 0] + 1e-4 * random.normal(size=(30, 3))
    rows = np.column_stack([states.times, states.displacements, noisy, states.gravity])
    np.savetxt(tmp_path / "bench.csv", rows, delimiter=",", header=",".join(header), comments="")
    found = calibrate(heavy, read_measured_states(tmp_path / "bench.csv", heavy), ["mass"], folds=2)
    off = (found.fit.numbers[0] - 0.2) / found.uncertainty.deviations[0]
    assert abs(off) < 4.0
    assert found.uncertainty.deviations[0] < 0.05


def test_a_version_1_robot_says_the_same_in_version_2(two_segment_robot):
    other = as_version_2(two_segment_robot)
    tensions = np.random.default_rng(0).uniform(0.0, 2.0, (3, two_segment_robot.tendon_count))
    gravity = [0.0, 0.0, -9.81]
    first = solve_statics(two_segment_robot, tensions, gravity=gravity)
    second = solve_statics(other, tensions, gravity=gravity)
    np.testing.assert_allclose(first.positions, second.positions, atol=1e-12)
