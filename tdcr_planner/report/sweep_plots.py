"""The plots of a sweep: success rates with intervals, share verified against time, and spreads of time and length."""

from __future__ import annotations

import posixpath
from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from tdcr_planner.report import plots
from tdcr_planner.report.drawing import Drawing
from tdcr_planner.report.tables import Row
from tdcr_planner.report.text import figure_text
from tdcr_planner.sweep.suite import Suite
from tdcr_planner.sweep.table import group_rows

_COLOURS = tuple(plots.PALETTE[name] for name in ("blue", "vermilion", "green", "purple", "orange", "sky"))
_DASHES = ("-", "--", "-.", ":")
_DPI = 120
_NAME_LETTERS, _TITLE_LETTERS = 36, 60
_BAR_PX, _TITLE_PX, _FOOT_PX = 15, 50, 110


def sweep_drawings(suite: Suite, rows: Sequence[Row]) -> dict[str, Drawing]:
    """Returns what draws success, time and length plots, as PNG and PDF.

    Args:
        suite: The suite.
        rows: From `table.joined_rows`; nothing is drawn of none.
    """
    if not rows:
        return {}
    figures = {"success": draw_success, "times": draw_times, "spread": draw_spread}
    return plots.figure_drawings({name: partial(draw, suite, rows) for name, draw in figures.items()})


def draw_success(suite: Suite, rows: Sequence[Row]) -> Figure:
    """Returns a figure of the share of verified queries by difficulty and by scenario, with 95 % intervals."""
    names = [entry.file for entry in suite.file.scenarios if any(row["scenario"] == entry.file for row in rows)]
    levels = [level for level in suite.difficulties if any(row["difficulty"] == level for row in rows)]
    bars = max(len(_variants(rows)), 2)
    heights = [len(group) * bars * _BAR_PX for group in (levels, names)]
    figure = plots.new_figure(1000, sum(heights) + 2 * _TITLE_PX + _FOOT_PX, _DPI)
    upper, lower = figure.subplots(2, 1, height_ratios=heights, sharex=True)
    _draw_rates(upper, rows, "difficulty", levels, [figure_text(level, _NAME_LETTERS) for level in levels])
    _draw_rates(lower, rows, "scenario", names, _short_names(names))
    upper.set_title("Verified paths by difficulty")
    lower.set_title("By scenario")
    lower.set_xlabel("verified (%), line: 95 % interval")
    handles, labels = upper.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3)
    legend_rows = -(-len(labels) // 3)
    figure.tight_layout(rect=(0.0, 22.0 * legend_rows * _DPI / 100.0 / figure.bbox.height, 1.0, 1.0))
    return figure


def _draw_rates(axes: Axes, rows: Sequence[Row], column: str, names: Sequence[str], shown_names: Sequence[str]) -> None:
    variants = _variants(rows)
    groups = {(group[column], *_variant(group)): group for group in group_rows(rows, (column, "planner", "model"))}
    thickness = 0.8 / len(variants)
    for place, variant in enumerate(variants):
        colour, label = _COLOURS[place % len(_COLOURS)], _label(variant)
        for position, name in enumerate(names):
            if (name, *variant) not in groups:
                continue
            rate = groups[(name, *variant)]["verified"]
            y = position + (place - 0.5 * (len(variants) - 1)) * thickness
            axes.barh(y, 100.0, 0.85 * thickness, color=plots.GRID, alpha=0.5)
            axes.barh(y, 100.0 * rate["value"], 0.85 * thickness, color=colour, alpha=0.45, label=label)
            axes.plot([100.0 * rate["low"], 100.0 * rate["high"]], [y, y], color=colour, linewidth=2.0)
            axes.annotate(
                f"{rate['count']} of {rate['total']}",
                (100.0, y),
                xytext=(6, 0),
                textcoords="offset points",
                va="center",
                fontsize=8.0,
            )
            label = "_"  # a second entry in the legend is none
    axes.set_yticks(range(len(names)), shown_names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(0.0, 110.0)
    axes.set_xticks(range(0, 101, 20))
    axes.grid(visible=False, axis="y")


def _short_names(names: Sequence[str]) -> list[str]:
    """Returns file names without their ending and the folder that all of them share."""
    folders = [posixpath.dirname(name) for name in names]
    mixed = len({folder.startswith("/") for folder in folders}) > 1
    shared = "" if mixed else posixpath.commonpath(folders)
    return [figure_text(name.removeprefix(shared).lstrip("/").removesuffix(".toml"), _NAME_LETTERS) for name in names]


def draw_times(suite: Suite, rows: Sequence[Row]) -> Figure:
    """Returns a figure of the share of queries whose path was found and verified within a time."""
    figure = plots.new_figure(1000, 560, _DPI)
    axes = figure.subplots()
    longest = max(job.time_limit_s for job in suite.jobs)
    shortest = longest
    for place, variant in enumerate(_variants(rows)):
        own = [row for row in rows if _variant(row) == variant]
        times = np.sort([row["total_s"] for row in own if row["status"] == "verified" and row["total_s"] is not None])
        share = 100.0 * np.arange(1, len(times) + 1) / len(own)
        if len(times):
            shortest = min(shortest, float(times[0]))
        axes.step(
            [*times, longest],
            [*share, share[-1] if len(share) else 0.0],
            where="post",
            color=_COLOURS[place % len(_COLOURS)],
            linestyle=_DASHES[place // len(_COLOURS) % len(_DASHES)],
            label=f"{_label(variant)}: {len(times)} of {len(own)}",
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlim(0.8 * max(shortest, 1e-3), longest)
    axes.set_ylim(0.0, 102.0)
    axes.set_xlabel("time for search, verification and repair (s)")
    axes.set_ylabel("queries with a verified path (%)")
    axes.set_title(f"{figure_text(suite.title, _TITLE_LETTERS)}: verified within a time")
    axes.legend(loc="lower right")
    figure.tight_layout()
    return figure


def draw_spread(suite: Suite, rows: Sequence[Row]) -> Figure:
    """Returns a figure of planning time and tip travel of verified paths: median, quartiles and 10 to 90 %."""
    variants = _variants(rows)
    figure = plots.new_figure(1000, 200 + 60 * len(variants), _DPI)
    for axes, column, factor, label in zip(
        figure.subplots(1, 2, sharey=True),
        ("plan_s", "tip_travel_m"),
        (1.0, 1e3),
        ("planning time (s)", "tip travel (mm)"),
        strict=True,
    ):
        for place, variant in enumerate(variants):
            own = [row[column] for row in rows if _variant(row) == variant and row["status"] == "verified"]
            values = factor * np.array([value for value in own if value is not None], dtype=np.float64)
            if not len(values):
                continue
            colour = _COLOURS[place % len(_COLOURS)]
            low, first, middle, third, high = np.quantile(values, (0.1, 0.25, 0.5, 0.75, 0.9))
            axes.plot([low, high], [place, place], color=colour, linewidth=1.5)
            axes.plot([first, third], [place, place], color=colour, linewidth=9.0, alpha=0.45, solid_capstyle="butt")
            axes.plot(middle, place, "o", color=colour)
        axes.set_xlabel(f"{label}\nmedian, 25 to 75 %, 10 to 90 %")
        axes.set_yticks(range(len(variants)), [_label(variant) for variant in variants])
        axes.set_ylim(len(variants) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")
    figure.axes[0].set_title(f"{figure_text(suite.title, _TITLE_LETTERS)}: verified paths")
    figure.tight_layout()
    return figure


def _variant(row: Row) -> tuple[str, str]:
    return row["planner"], row["model"]


def _variants(rows: Sequence[Row]) -> list[tuple[str, str]]:
    return list(dict.fromkeys(_variant(row) for row in rows))


def _label(variant: tuple[str, str]) -> str:
    return figure_text(f"{variant[0]}, {variant[1].replace('_', ' ')}", _NAME_LETTERS)
