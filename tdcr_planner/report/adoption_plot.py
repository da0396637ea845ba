"""The picture of an adopted network: where in its domain the error lies, and how its bound follows it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tdcr_planner.report.plots import ALERT, PALETTE, new_figure, plot_style, save_figure
from tdcr_planner.report.text import figure_text

if TYPE_CHECKING:
    from tdcr_planner.adoption.adopt import Adopted

_SMALLEST_MM = 1e-7  # drawn; less is rounding


def draw_adoption(adopted: Adopted, path: Path) -> None:
    """Draws the tip's error on unseen cases over the bending plane, by tension and load, and against its bound."""
    card, cases = adopted.card, adopted.cases
    tip = np.maximum(1e3 * adopted.errors, _SMALLEST_MM)
    bound = np.maximum(1e3 * adopted.bounds, _SMALLEST_MM)
    plane = card.robot.bending_from_tensions(cases.tensions)[:, 0]
    with plot_style():
        figure = new_figure(1500, 460)
        figure.set_layout_engine("constrained")
        over_plane, by_use, by_bound = figure.subplots(1, 3, width_ratios=[1.25, 1.0, 1.0])
        drawn = over_plane.scatter(plane[:, 0], plane[:, 1], c=np.log10(tip), s=5, cmap="viridis", linewidths=0)
        over_plane.set_aspect("equal")
        over_plane.set_xlabel("bending of the first segment, x, N")
        over_plane.set_ylabel("bending of the first segment, y, N")
        over_plane.set_title(
            f"{figure_text(card.adoption.source if card.adoption else '', 30)}: {len(tip):,} unseen cases"
        )
        figure.colorbar(drawn, ax=over_plane, label="log10 of the tip's error in mm")
        limits = np.asarray(card.domain.max_tension_n)
        uses = {"largest tension": (cases.tensions / limits).max(axis=1)}
        for name, vectors, largest in (
            ("gravity", cases.gravity, card.domain.gravity_m_s2),
            ("tip force", cases.tip_force, card.domain.tip_force_n),
        ):
            if largest > 0.0:
                uses[name] = np.linalg.norm(vectors, axis=1) / largest
        for (name, use), colour in zip(uses.items(), ("blue", "orange", "green"), strict=False):
            centres, levels = _by_tenths(use, tip)
            by_use.semilogy(100.0 * centres, levels[:, 0], "o-", color=PALETTE[colour], label=f"{name}, median")
            by_use.semilogy(100.0 * centres, levels[:, 1], "--", color=PALETTE[colour], label=f"{name}, 99 %")
        by_use.set_xlabel("% of the domain")
        by_use.set_ylabel("error at the tip, mm")
        by_use.legend(fontsize="small")
        by_bound.loglog(bound, tip, ".", ms=2, color=PALETTE["blue"])
        ends = [min(bound.min(), tip.min()), max(bound.max(), tip.max())]
        by_bound.loglog(ends, ends, color=ALERT, label="error = bound")
        by_bound.set_xlabel("bound in that state at the tip, mm")
        by_bound.set_ylabel("error at the tip, mm")
        by_bound.legend()
        save_figure(figure, path)


def _by_tenths(use: np.ndarray, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the middles of tenths of the domain that hold cases, and median and 99th percentile there."""
    bins = np.minimum((10.0 * use).astype(int), 9)
    held = [index for index in range(10) if (bins == index).sum() >= 10]
    levels = [np.quantile(tip[bins == index], [0.5, 0.99]) for index in held]
    return (np.array(held) + 0.5) / 10.0, np.array(levels).reshape(-1, 2)
