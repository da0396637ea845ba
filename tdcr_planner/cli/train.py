"""tdcr train: a shape model for a robot, from nothing."""

from __future__ import annotations

import sys
from pathlib import Path

import tyro


def train(
    robot: tyro.conf.Positional[Path],
    *,
    out: Path,
    config: Path | None = None,
    log: Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: bool = True,
) -> int:
    """Train a shape model for a robot and write it with its card.

    Example: tdcr train models/robots/inspection.toml --config models/shape/inspection/train.toml --out model.pt

    Draws cases, solves them with the Cosserat reference, trains, judges the model on unseen cases and writes one
    TorchScript file. A run that was stopped goes on where it was when the same command is given again. With
    measured shapes in the configuration, the robot they describe is written beside the model.

    It ends with a verdict: whether the model is fit for planning, its error bound being small against the robot's
    disks. Exit code 1 says that it is not, and what to blame; the model file is written all the same.

    The cases are the same, up to rounding, wherever they are solved: in this process, by --jobs processes, or by the
    workers of a Dask cluster, of which some may die on the way.

    Args:
        robot: Robot file.
        out: Model file to write.
        config: Settings of the training (train.toml); the defaults without it.
        log: Folder for TensorBoard logs; none without it.
        jobs: Processes that solve the cases; without it this one does, with the threads of the configuration.
        scheduler: Address of a Dask scheduler whose workers solve the cases instead, such as tcp://127.0.0.1:8786.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    from tdcr_planner.cli.backend import choose_backend
    from tdcr_planner.cli.cost import tell_cost, training_cost
    from tdcr_planner.cli.progress import StageBar
    from tdcr_planner.files import check_file_target
    from tdcr_planner.learning.checkpoint import checkpoint_path
    from tdcr_planner.learning.fitness import judge_fitness
    from tdcr_planner.learning.fitting import train_on_measured
    from tdcr_planner.learning.loads import check_domain, tip_motion
    from tdcr_planner.learning.settings import load_train_settings
    from tdcr_planner.learning.train import train_model
    from tdcr_planner.robot import load_robot
    from tdcr_planner.shape.learned import load_shape_model
    from tdcr_planner.workers import ALLOWED_LOSSES

    backend = choose_backend(jobs, scheduler, losses=ALLOWED_LOSSES)
    check_file_target(out)
    check_file_target(checkpoint_path(out))
    spec, settings = load_robot(robot), load_train_settings(config)
    domain = settings.domain.for_robot(spec)
    check_domain(spec, domain)
    print(tip_motion(spec, domain).describe(spec, domain), flush=True)
    seconds, memory = training_cost(spec, settings)
    tell_cost("training", seconds, memory)
    with StageBar(shown=progress) as bar:
        try:
            if settings.measured is None:
                card = train_model(spec, settings, out, progress=bar.update, log_folder=log, backend=backend)
            else:
                card = train_on_measured(spec, settings, out, progress=bar.update, log_folder=log, backend=backend)
        except KeyboardInterrupt:
            bar.close()
            kept = checkpoint_path(out)
            state = f"{kept} is kept, the same command goes on from there" if kept.exists() else "no epoch was finished"
            print(f"interrupted: {state}; {out} is as it was", file=sys.stderr)
            return 1
        try:
            fitness = judge_fitness(load_shape_model(out), threads=settings.dataset.threads, progress=bar.update)
        except KeyboardInterrupt:
            bar.close()
            print(f"interrupted before the verdict: {out} is written", file=sys.stderr)
            return 1
    print(card.describe())
    print(f"file: {out}")
    print(fitness.describe())
    return 0 if fitness.fit else 1
