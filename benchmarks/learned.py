"""Accuracy, physics and speed of the shipped shape models, against the reference and the published network.

Run: python benchmarks/learned.py [--quick] [--paper-model FILE]. All ratios come from one run on one thread.
The published network is read from the file that models/shape/paper/README.md makes within the budget of the others.
"""

# One thread must be asked for before numpy is imported.
# ruff: noqa: E402

from __future__ import annotations

import argparse
import os
import platform
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
import torch

from tdcr_planner.learning.dataset import Cases, draw_cases, solve_cases
from tdcr_planner.learning.evaluate import best_time, evaluate_model
from tdcr_planner.learning.judge import body_errors
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.robot import load_robot
from tdcr_planner.shape.learned import LearnedShape, load_shape_model
from tdcr_planner.shape.paper_network import SECTOR

ROOT = Path(__file__).resolve().parents[1]
BATCHES = (1000, 10, 1)


def shipped(name: str) -> LearnedShape:
    return load_shape_model(ROOT / f"models/shape/{name}/model.pt", load_robot(ROOT / f"models/robots/{name}.toml"))


def unloaded(model: LearnedShape, count: int) -> dict[str, float]:
    """Errors of a model without loads, on tensions of least sum all around."""
    robot = model.card.robot
    domain = DomainSettings(gravity_m_s2=0.0, tip_force_n=0.0).for_robot(robot)
    solved = solve_cases(robot, draw_cases(robot, domain, "planner", count, np.random.default_rng(90)))
    cases = solved.cases
    poses = model.disk_poses_unchecked(cases.tensions, cases.gravity, cases.tip_force)
    distance = 1e3 * np.linalg.norm(poses.positions - solved.positions, axis=2)[:, 1:]
    chord = np.linalg.norm(poses.rotations - solved.rotations, axis=(2, 3))[:, 1:]
    angle = np.degrees(2.0 * np.arcsin(np.clip(chord / np.sqrt(8.0), 0.0, 1.0)))
    return {
        "median": float(np.median(distance)),
        "p99": float(np.quantile(distance, 0.99)),
        "largest": float(distance.max()),
        "rotation": float(np.median(angle)),
    }


def published_physics(model: LearnedShape, count: int) -> dict[str, float]:
    """What the published network leaves over of the equations at the disks of unseen shapes in its sector.

    The residual of the cut form without loads is Kbt u - sum r_i x (-tau_i e3), there being no moment across any cut.
    """
    robot, module = model.card.robot, model.torch_module
    random = np.random.default_rng(91)
    angle = torch.as_tensor(random.uniform(0.0, SECTOR, count))
    force = torch.as_tensor(random.uniform(0.0, float(robot.max_tensions[0]), count))
    pairs = module.tensions_in_sector(angle, force).float()
    stops = torch.as_tensor(robot.arc_lengths).float()
    rows = torch.cat([stops.repeat(count).reshape(-1, 1), pairs.repeat_interleave(len(stops), dim=0)], dim=1)
    out = module.cross_sections(rows.requires_grad_())
    slopes = [torch.autograd.grad(out[:, axis].sum(), rows, retain_graph=True)[0][:, 0] for axis in range(3)]
    strain = torch.linalg.vector_norm(torch.stack(slopes, dim=1), dim=1)
    rotations = module.rotation(out[:, 3:6]).detach().double().numpy()
    offsets = robot.tendon_offsets[np.argsort(np.mod(robot.tendon_angles, 2.0 * np.pi))[:2]]
    pull = np.cross(offsets, [0.0, 0.0, -1.0])
    moment = np.array(robot.backbone.stiffness_bending_torsion) * out[:, 6:9].detach().double().numpy()
    residual = np.linalg.norm(moment - rows[:, 1:].detach().double().numpy() @ pull, axis=1)
    return {
        "residual": float(np.median(residual)),
        "strain": float((strain - 1.0).abs().max().detach()),
        "turned": float(np.abs(np.swapaxes(rotations, -1, -2) @ rotations - np.eye(3)).max()),
    }


def coverage(model: LearnedShape, count: int) -> dict[str, float]:
    """Share of fresh cases outside the bound at any disk, for each sample."""
    robot, shares = model.card.robot, {}
    for index, sample in enumerate(("uniform", "planner")):
        outside = cases = 0
        for part in range(0, count, 20_000):
            generator = np.random.default_rng([4321, index, part])
            drawn = draw_cases(robot, model.card.domain, sample, min(20_000, count - part), generator)
            solved = solve_cases(robot, drawn)
            poses = model.disk_poses_unchecked(*vars(solved.cases).values())
            errors = body_errors(robot, poses.positions, poses.rotations, solved)
            outside += int((errors > model.error_bound).any(axis=1).sum())
            cases += len(errors)
        shares[sample] = outside / cases
    return shares


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer cases")
    parser.add_argument("--paper-model", type=Path, default=ROOT / "models/shape/paper/published.pt")
    options = parser.parse_args()
    torch.set_num_threads(1)
    count = 2_000 if options.quick else 20_000
    machine = platform.processor() or platform.machine()
    print(f"{machine}, {os.cpu_count()} cores, one thread, python {platform.python_version()}")
    paper = load_shape_model(options.paper_model)
    print(
        "\n| model | loads | median mm | 99 % mm | largest mm | rotation median ° | residual median N m "
        "| largest \\|p'\\| - 1 | largest R'R - I |"
    )
    print("|---" * 9 + "|")
    row, physics = unloaded(paper, 300), published_physics(paper, 300)
    print(
        f"| published network | none | {row['median']:.3g} | {row['p99']:.3g} | {row['largest']:.3g} "
        f"| {row['rotation']:.3g} | {physics['residual']:.1e} | {physics['strain']:.1e} | {physics['turned']:.1e} |"
    )
    models = [shipped(name) for name in ("paper", "inspection", "two_segment")]
    row = unloaded(models[0], count)
    print(
        f"| paper.toml | none | {row['median']:.2g} | {row['p99']:.2g} | {row['largest']:.2g} "
        f"| {row['rotation']:.2g} | 0 | | |"
    )
    evaluations = [evaluate_model(model, count, seed=99) for model in models]
    for model, evaluation in zip(models, evaluations, strict=True):
        for accuracy in evaluation.accuracy:
            figures = accuracy.overall
            print(
                f"| {model.card.robot.name}.toml | gravity, tip force ({accuracy.sample}) "
                f"| {figures['position_median_mm']:.3g} | {figures['position_p99_mm']:.3g} "
                f"| {figures['position_max_mm']:.3g} | {figures['rotation_median_deg']:.3g} "
                f"| {figures['residual_median_nm']:.1e} | {evaluation.arc_length_violation:.1e} "
                f"| {evaluation.rotation_violation:.1e} |"
            )
        worst = evaluation.constant_curvature.overall
        print(
            f"| constant curvature on {model.card.robot.name}.toml | (uniform) | {worst['position_median_mm']:.3g} "
            f"| {worst['position_p99_mm']:.3g} | {worst['position_max_mm']:.3g} "
            f"| {worst['rotation_median_deg']:.3g} | | | |"
        )
    print("\n| model | batch | us a shape | us a call | times faster than the reference | than the published network |")
    print("|---|---|---|---|---|---|")
    zero = np.zeros((1000, 3))
    tensions = np.random.default_rng(3).uniform(0.0, 3.5, (1000, 3))
    published = {}
    for batch in BATCHES:
        inputs = Cases(tensions[:batch], zero[:batch], zero[:batch])
        published[batch] = best_time(lambda part=inputs: paper.disk_poses_unchecked(*vars(part).values()), 10) / batch
    for model, evaluation in zip(models, evaluations, strict=True):
        for timing in evaluation.timings:
            print(
                f"| {model.card.robot.name} | {timing.batch} | {timing.model_us:.2f} | "
                f"{timing.model_us * timing.batch:.1f} | {timing.reference_us / timing.model_us:.1f} "
                f"| {1e6 * published[timing.batch] / timing.model_us:.1f} |"
            )
    print("\n| model | error bound mm (alpha) | outside it, uniform | outside it, planner | cases each |")
    print("|---|---|---|---|---|")
    fresh = 5_000 if options.quick else 100_000
    for model in models:
        shares = coverage(model, fresh)
        bound = model.card.error_bound
        print(
            f"| {model.card.robot.name} | {1e3 * max(bound.disk_m):.3g} ({bound.alpha:g}) | {shares['uniform']:.5f} "
            f"| {shares['planner']:.5f} | {fresh} |"
        )


if __name__ == "__main__":
    main()
