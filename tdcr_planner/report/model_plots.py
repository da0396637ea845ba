"""Figures of a shape model's evaluation: errors along the robot, by load, and over the actuation plane."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.report.drawing import Drawing, draw_pictures
from tdcr_planner.report.plots import ALERT, PALETTE, new_figure, plot_style, save_figure
from tdcr_planner.report.text import figure_text

if TYPE_CHECKING:
    from tdcr_planner.learning.evaluate import Evaluation
    from tdcr_planner.shape.learned import LearnedShape


def draw_evaluation(model: LearnedShape, evaluation: Evaluation, folder: str | Path) -> list[str]:
    """Draws the figures of an evaluation into a folder and returns the names of those that were drawn.

    A figure that cannot be drawn is a warning that names it.
    """

    def styled(plot: Drawing) -> Drawing:
        def draw(file: Path) -> None:
            with plot_style():
                plot(file)

        return draw

    drawings: dict[str, Drawing] = {
        "error_by_disk.png": lambda file: _plot_by_disk(model, evaluation, file),
        "error_by_load.png": lambda file: _plot_by_load(model, evaluation, file),
        "error_over_actuation.png": lambda file: _plot_over_plane(evaluation, file),
    }
    return draw_pictures(folder, {name: styled(plot) for name, plot in drawings.items()})


def _plot_by_disk(model: LearnedShape, evaluation: Evaluation, path: Path) -> None:
    figure = new_figure(1000, 420)
    position, rotation = figure.subplots(1, 2)
    arc_lengths = 1e3 * model.card.robot.arc_lengths[1:]
    for axes, errors, unit in (
        (position, 1e3 * evaluation.errors[:, 1:], "position error, mm"),
        (rotation, np.degrees(evaluation.angles[:, 1:]), "rotation error, degrees"),
    ):
        levels = np.quantile(errors, [0.5, 0.99, 1.0], axis=0)
        for level, name, colour in zip(
            levels, ("median", "99th percentile", "largest"), ("blue", "orange", "vermilion"), strict=True
        ):
            axes.semilogy(arc_lengths, np.maximum(level, 1e-9), label=name, color=PALETTE[colour])
        axes.set_xlabel("arc length, mm")
        axes.set_ylabel(unit)
    bound = 1e3 * model.error_bound[1:]
    position.semilogy(arc_lengths, np.maximum(bound, 1e-9), "--", color=ALERT, label="error bound (whole disk)")
    position.legend()
    position.set_title(f"{figure_text(model.card.robot.name, 30)}: {len(evaluation.errors)} unseen cases")
    figure.tight_layout()
    save_figure(figure, path)


def _plot_by_load(model: LearnedShape, evaluation: Evaluation, path: Path) -> None:
    figure = new_figure(620, 420)
    axes = figure.subplots()
    bins = len(evaluation.by_load)
    centres = (np.arange(bins) + 0.5) / bins
    for column, (name, colour) in enumerate((("median", "blue"), ("99th percentile", "orange"))):
        level = np.maximum(1e3 * evaluation.by_load[:, column], 1e-9)
        axes.semilogy(100.0 * centres, level, "o-", label=name, color=PALETTE[colour])
    domain = model.card.domain
    axes.set_xlabel(f"load, % of {domain.gravity_m_s2:g} m/s² and {domain.tip_force_n:g} N")
    axes.set_ylabel("position error, mm")
    axes.legend()
    figure.tight_layout()
    save_figure(figure, path)


def _plot_over_plane(evaluation: Evaluation, path: Path) -> None:
    figure = new_figure(620, 520)
    axes = figure.subplots()
    tip = np.maximum(1e3 * evaluation.errors[:, -1], 1e-9)
    drawn = axes.scatter(
        evaluation.plane[:, 0], evaluation.plane[:, 1], c=np.log10(tip), s=6, cmap="viridis", linewidths=0
    )
    axes.set_aspect("equal")
    axes.set_xlabel("bending of the first segment, x, N")
    axes.set_ylabel("bending of the first segment, y, N")
    figure.colorbar(drawn, ax=axes, label="log10 of the tip's position error in mm")
    figure.tight_layout()
    save_figure(figure, path)
