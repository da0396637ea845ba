"""The results of Bensch et al. 2024 again: error against computation time, and the speed-up over the reference.

Run: python benchmarks/published.py [--quick] [--paper-model FILE] [--picture FILE]. Prints the tables of docs/paper.md
and draws its picture. Times are processor time of this process on one thread, the best of several runs, so that ratios
come from one run; figures of the published programs were measured once, on a machine of the same kind.
"""

# One thread must be asked for before numpy is imported.
# ruff: noqa: E402

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
import torch
from matplotlib.axes import Axes

from tdcr_planner.learning.dataset import draw_cases
from tdcr_planner.report.plots import MUTED, PALETTE, new_figure, plot_style, save_figure
from tdcr_planner.robot import RobotSpec, load_robot
from tdcr_planner.se3 import rotation_distance
from tdcr_planner.shape.base import DiskPoses
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape
from tdcr_planner.shape.learned import LearnedShape, load_shape_model
from tdcr_planner.statics.solver import SolverSettings, solve_statics

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = Path(__file__).parent / "data" / "published_program.npz"
# The authors' evaluation goes up to this length of the bending vector, N.
LARGEST_FORCE = 3.499
# What the picture calls zero: rounding.
FLOOR_MM = 1e-13
EXACT = SolverSettings(tolerance=1e-13, steps_per_gap=10)
# Step of the integration and optimality of the published C++ program: milliseconds a shape, times slower than the
# published network in a batch as measured, the same as Bensch et al. state it in table II.
PUBLISHED_TABLE = [
    ("1 mm", "1e-4", 862.0, 13_947, 12_352),
    ("5 mm", "1e-4", 177.0, 2_838, 2_556),
    ("10 mm", "1e-4", 88.0, 1_196, 1_297),
    ("10 mm", "1e-3", 67.0, 931, 921),
    ("10 mm", "5e-3", 59.0, 860, 731),
    ("10 mm", "1e-2", 47.0, 704, 641),
]
# The published network with its authors' last weights: us a shape in a batch and singly; median and largest error, mm.
PUBLISHED_BATCH_US, PUBLISHED_SINGLE_US = 57.0, (150.0, 200.0)
PUBLISHED_MEDIAN_MM, PUBLISHED_LARGEST_MM = 0.44, 3.5


@dataclass(frozen=True)
class Method:
    """One way to a shape, measured.

    Attributes:
        name: As the tables call it.
        errors: Position error of each case and disk but the base, shape (n, d - 1), mm.
        angles: Rotation error likewise, degrees.
        batch_us: Time a shape in one batch of all cases.
        single_us: Time of a single shape.
    """

    name: str
    errors: np.ndarray
    angles: np.ndarray
    batch_us: float
    single_us: float


def actuations(robot: RobotSpec, directions: int, forces: int) -> np.ndarray:
    """Returns tensions (n, 3) all around, from 0.2 N up to the largest force of the authors' evaluation."""
    angle = np.repeat(2.0 * np.pi * np.arange(directions) / directions, forces)
    force = np.tile(np.linspace(0.2, LARGEST_FORCE, forces), directions)
    bending = force[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, None]
    return np.asarray(robot.tensions_from_bending(bending))


def best_us(call: Callable[[], object], repeats: int) -> float:
    """Returns the least processor time of several runs, us, after one to warm up; short calls are repeated in a run."""
    call()
    started = time.process_time()
    call()
    inner = max(1, int(0.01 / max(time.process_time() - started, 1e-6)))
    times = []
    for _ in range(repeats):
        started = time.process_time()
        for _ in range(inner):
            call()
        times.append((time.process_time() - started) / inner)
    return 1e6 * min(times)


def measure(
    name: str, call: Callable[[slice], DiskPoses], count: int, exact: DiskPoses, repeats: int, singles: int = 20
) -> Method:
    """Returns errors and times of a method, given as a function from a slice of the cases to poses."""
    poses = call(slice(None))
    every = np.linspace(0, count - 1, singles).astype(int)

    def one_by_one() -> None:
        for index in every:
            call(slice(index, index + 1))

    return Method(
        name,
        1e3 * np.linalg.norm(poses.positions - exact.positions, axis=2)[:, 1:],
        np.degrees(rotation_distance(poses.rotations, exact.rotations))[:, 1:],
        best_us(lambda: call(slice(None)), repeats) / count,
        best_us(one_by_one, repeats) / singles,
    )


def reference_call(
    robot: RobotSpec, tensions: np.ndarray, settings: SolverSettings, loads: dict[str, np.ndarray] | None = None
) -> Callable[[slice], DiskPoses]:
    """Returns the reference at some settings as a method for `measure`."""

    def call(rows: slice) -> DiskPoses:
        part = {name: value[rows] for name, value in (loads or {}).items()}
        solution = solve_statics(robot, tensions[rows], settings=settings, **part)
        return DiskPoses(solution.positions, solution.rotations, solution.converged)

    return call


def learned_call(
    model: LearnedShape, tensions: np.ndarray, loads: dict[str, np.ndarray] | None = None
) -> Callable[[slice], DiskPoses]:
    """Returns a learned model as a method for `measure`."""
    zero = np.zeros((len(tensions), 3))
    gravity, tip_force = (loads or {}).get("gravity", zero), (loads or {}).get("tip_force", zero)
    return lambda rows: model.disk_poses_unchecked(tensions[rows], gravity[rows], tip_force[rows])


def unloaded(paper: LearnedShape, quick: bool) -> tuple[list[Method], np.ndarray, Method]:
    """Returns all methods on the published case, its tensions, and the errors of the published program."""
    robot = load_robot(ROOT / "models/robots/paper.toml")
    tensions = actuations(robot, 12, 7) if quick else actuations(robot, 24, 14)
    exact = reference_call(robot, tensions, EXACT)(slice(None))
    repeats = 3 if quick else 7
    shipped = load_shape_model(ROOT / "models/shape/paper/model.pt", robot)
    arc = ConstantCurvatureShape(robot)
    calls: dict[str, Callable[[slice], DiskPoses]] = {
        "published network, trained here": learned_call(paper, tensions),
        "model of this project": learned_call(shipped, tensions),
        "arc, closed form": lambda rows: arc.disk_poses(tensions[rows]),
    }
    for steps, tolerance in ((10, 1e-11), (10, 1e-4), (2, 1e-4), (1, 1e-4), (1, 1e-3)):
        settings = SolverSettings(tolerance=tolerance, steps_per_gap=steps)
        calls[f"reference, step {10 / steps:g} mm, {tolerance:g}"] = reference_call(robot, tensions, settings)
    methods = [measure(name, call, len(tensions), exact, repeats) for name, call in calls.items()]
    with np.load(PROGRAM) as data:
        shapes = reference_call(robot, data["tensions_n"], EXACT)(slice(None))
        distance = 1e3 * np.linalg.norm(data["positions_m"] - shapes.positions, axis=2)[:, 1:]
    program = Method("published program, step 1 mm", distance, np.full_like(distance, np.nan), 862e3, 862e3)
    return methods, tensions, program


def loaded(quick: bool) -> list[Method]:
    """Returns reference and learned model on a robot under gravity and a tip force."""
    robot = load_robot(ROOT / "models/robots/inspection.toml")
    model = load_shape_model(ROOT / "models/shape/inspection/model.pt", robot)
    cases = draw_cases(robot, model.card.domain, "uniform", 300 if quick else 1000, np.random.default_rng(7))
    loads = {"gravity": cases.gravity, "tip_force": cases.tip_force}
    exact = reference_call(robot, cases.tensions, EXACT, loads)(slice(None))
    arc = ConstantCurvatureShape(robot)
    calls: dict[str, Callable[[slice], DiskPoses]] = {
        "model of this project": learned_call(model, cases.tensions, loads),
        "arc, closed form": lambda rows: arc.disk_poses(cases.tensions[rows]),
    }
    for steps, tolerance in ((10, 1e-9), (2, 1e-9), (1, 1e-9), (1, 1e-4), (1, 1e-3)):
        settings = SolverSettings(tolerance=tolerance, steps_per_gap=steps)
        name = f"reference, step {10 / steps:g} mm, {tolerance:g}"
        calls[name] = reference_call(robot, cases.tensions, settings, loads)
    return [measure(name, call, len(cases), exact, 3 if quick else 7) for name, call in calls.items()]


def print_methods(methods: list[Method], network: Method, ours: Method) -> None:
    """Prints errors, times and how many times slower than the two networks each method is."""
    print(
        "| method | median mm | 95 % mm | largest mm | tip, median mm | rotation, median ° | us a shape, batch "
        f"| single | times {network.name}, batch | single | times {ours.name}, batch | single |"
    )
    print("|---" * 12 + "|")
    for method in methods:
        figures = [*np.quantile(method.errors, [0.5, 0.95, 1.0]), np.median(method.errors[:, -1])]
        figures += [np.median(method.angles)]
        ratios = [
            f"{time_us / against:.3g}"
            for pair in ((network.batch_us, network.single_us), (ours.batch_us, ours.single_us))
            for time_us, against in zip((method.batch_us, method.single_us), pair, strict=True)
        ]
        cells = [method.name, *(f"{figure:.2g}" for figure in figures)]
        cells += [f"{method.batch_us:.2f}", f"{method.single_us:.1f}", *ratios]
        print("| " + " | ".join(cells) + " |")


def draw(methods: list[Method], program: Method, tensions: np.ndarray, path: Path) -> None:
    """Draws error against time, error along the backbone, and the network's tip error over the actuation plane."""
    robot = load_robot(ROOT / "models/robots/paper.toml")
    network = methods[0]
    with plot_style():
        figure = new_figure(1500, 500)
        against_time, along, plane = figure.subplots(1, 3, width_ratios=[1.35, 1.0, 1.1])
        draw_against_time(against_time, methods, program)
        arc_lengths = 1e3 * robot.arc_lengths[1:]
        for share, style in ((0.5, "-"), (0.95, "--")):
            label = "median" if share == 0.5 else "95 %"
            for method, colour in ((network, "vermilion"), (methods[1], "blue"), (program, "black")):
                level = np.maximum(np.quantile(method.errors, share, axis=0), FLOOR_MM)
                name = f"{method.name.split(',')[0]}, {label}"
                along.semilogy(arc_lengths, level, style, color=PALETTE[colour], label=name)
        along.set_xlabel("arc length, mm")
        along.set_ylabel("position error, mm")
        along.set_title("Error along the backbone")
        along.set_ylim(FLOOR_MM, 1e3)
        along.legend(loc="center", bbox_to_anchor=(0.5, 0.36), fontsize=8)
        bending = robot.bending_from_tensions(tensions)[:, 0]
        shown = plane.scatter(bending[:, 0], bending[:, 1], c=network.errors[:, -1], s=26, cmap="viridis", linewidths=0)
        plane.set_aspect("equal")
        plane.set_xlabel("bending x, N")
        plane.set_ylabel("bending y, N")
        plane.set_title("Tip error of the network trained here")
        figure.colorbar(shown, ax=plane, label="mm", shrink=0.85)
        figure.tight_layout()
        save_figure(figure, path)


def draw_against_time(axes: Axes, methods: list[Method], program: Method) -> None:
    """Draws one column of errors a method at its time a shape, with its median, and the line of 1 % of the length."""
    random = np.random.default_rng(0)
    shown = [
        (methods[0], "vermilion", "published network,\ntrained here", "top"),
        (methods[1], "blue", "model of\nthis project", "top"),
        (methods[3], "green", "reference,\n1 mm", "top"),
        (methods[6], "sky", "reference,\n10 mm", "top"),
        (program, "black", "published\nprogram, 1 mm", "foot"),
    ]
    for method, colour, name, place in shown:
        errors = np.maximum(random.choice(method.errors.reshape(-1), 600), FLOOR_MM)
        seconds = 1e-6 * method.batch_us
        axes.loglog(seconds * random.uniform(0.85, 1.18, len(errors)), errors, ".", ms=2, alpha=0.35, c=PALETTE[colour])
        middle = max(float(np.median(method.errors)), FLOOR_MM)
        axes.plot([seconds * 0.7, seconds * 1.43], [middle, middle], color=PALETTE[colour], lw=3)
        at, shift, side = (errors.max(), 6, "bottom") if place == "top" else (errors.min(), -6, "top")
        axes.annotate(
            name,
            (seconds, at),
            (0, shift),
            textcoords="offset points",
            ha="center",
            va=side,
            fontsize=8,
            c=PALETTE[colour],
        )
    network_s = 1e-6 * PUBLISHED_BATCH_US
    axes.plot([network_s] * 2, [PUBLISHED_MEDIAN_MM, PUBLISHED_LARGEST_MM], color=PALETTE["purple"], lw=1.5, zorder=4)
    axes.plot(network_s, PUBLISHED_MEDIAN_MM, "D", color=PALETTE["purple"], ms=7, mec="white", zorder=5)
    axes.annotate(
        "its authors' weights,\nmedian and largest",
        (network_s, PUBLISHED_MEDIAN_MM),
        (-8, -4),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=8,
        c=PALETTE["purple"],
    )
    axes.axhline(2.0, ls=":", c=MUTED)
    axes.annotate("1 % of the length", (3e-3, 2.0), (0, 3), textcoords="offset points", fontsize=8, c=MUTED)
    axes.set_xlim(1e-6, 5.0)
    axes.set_ylim(FLOOR_MM, 1e4)
    axes.set_xlabel("time a shape, s")
    axes.set_ylabel("position error, mm")
    axes.set_title("Error against computation time")


def main() -> None:
    """Prints the tables and draws the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer cases and repeats")
    parser.add_argument("--paper-model", type=Path, default=ROOT / "models/shape/paper/published.pt")
    parser.add_argument("--picture", type=Path, help="where to draw the picture")
    options = parser.parse_args()
    torch.set_num_threads(1)
    machine = platform.processor() or platform.machine()
    print(
        f"{machine}, {os.cpu_count()} cores, one thread, python {platform.python_version()}, torch {torch.__version__}"
    )
    paper = load_shape_model(options.paper_model)
    methods, tensions, program = unloaded(paper, options.quick)
    print(f"\nThe published case, {len(tensions)} actuations all around, no loads:\n")
    print_methods(methods, methods[0], methods[1])
    figures = np.quantile(program.errors, [0.5, 0.95, 1.0])
    print(f"\nPublished program, step 1 mm, 90 actuations: {figures[0]:.2g}, {figures[1]:.2g}, {figures[2]:.2g} mm")
    print("\nTable II, and the reference of this project at the same steps:\n")
    print("| step | optimality | published, ms | ratio | ratio in the paper | reference here, us | times faster |")
    print("|---|---|---|---|---|---|---|")
    ours = {"1 mm": methods[4], "5 mm": methods[5], "10 mm": methods[6]}
    for step, optimality, ms, ratio, stated in PUBLISHED_TABLE:
        us = ours[step].batch_us
        print(f"| {step} | {optimality} | {ms:g} | {ratio:,} | {stated:,} | {us:.2f} | {1e3 * ms / us:,.0f} |")
    print("\nUnder gravity in any direction and a tip force up to 0.05 N, models/robots/inspection.toml:\n")
    under_load = loaded(options.quick)
    print_methods(under_load, methods[0], under_load[0])
    if options.picture is not None:
        draw(methods, program, tensions, options.picture)
        print(f"\npicture: {options.picture}")


if __name__ == "__main__":
    main()
