"""Calibration judged: on a measured robot that this project did not measure, and on simulated robots that are known.

Parts: `measured` calibrates on the training states of the measured robot and then predicts its validation states;
`ingredients` says what each ingredient of the model brings, on stretches of the training states that are held out;
`simulated` counts how often parameters lie within two standard errors. The data of the measured robot are no part of
this repository: --data names their folder, which holds train.csv and val.csv of `data/sysid/ftdcr_v4` of
github.com/ContinuumRoboticsLab/opencr-mujoco (MIT licence, copyright 2026 Continuum Robotics Lab; Shentu et al.,
arXiv 2606.22397). Only `measured` opens val.csv.
"""

from __future__ import annotations

import argparse
import csv
import os
import platform
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.calibration.bench import Bench
from tdcr_planner.calibration.calibrate import bench_of_robot, calibrate
from tdcr_planner.calibration.comparison import align_base, constant_curvature_shapes
from tdcr_planner.calibration.data import MeasuredStates, read_measured_states
from tdcr_planner.calibration.fit import fit_bench
from tdcr_planner.calibration.forward import Forward, UnloadedMechanics, place_points
from tdcr_planner.calibration.holdout import blocks_in_time
from tdcr_planner.calibration.parameters import Block, Parameter, make_blocks
from tdcr_planner.calibration.reference import ReferenceMechanics
from tdcr_planner.calibration.simulate import commanded_states, smooth_motion, write_simulated
from tdcr_planner.report.calibration_results import draw_calibration, write_calibration
from tdcr_planner.robot import RobotSpec, load_robot

ROBOTS = Path(__file__).resolve().parents[1] / "models/robots"
MARKER_M = np.array([0.0, 0.0, 0.008])
FEW = 250


def main() -> None:
    """Runs the parts that were asked for and prints their tables."""
    parts = {"measured": measured_robot, "ingredients": ingredients, "simulated": simulated_robots}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=parts)
    parser.add_argument("--data", type=Path, help="folder of the measured robot's train.csv and val.csv")
    parser.add_argument("--out", type=Path, help="folder for the calibrated robot of `measured`")
    parser.add_argument("--repetitions", type=int, default=100, help="simulated robots")
    arguments = parser.parse_args()
    print(f"machine: {platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start")
    if arguments.part != "simulated" and arguments.data is None:
        parser.error("--data is needed")
    parts[arguments.part](arguments)


def measured_robot(arguments: argparse.Namespace) -> None:
    """Calibrates on all and on 250 of the training states, then predicts the validation states."""
    robot = load_robot(ROBOTS / "opencr.toml")
    with tempfile.TemporaryDirectory() as folder:
        train = _read(arguments.data / "train.csv", Path(folder) / "train.csv", robot)
        began, used = time.perf_counter(), time.process_time()
        found = calibrate(robot, train, marker=MARKER_M)
        took, processor = time.perf_counter() - began, time.process_time() - used
        if arguments.out is not None:
            write_calibration(found, arguments.out, ROBOTS / "opencr.toml")
            draw_calibration(found, arguments.out)
        print(f"calibration and six hold-outs: {took:.0f} s, {processor:.0f} s of processor time")
        print(f"{'error of the marker, mm':<44}{'rms':>7}{'median':>8}{'95 %':>7}{'largest':>9}")
        _print_row("train, fitted", found.fitted)
        for model, differences in found.held_out.items():
            _print_row(f"train, held out: {model}", differences)
        chosen = np.sort(np.random.default_rng(1).permutation(len(train))[:FEW])
        few_file = _copy(arguments.data / "train.csv", Path(folder) / "few.csv", chosen)
        few = calibrate(robot, read_measured_states(few_file, robot, base_is_known=False), marker=MARKER_M)
        val = _read(arguments.data / "val.csv", Path(folder) / "val.csv", robot)
        _judge(found.robot, found.nominal, train, val, few.robot)


def _judge(robot: RobotSpec, nominal: Bench, train: MeasuredStates, val: MeasuredStates, few: RobotSpec) -> None:
    """Predicts the validation states by each model and prints how far they are off."""
    differences = _predict(robot, val) - val.positions
    _print_row("val: calibrated", differences)
    _print_row("val: calibrated, means aligned", differences - np.nanmean(differences, axis=0))
    _print_row(f"val: calibrated on {FEW} states", _predict(few, val) - val.positions)
    everything = np.ones(len(train), dtype=bool)
    for name, shapes in (
        ("uncalibrated", lambda states: Forward(states, ReferenceMechanics()).shapes(nominal)),
        ("constant curvature", lambda states: constant_curvature_shapes(nominal, states)),
    ):
        placed = align_base(nominal, train, shapes(train), everything)
        _print_row(f"val: {name}, base placed by train", place_points(placed, val, shapes(val)) - val.positions)
    assert robot.measured_error is not None
    bound = robot.measured_error.disks_m[-1]
    covered = np.mean(np.linalg.norm(differences, axis=2) <= bound)
    print(f"error bound for 95 %: {1e3 * bound:.2f} mm, covers {100 * covered:.1f} % of val")


def _predict(robot: RobotSpec, states: MeasuredStates) -> FloatArray:
    """Returns the reference's points; where it finds no stable shape those of the arcs, whose number is printed."""
    bench = bench_of_robot(robot, float(states.table.numbers(["time_s"])[0, 0]))
    points = Forward(states, ReferenceMechanics()).points(bench)
    lost = ~np.isfinite(points).all(axis=(1, 2))
    by_arcs = Forward(states, UnloadedMechanics()).points(bench)
    print(f"  without a shape by the reference, predicted by arcs: {lost.sum()} of {len(states)} states")
    if lost.any():
        _print_row("  those states, arcs", (by_arcs - states.positions)[lost])
        _print_row("  the other states, reference", (points - states.positions)[~lost])
    _print_row("  all states, arcs", by_arcs - states.positions)
    return np.where(lost[:, None, None], by_arcs, points)


def ingredients(arguments: argparse.Namespace) -> None:
    """Prints the error on held-out stretches of the training states as ingredients are added one after the other."""
    robot = load_robot(ROBOTS / "opencr.toml")
    with tempfile.TemporaryDirectory() as folder:
        train = _read(arguments.data / "train.csv", Path(folder) / "train.csv", robot)
    plain = _with_tendons(robot, between_disks="channel", friction_coefficient=0.0)
    straight = _with_tendons(robot, friction_coefficient=0.0)
    folds = blocks_in_time(train)
    nominal = Bench.nominal(plain, MARKER_M)
    shapes = constant_curvature_shapes(nominal, train)
    differences = np.full_like(train.positions, np.nan)
    for fold in range(int(folds.max()) + 1):
        placed = align_base(nominal, train, shapes, folds != fold)
        differences[folds == fold] = (place_points(placed, train, shapes) - train.positions)[folds == fold]
    print(f"{'held-out stretches of train, mm':<44}{'rms':>7}{'median':>8}{'95 %':>7}{'largest':>9}")
    _print_row("constant curvature, base placed", differences)
    names = ["transmission"]
    steps: list[tuple[str, list[str], RobotSpec, bool]] = [
        ("elastic tendons that go slack", [], plain, False),
        ("base pose", ["base", "marker"], plain, False),
        ("zeros and angles of tendons", ["offsets", "angles"], plain, False),
        ("drift of the zeros", ["drift"], plain, False),
        ("tendons straight between disks", [], straight, False),
        ("distances of tendons from the backbone", ["radii"], straight, False),
        ("axial compliance of the backbone", [], straight, True),
        ("friction, without axial compliance", ["friction"], robot, False),
    ]
    for title, more, variant, axial in steps:
        names += more
        _print_row(title, _held_out(train, variant, names, folds, axial=axial))


def _held_out(
    train: MeasuredStates, robot: RobotSpec, names: Sequence[str], folds: np.ndarray, *, axial: bool
) -> FloatArray:
    forward = Forward(train, UnloadedMechanics())
    bench = Bench.nominal(robot, MARKER_M)
    blocks = make_blocks(bench, names, float(train.times[-1]))
    if axial:
        blocks = (*blocks, _axial_block())
    start = fit_bench(forward, bench, blocks, np.ones(len(train), dtype=bool)).numbers
    differences = np.full_like(train.positions, np.nan)
    for fold in range(int(folds.max()) + 1):
        part = fit_bench(forward, bench, blocks, folds != fold, start=start)
        differences[folds == fold] = (forward.points(part.bench) - train.positions)[folds == fold]
    return differences


def _axial_block() -> Block:
    """Returns the block of the backbone's axial stiffness, which `tdcr calibrate` leaves as the file has it."""

    def apply(bench: Bench, values: FloatArray) -> Bench:
        rod = bench.robot.backbone
        stiffness = rod.stiffness_shear_extension[2] * float(np.exp(values[0]))
        return bench.with_robot(backbone={**rod.model_dump(), "axial_stiffness_n": stiffness})

    return Block("axial", (Parameter("axial", "", 1.0, 1.0, 2.0, is_ratio=True),), True, apply)


def simulated_robots(arguments: argparse.Namespace) -> None:
    """Counts how often the parameters of simulated robots lie within two standard errors."""
    robot = _with_tendons(load_robot(ROBOTS / "bench.toml"), friction_coefficient=0.05, sheath_angle_deg=90.0)
    robot = robot.model_copy(update={"tip": {"mass_kg": 0.0}})
    nominal = Bench.nominal(robot)
    truth_of = {"modulus": [np.log(1.15)], "friction": [0.05], "pretension": [0.5, 0.8, -0.3]}
    truth_of["angles"] = np.deg2rad([3.0, -3.0, 3.0] * 3).tolist()
    blocks = make_blocks(nominal, list(truth_of), 75.0)
    truth = nominal
    for block in blocks:
        truth = block.apply(truth, np.array(truth_of[block.name]))
    expected = np.concatenate([truth_of[block.name] for block in blocks])
    inside, noise_ratio = np.zeros(len(expected)), []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(arguments.repetitions):
            random = np.random.default_rng(seed)
            motion = smooth_motion(robot.tendon_count, 150, 0.002, random)
            path = write_simulated(Path(folder) / "bench.csv", truth, motion, 1e-3, random)
            states = read_measured_states(path, robot)
            found = calibrate(robot, states, list(truth_of), use_reference=False, folds=2)
            inside += np.abs(found.fit.numbers - expected) <= 2.0 * found.uncertainty.deviations
            fresh = commanded_states(truth, smooth_motion(robot.tendon_count, 150, 0.002, random))
            forward = Forward(fresh, UnloadedMechanics())
            error = np.linalg.norm(forward.points(found.fit.bench) - forward.points(truth), axis=2)
            noise_ratio.append(float(np.sqrt(np.mean(error**2) + 3e-6) / np.sqrt(3e-6)))
    print(f"{arguments.repetitions} simulated benches of 150 states, 1 mm of noise: modulus +15 %, friction 0.1")
    for parameter, count in zip([p for block in blocks for p in block.parameters], inside, strict=True):
        print(f"  {parameter.label:<24} within two standard errors: {count:.0f} of {arguments.repetitions}")
    share = inside.sum() / (len(inside) * arguments.repetitions)
    print(f"  all parameters: {100 * share:.1f} %")
    print(
        f"  error on fresh states over the noise: median {np.median(noise_ratio):.3f}, largest {max(noise_ratio):.3f}"
    )


def _with_tendons(robot: RobotSpec, **changes: object) -> RobotSpec:
    return robot.model_copy(update={"tendons": [{**table.model_dump(), **changes} for table in robot.tendon_tables]})


def _print_row(name: str, differences: FloatArray) -> None:
    errors = 1e3 * np.linalg.norm(differences, axis=2)
    seen = errors[np.isfinite(errors)]
    lost = errors.size - seen.size
    numbers = (
        f"{np.sqrt(np.mean(seen**2)):>7.2f}{np.median(seen):>8.2f}{np.quantile(seen, 0.95):>7.2f}{seen.max():>9.2f}"
    )
    print(f"{name:<44}{numbers}" + (f"  ({lost} without a shape)" if lost else ""), flush=True)


def _copy(source: Path, target: Path, rows: np.ndarray | None = None) -> Path:
    """Writes the measured robot's file in this project's columns and in metres, and returns its path.

    The columns of tendons stand in the order of the segments; patterns that only hold belong to the pattern before.
    """
    with source.open(newline="") as stream:
        table = list(csv.DictReader(stream))
    kept = table if rows is None else [table[row] for row in rows]
    names = list(table[0])
    tendons, tip = names[2:11], names[11:14]
    header = ["time_s", "pattern", *(f"tendon_displacement_{index + 1}_m" for index in range(9))]
    with target.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([*header, "marker_x_m", "marker_y_m", "marker_z_m"])
        for row in kept:
            lengths = [f"{1e-3 * float(row[name]):.9f}" for name in (*tendons, *tip)]
            writer.writerow([row["timestamp"], row["pattern_label"].removesuffix("_hold"), *lengths])
    return target


def _read(source: Path, target: Path, robot: RobotSpec) -> MeasuredStates:
    return read_measured_states(_copy(source, target), robot, base_is_known=False)


if __name__ == "__main__":
    main()
