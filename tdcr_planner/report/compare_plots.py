"""The plots of a comparison: wrong verdicts, agreement against clearance, deviation against clearance, paths, times."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from tdcr_planner.compare.comparison import Comparison
from tdcr_planner.compare.confusion import EXCESS_EDGES, agreement_by_clearance
from tdcr_planner.compare.paths import path_rates
from tdcr_planner.compare.verdicts import Variant
from tdcr_planner.rates import Rate
from tdcr_planner.report import plots
from tdcr_planner.report.drawing import Drawing
from tdcr_planner.shape.registry import SHAPE_MODELS

_DPI = 120
_SHOWN_DOTS = 20_000
_DODGE = 0.22


def _label(variant: Variant) -> str:
    kind = SHAPE_MODELS.find(variant.model)
    margin = ", with its error bound" if variant.with_bound else ", without the bound"
    return kind.label() + (", as planned" if variant.with_half_step else margin if kind.has_error_bound else "")


def _colour(variant: Variant) -> str:
    return SHAPE_MODELS.find(variant.model).colour if variant.with_bound else plots.PALETTE["sky"]


def compare_drawings(comparison: Comparison) -> dict[str, Drawing]:
    """Returns what draws each plot of a comparison, as PNG and PDF; paths only where some were planned."""
    figures = {"rates": draw_rates, "agreement": draw_agreement, "deviation": draw_deviation, "times": draw_times}
    if comparison.paths:
        figures["paths"] = draw_paths
    return plots.figure_drawings({name: partial(draw, comparison) for name, draw in figures.items()})


def draw_rates(comparison: Comparison) -> Figure:
    """Returns a figure of the shares of false-valid and false-invalid states, with 95 % intervals, on a log scale."""
    figure = plots.new_figure(1300, 420, _DPI)
    left, right = figure.subplots(1, 2, sharey=True)
    variants = comparison.verdicts.variants
    for axes, kind, title in (
        (left, "false_valid", "False valid: a collision that the model misses"),
        (right, "false_invalid", "False invalid: room that caution costs"),
    ):
        rates = [comparison.confusion(variant).rates[kind] for variant in variants]
        _draw_rates(axes, variants, rates)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(_plain_number))
        axes.set_xlim(0.3 * 100.0 / len(comparison.verdicts.rows), 100.0)
        axes.set_title(title)
        axes.set_xlabel(f"of {len(comparison.verdicts.rows):,} states (%), line: 95 % interval")
    left.set_yticks(range(len(variants)), [_label(variant) for variant in variants])
    left.invert_yaxis()
    figure.tight_layout()
    return figure


def _draw_rates(axes: Axes, variants: Sequence[Variant], rates: list[Rate]) -> None:
    floor = 1e-9
    for place, (variant, rate) in enumerate(zip(variants, rates, strict=True)):
        colour = _colour(variant)
        line = np.maximum([100.0 * rate.low, 100.0 * rate.high], floor)
        axes.plot(line, [place, place], color=colour, linewidth=2.5)
        if rate.count:
            axes.plot(100.0 * rate.value, place, "o", color=colour, markersize=8)
        text = f"{rate.count}" if rate.count else "none"
        axes.annotate(text, (line[1], place), xytext=(8, 0), textcoords="offset points", va="center", fontsize=9.0)


def draw_agreement(comparison: Comparison) -> Figure:
    """Returns a figure of the share of states on which model and reference agree, by clearance."""
    figure = plots.new_figure(1200, 620, _DPI)
    axes = figure.subplots()
    verdicts, counts = comparison.verdicts, np.zeros(len(EXCESS_EDGES) - 1, dtype=np.int64)
    shown = [variant for variant in verdicts.variants if not variant.with_half_step]
    for number, variant in enumerate(shown):
        bins = agreement_by_clearance(
            verdicts.valid(variant),
            verdicts.reference_valid,
            verdicts.clearance,
            comparison.scenario.planner.clearance_m,
        )
        place = np.array([int(np.searchsorted(EXCESS_EDGES, part.low)) for part in bins])
        counts[place] = [part.agreement.total for part in bins]
        share, low, high = (
            100.0 * np.array([getattr(part.agreement, end) for part in bins]) for end in ("value", "low", "high")
        )
        axes.errorbar(
            place + (number - 0.5 * (len(shown) - 1)) * _DODGE,
            share,
            yerr=(share - low, high - share),
            fmt=SHAPE_MODELS.find(variant.model).marker if variant.with_bound else "s",
            color=_colour(variant),
            markersize=5.5,
            elinewidth=1.4,
            label=_label(variant),
        )
    labels = [
        f"{_bin_label(*ends)}\n{count:,}" for ends, count in zip(itertools.pairwise(EXCESS_EDGES), counts, strict=True)
    ]
    axes.set_xticks(range(len(labels)), labels)
    for edge in range(1, len(labels)):
        axes.axvline(edge - 0.5, color=plots.GRID, linewidth=0.8)
    axes.axvline(float(np.searchsorted(EXCESS_EDGES, 0.0)) - 0.5, color=plots.ALERT, linewidth=1.4, linestyle="--")
    axes.set_xlim(-0.5, len(labels) - 0.5)
    axes.set_ylim(-2.0, 103.0)
    axes.set_xlabel(
        "clearance under the reference, from the clearance asked (mm), and states in the bin\n"
        "left of the dashed line: invalid by clearance"
    )
    axes.set_ylabel("agreement with the reference (%)")
    axes.set_title("Agreement against clearance, line: 95 % interval")
    axes.grid(visible=False, axis="x")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.26), ncols=len(shown))
    figure.tight_layout()
    return figure


def _bin_label(low: float, high: float) -> str:
    low_mm, high_mm = (_plain_number(1e3 * end) for end in (low, high))
    if np.isinf(low):
        return f"below\n{high_mm}"
    if np.isinf(high):
        return f"above\n{low_mm}"
    return f"{low_mm} to\n{high_mm}"


def _plain_number(value: float, _position: int | None = None) -> str:
    """Returns a number as people write it, with a true minus: a formatter of ticks, too."""
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")


def draw_deviation(comparison: Comparison) -> Figure:
    """Returns a figure of each state's deviation against its clearance, wrong verdicts marked, with their medians."""
    verdicts, asked = comparison.verdicts, comparison.scenario.planner.clearance_m
    figure = plots.new_figure(1300, 660, _DPI)
    shown = np.zeros(len(verdicts.rows), dtype=np.bool_)
    shown[:_SHOWN_DOTS] = True
    all_axes = figure.subplots(1, len(verdicts.models), sharex=True, sharey=True, squeeze=False)[0]
    for axes, name in zip(all_axes, verdicts.models, strict=True):
        variant = next(variant for variant in verdicts.variants if variant.name == name)
        valid, truth = verdicts.valid(variant), verdicts.reference_valid
        deviation = 1e3 * verdicts.deviation_of(name)
        x, y = 1e3 * (verdicts.clearance - asked), np.maximum(deviation, 1e-4)
        for which, sample, colour, size, label in (
            (valid == truth, shown, plots.MUTED, 2.0, "right"),
            (~valid & truth, True, plots.PALETTE["orange"], 7.0, "false invalid"),
            (valid & ~truth, True, plots.ALERT, 8.0, "false valid"),
        ):
            known = deviation[which & np.isfinite(deviation)]
            median = f", median {np.median(known):.2g} mm" if len(known) else ""
            axes.scatter(
                x[which & sample], y[which & sample], s=size, color=colour, linewidths=0.0, rasterized=True,
                label=f"{label}: {int(which.sum()):,}{median}",
            )  # fmt: skip
        axes.axvline(0.0, color=plots.INK, linewidth=0.8)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(_plain_number))
        axes.set_title(_label(variant))
        axes.set_xlabel("clearance under the reference, from the clearance asked (mm)")
        legend = axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.12), handletextpad=0.1)
        for dots in legend.legend_handles:
            dots.set_sizes([24.0])
    known = verdicts.clearance[np.isfinite(verdicts.clearance)]
    if len(known):
        low, high = 1e3 * (np.quantile(known, [0.005, 0.995]) - asked)
        all_axes[0].set_xlim(min(low, -1.0), max(high, 1.0))
    all_axes[0].set_ylabel("largest distance of a disk from the reference\n(mm; less than 0.0001 is drawn there)")
    figure.tight_layout()
    return figure


def draw_times(comparison: Comparison) -> Figure:
    """Returns a figure of the time a verdict takes, shape and whole check, and of the ratio to the reference's."""
    figure = plots.new_figure(900, 360, _DPI)
    axes = figure.subplots()
    slowest = max(item.check_us for item in comparison.times)
    for place, item in enumerate(comparison.times):
        colour = SHAPE_MODELS.find(item.model).colour
        axes.barh(place, item.check_us, 0.6, color=colour, alpha=0.35)
        axes.barh(place, min(item.shape_us, item.check_us), 0.6, color=colour)
        ratio = slowest / item.check_us
        axes.annotate(
            f"{item.check_us:.3g} µs, the shape alone {item.shape_us:.3g} µs"
            + (f"\n{ratio:.3g} times as fast as the slowest" if ratio > 1.0 else ""),
            (item.check_us, place),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=9.0,
        )
    axes.set_yticks(range(len(comparison.times)), [SHAPE_MODELS.find(item.model).label() for item in comparison.times])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.7 * slowest)
    axes.set_xlabel(f"µs a state, {comparison.times[0].batch:,} states a call; dark: the shape alone")
    axes.set_title("Time for a verdict")
    axes.grid(visible=False, axis="y")
    figure.tight_layout()
    return figure


def draw_paths(comparison: Comparison) -> Figure:
    """Returns a figure of how many planned paths the reference verifies, by the model that the search asked."""
    figure = plots.new_figure(900, 400, _DPI)
    axes = figure.subplots()
    kinds = (
        ("found", "path found, of all queries"),
        ("verified_at_once", "first path verified, of those found"),
        ("verified", "verified in the end, of all queries"),
    )
    models = comparison.verdicts.models
    height = 0.8 / len(models)
    for number, rates in enumerate(path_rates(comparison.paths, models)):
        offset, model = (number - 0.5 * (len(models) - 1)) * height, SHAPE_MODELS.find(rates.model)
        for place, (name, _) in enumerate(kinds):
            rate: Rate = getattr(rates, name)
            label = model.label() if place == 0 else None
            value, colour = 100.0 * rate.value if rate.total else 0.0, model.colour
            axes.barh(place + offset, 100.0, 0.85 * height, color=plots.GRID, alpha=0.5)
            axes.barh(place + offset, value, 0.85 * height, color=colour, alpha=0.45, label=label)
            axes.plot([100.0 * rate.low, 100.0 * rate.high], [place + offset] * 2, color=colour, linewidth=2.5)
            text = f"{rate.count} of {rate.total}" if rate.total else "none found"
            axes.annotate(
                text, (100.0, place + offset), xytext=(6, 0), textcoords="offset points", va="center", fontsize=9.0
            )
    axes.set_yticks(range(len(kinds)), [text for _, text in kinds])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 112.0)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("%, line: 95 % interval")
    axes.set_title("Planned paths under the reference")
    axes.grid(visible=False, axis="y")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    figure.tight_layout()
    return figure
