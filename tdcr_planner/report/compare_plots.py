"""The plots of a comparison: wrong verdicts, agreement against clearance, deviation against clearance, paths, times."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdcr_planner.compare.comparison import Comparison
from tdcr_planner.compare.confusion import EXCESS_EDGES, agreement_by_clearance
from tdcr_planner.compare.paths import path_rates
from tdcr_planner.compare.verdicts import MODELS, VARIANTS
from tdcr_planner.rates import Rate
from tdcr_planner.report import plots

_DPI = 120
_LABELS = {
    "learned": "learned, with its error bound",
    "learned_without_bound": "learned, without it",
    "constant_curvature": "constant curvature",
    "learned_as_planned": "learned, as planned",
    "constant_curvature_as_planned": "constant curvature, as planned",
    "reference": "reference",
}
_COLOURS = {
    "learned": plots.PALETTE["blue"],
    "learned_without_bound": plots.PALETTE["sky"],
    "constant_curvature": plots.PALETTE["vermilion"],
    "learned_as_planned": plots.PALETTE["blue"],
    "constant_curvature_as_planned": plots.PALETTE["vermilion"],
    "reference": plots.INK,
}
_SHOWN_DOTS = 20_000


def write_compare_plots(comparison: Comparison, folder: Path) -> None:
    """Writes the plots of a comparison as PNG and PDF into an existing folder; paths only where some were planned."""
    drawings = {"rates": draw_rates, "agreement": draw_agreement, "deviation": draw_deviation, "times": draw_times}
    if comparison.paths:
        drawings["paths"] = draw_paths
    with plots.plot_style():
        for name, draw in drawings.items():
            figure = draw(comparison)
            for suffix in (".png", ".pdf"):
                plots.save_figure(figure, folder / f"{name}{suffix}")


def draw_rates(comparison: Comparison) -> Figure:
    """Returns a figure of the shares of false-valid and false-invalid states, with 95 % intervals, on a log scale."""
    figure = plots.new_figure(1300, 420, _DPI)
    left, right = figure.subplots(1, 2, sharey=True)
    names = [variant.name for variant in VARIANTS]
    for axes, kind, title in (
        (left, "false_valid", "False valid: a collision that the model misses"),
        (right, "false_invalid", "False invalid: room that caution costs"),
    ):
        rates = [comparison.confusion(variant).rates[kind] for variant in VARIANTS]
        _draw_rates(axes, names, rates)
        axes.set_xscale("log")
        axes.set_xlim(0.3 * 100.0 / len(comparison.verdicts.rows), 100.0)
        axes.set_title(title)
        axes.set_xlabel(f"of {len(comparison.verdicts.rows):,} states (%), line: 95 % interval")
    left.set_yticks(range(len(names)), [_LABELS[name] for name in names])
    left.invert_yaxis()
    figure.tight_layout()
    return figure


def _draw_rates(axes: Axes, names: list[str], rates: list[Rate]) -> None:
    floor = 1e-9
    for place, (name, rate) in enumerate(zip(names, rates, strict=True)):
        line = np.maximum([100.0 * rate.low, 100.0 * rate.high], floor)
        axes.plot(line, [place, place], color=_COLOURS[name], linewidth=2.5)
        if rate.count:
            axes.plot(100.0 * rate.value, place, "o", color=_COLOURS[name], markersize=8)
        text = f"{rate.count}" if rate.count else "none"
        axes.annotate(text, (line[1], place), xytext=(8, 0), textcoords="offset points", va="center", fontsize=9.0)


def draw_agreement(comparison: Comparison) -> Figure:
    """Returns a figure of the share of states on which model and reference agree, by clearance."""
    figure = plots.new_figure(1000, 560, _DPI)
    axes = figure.subplots()
    verdicts = comparison.verdicts
    for variant in (variant for variant in VARIANTS if not variant.with_half_step):
        bins = agreement_by_clearance(
            verdicts.valid(variant),
            verdicts.reference_valid,
            verdicts.clearance,
            comparison.scenario.planner.clearance_m,
        )
        place = [float(np.searchsorted(EXCESS_EDGES, part.low)) for part in bins]
        share = [100.0 * part.agreement.value for part in bins]
        low, high = ([100.0 * getattr(part.agreement, end) for part in bins] for end in ("low", "high"))
        colour = _COLOURS[variant.name]
        axes.fill_between(place, low, high, color=colour, alpha=0.15, linewidth=0.0)
        axes.plot(place, share, "o-", color=colour, label=_LABELS[variant.name], markersize=5)
    labels = [_bin_label(*ends) for ends in itertools.pairwise(EXCESS_EDGES)]
    axes.set_xticks(range(len(labels)), labels, rotation=45, ha="right")
    axes.axvline(float(np.searchsorted(EXCESS_EDGES, 0.0)) - 0.5, color=plots.ALERT, linewidth=1.2, linestyle="--")
    axes.set_ylim(0.0, 103.0)
    axes.set_xlabel("clearance under the reference, from the clearance asked (mm)")
    axes.set_ylabel("agreement with the reference (%)")
    axes.set_title("Agreement against clearance, band: 95 % interval")
    axes.legend(loc="lower right")
    figure.tight_layout()
    return figure


def _bin_label(low: float, high: float) -> str:
    if np.isinf(low):
        return f"below {1e3 * high:g}"
    if np.isinf(high):
        return f"above {1e3 * low:g}"
    return f"{1e3 * low:g} to {1e3 * high:g}"


def draw_deviation(comparison: Comparison) -> Figure:
    """Returns a figure of each state's deviation against its clearance, wrong verdicts marked."""
    verdicts, asked = comparison.verdicts, comparison.scenario.planner.clearance_m
    figure = plots.new_figure(1300, 560, _DPI)
    shown = np.zeros(len(verdicts.rows), dtype=np.bool_)
    shown[:_SHOWN_DOTS] = True
    all_axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, name in zip(all_axes, MODELS, strict=True):
        variant = next(variant for variant in VARIANTS if variant.name == name)
        valid, truth = verdicts.valid(variant), verdicts.reference_valid
        x, y = 1e3 * (verdicts.clearance - asked), 1e3 * np.maximum(verdicts.deviation_of(name), 1e-7)
        for which, colour, size, label in (
            (shown & (valid == truth), plots.MUTED, 2.0, "right"),
            (~valid & truth, plots.PALETTE["orange"], 5.0, "false invalid"),
            (valid & ~truth, plots.ALERT, 8.0, "false valid"),
        ):
            axes.scatter(
                x[which], y[which], s=size, color=colour, linewidths=0.0, rasterized=True,
                label=f"{label} ({int(((valid == truth) if label == 'right' else which).sum()):,})",
            )  # fmt: skip
        axes.axvline(0.0, color=plots.INK, linewidth=0.8)
        axes.set_yscale("log")
        axes.set_title(_LABELS[name])
        axes.set_xlabel("clearance under the reference, from the clearance asked (mm)")
        axes.legend(loc="lower right", markerscale=2.5)
    known = verdicts.clearance[np.isfinite(verdicts.clearance)]
    if len(known):
        low, high = 1e3 * (np.quantile(known, [0.005, 0.995]) - asked)
        all_axes[0].set_xlim(min(low, -1.0), max(high, 1.0))
    all_axes[0].set_ylabel("largest distance of a disk from the reference (mm)")
    figure.tight_layout()
    return figure


def draw_times(comparison: Comparison) -> Figure:
    """Returns a figure of the time a verdict takes, shape and whole check."""
    figure = plots.new_figure(900, 360, _DPI)
    axes = figure.subplots()
    for place, item in enumerate(comparison.times):
        colour = _COLOURS[item.model]
        axes.barh(place, item.check_us, 0.6, color=colour, alpha=0.35)
        axes.barh(place, item.shape_us, 0.6, color=colour)
        axes.annotate(
            f"{item.check_us:.3g} µs, {item.shape_us:.3g} of it for the shape",
            (item.check_us, place),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=9.0,
        )
    axes.set_yticks(range(len(comparison.times)), [item.model.replace("_", " ") for item in comparison.times])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.7 * max(item.check_us for item in comparison.times))
    axes.set_xlabel(f"µs a state, {comparison.times[0].batch:,} states a call; dark: the shape alone")
    axes.set_title("Time for a verdict")
    axes.grid(visible=False, axis="y")
    figure.tight_layout()
    return figure


def draw_paths(comparison: Comparison) -> Figure:
    """Returns a figure of how many planned paths the reference verifies, by the model that the search asked."""
    figure = plots.new_figure(900, 380, _DPI)
    axes = figure.subplots()
    kinds = (
        ("found", "path found, of all queries"),
        ("verified_at_once", "first path verified, of those found"),
        ("verified", "verified in the end, of all queries"),
    )
    for offset, rates in zip((-0.2, 0.2), path_rates(comparison.paths, MODELS), strict=True):
        for place, (name, _) in enumerate(kinds):
            rate: Rate = getattr(rates, name)
            label = rates.model.replace("_", " ") if place == 0 else None
            value = 100.0 * rate.value if rate.total else 0.0
            axes.barh(place + offset, value, 0.36, color=_COLOURS[rates.model], alpha=0.8, label=label)
            axes.plot([100.0 * rate.low, 100.0 * rate.high], [place + offset] * 2, color=plots.INK, linewidth=1.2)
    axes.set_yticks(range(len(kinds)), [text for _, text in kinds])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("%, line: 95 % interval")
    axes.set_title("Planned paths under the reference")
    axes.grid(visible=False, axis="y")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    figure.tight_layout()
    return figure
