"""tdcr train: a shape model for a robot, from nothing."""

from __future__ import annotations

import sys
from pathlib import Path
from types import TracebackType

import tyro
from tqdm import tqdm


def train(
    robot: tyro.conf.Positional[Path],
    *,
    out: Path,
    config: Path | None = None,
    log: Path | None = None,
    progress: bool = True,
) -> int:
    """Train a shape model for a robot and write it with its card.

    Example: tdcr train models/robots/inspection.toml --config models/shape/inspection/train.toml --out model.pt

    Draws cases, solves them with the Cosserat reference, trains, judges the model on unseen cases and writes one
    TorchScript file. A run that was stopped goes on where it was when the same command is given again. With
    measured shapes in the configuration, the robot they describe is written beside the model.

    Args:
        robot: Robot file.
        out: Model file to write.
        config: Settings of the training (train.toml); the defaults without it.
        log: Folder for TensorBoard logs; none without it.
        progress: Draw a progress bar.
    """
    from tdcr_planner.learning.checkpoint import checkpoint_path
    from tdcr_planner.learning.measured import train_on_measured
    from tdcr_planner.learning.settings import load_train_settings
    from tdcr_planner.learning.train import train_model
    from tdcr_planner.robot import load_robot

    spec, settings = load_robot(robot), load_train_settings(config)
    with StageBar(shown=progress) as bar:
        try:
            if settings.measured is None:
                card = train_model(spec, settings, out, progress=bar.update, log_folder=log)
            else:
                card = train_on_measured(spec, settings, out, progress=bar.update, log_folder=log)
        except KeyboardInterrupt:
            bar.close()
            kept = checkpoint_path(out)
            state = f"{kept} is kept, the same command goes on from there" if kept.exists() else "no epoch was finished"
            print(f"interrupted: {state}; {out} is as it was", file=sys.stderr)
            return 1
    print(card.describe())
    print(f"file: {out}")
    return 0


class StageBar:
    """A progress bar for work in stages, with the time left in the present one."""

    def __init__(self, *, shown: bool = True) -> None:
        """Prepares the bar; it is not drawn when `shown` is false or standard error is no terminal."""
        self._shown = shown and sys.stderr.isatty()
        self._stage = ""
        self._bar: tqdm | None = None

    def __enter__(self) -> StageBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the present bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def update(self, stage: str, done: int, total: int, remark: str) -> None:
        """Moves the bar: `done` of `total` steps of a stage; another stage begins another bar."""
        if not self._shown:
            return
        if self._bar is None or stage != self._stage:
            self.close()
            self._stage = stage
            # A resumed stage begins where it was; the time left counts only what this run does.
            self._bar = tqdm(total=total, desc=stage, initial=max(0, done - 1) if total < 10_000 else 0)
        self._bar.set_postfix_str(remark, refresh=False)
        self._bar.update(done - self._bar.n)
