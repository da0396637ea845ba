"""The look of every figure: colours that colour-blind readers tell apart, fonts, axes, and how figures are saved."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, NullFormatter

from tdcr_planner.arrays import FloatArray
from tdcr_planner.report.drawing import Drawing
from tdcr_planner.report.tendon_style import limit_labels, matplotlib_dash, tendon_colour, tension_limits
from tdcr_planner.report.text import FONT_FAMILY, shorten
from tdcr_planner.robot import RobotSpec

# Okabe and Ito 2008, without its yellow, which is lost on white.
PALETTE = {
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "green": "#009E73",
    "purple": "#CC79A7",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "black": "#000000",
}
INK = "#1F2933"
MUTED = "#6B7785"
GRID = "#E4E8ED"
ROBOT = "#2176B5"
SLEEVE = "#8FC1E3"
SHAFT = "#8A929C"
LEARNED = "#CC79A7"
TRACE = "#D55E00"
START = "#6B7785"
GOAL = "#009E73"
ALERT = "#C1272D"
STATUS_COLOURS = {
    "verified": "#00815E",
    "unverified": "#B35900",
    "no_path": "#5B6573",
    "invalid_start": "#C1272D",
    "invalid_goal": "#C1272D",
}
_LEGEND_FONTS = (9.0, 8.0, 7.0, 6.0, 5.0)
# Labels of limits nearer to each other than this part of the axis stand side by side.
_LABEL_ROOM = 0.07
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": [FONT_FAMILY],
    # Titles and names come from files: a dollar sign is a dollar sign, whatever the user's own settings are.
    "text.parse_math": False,
    "text.usetex": False,
    "font.size": 10.0,
    "axes.edgecolor": "#AEB8C4",
    "axes.labelcolor": INK,
    "axes.labelsize": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "svg.fonttype": "none",
    "svg.hashsalt": "tdcr",
    "pdf.fonttype": 42,
}


@contextmanager
def plot_style() -> Iterator[None]:
    """Sets fonts, colours and grid for figures made inside the block; matplotlib's own settings come back after it."""
    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(width_px: int, height_px: int, dpi: int = 100) -> Figure:
    """Returns an empty figure that draws without a display and is known to no global state."""
    figure = Figure(figsize=(width_px / dpi, height_px / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Writes a figure as PNG, SVG or PDF by the path's ending; the same figure gives the same bytes."""
    suffix = Path(path).suffix.lower()
    undated: dict[str, dict[str, str | None]] = {
        ".png": {"Software": None},
        ".svg": {"Date": None},
        ".pdf": {"CreationDate": None},
    }
    use_plain_log_ticks(figure)
    figure.savefig(path, metadata=undated.get(suffix), facecolor="white")


def figure_drawings(figures: Mapping[str, Callable[[], Figure]]) -> dict[str, Drawing]:
    """Returns what draws each figure as PNG and as PDF, by file name."""

    def draw(make: Callable[[], Figure], file: Path) -> None:
        with plot_style():
            save_figure(make(), file)

    return {f"{name}{ending}": partial(draw, make) for name, make in figures.items() for ending in (".png", ".pdf")}


def fit_text(text: Text, width_px: float) -> None:
    """Takes the middle out of a text of a figure until it is no wider than so many pixels."""
    whole = text.get_text()
    low, high = 1, len(whole)
    if _width(text) <= width_px:
        return
    while low < high:  # the longest that fits, by halving
        middle = (low + high + 1) // 2
        text.set_text(shorten(whole, middle))
        low, high = (middle, high) if _width(text) <= width_px else (low, middle - 1)
    text.set_text(shorten(whole, low))


def _width(text: Text) -> float:
    return float(text.get_window_extent().width)


def use_plain_log_ticks(figure: Figure) -> None:
    """Gives logarithmic axes plain numbers where they have matplotlib's own labels, which are formulas."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), LogFormatterMathtext):
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}")))
            if isinstance(axis.get_minor_formatter(), LogFormatterMathtext):
                axis.set_minor_formatter(NullFormatter())


def draw_clearance(axes: Axes, times: FloatArray, clearance: FloatArray, required: float) -> None:
    """Draws clearance in mm against time with the required line, what falls below it, and the worst state.

    Args:
        axes: Where to draw.
        times: Shape (k,), s.
        clearance: Shape (k,), m; NaN where it is not known.
        required: Clearance to keep, m.
    """
    millimetres = 1e3 * clearance
    limit = 1e3 * required
    known = np.isfinite(millimetres)
    axes.plot(times, millimetres, color=PALETTE["blue"], label="reference", zorder=3)
    axes.axhline(limit, color=ALERT, linewidth=1.2, linestyle=(0, (5, 3)), label=f"required {limit:g} mm", zorder=2)
    if known.any():
        axes.fill_between(times, limit, millimetres, where=known & (millimetres < limit), color=ALERT, alpha=0.18)
        worst = int(np.nanargmin(millimetres))
        axes.plot(
            times[worst],
            millimetres[worst],
            marker="o",
            markersize=8,
            markerfacecolor="white",
            markeredgecolor=ALERT,
            markeredgewidth=2.0,
            linestyle="none",
            label=f"worst {millimetres[worst]:.2f} mm",
            zorder=4,
            clip_on=False,
        )
        low, high = min(0.0, millimetres[worst]), max(limit, float(np.nanmax(millimetres)))
        pad = 0.08 * max(high - low, 1e-3)
        axes.set_ylim(low - (pad if low < 0.0 else 0.0), high + pad)
    axes.set_title("Clearance", pad=26.0)
    axes.set_ylabel("mm")
    _legend_above(axes)


def draw_tensions(axes: Axes, times: FloatArray, tensions: FloatArray, robot: RobotSpec) -> None:
    """Draws each tendon's tension against time, every limit, and a legend with a row a segment above.

    Args:
        axes: Where to draw; its upper part goes to the legend, as much as that needs.
        times: Shape (k,), s.
        tensions: Shape (k, t), N.
        robot: The robot, for its segments and limits.
    """
    for index in range(tensions.shape[1]):
        style = matplotlib_dash(int(robot.tendon_segments[index]))
        axes.plot(times, tensions[:, index], color=tendon_colour(index), linestyle=style)
    limits = tension_limits(robot)
    top = 1.1 * max(limits[-1].newton, float(tensions.max(initial=0.0)))
    for limit in limits:
        axes.axhline(limit.newton, color=MUTED, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1)
    for height, label in limit_labels(robot, _LABEL_ROOM * top):
        axes.annotate(
            label,
            (1.0, height),
            xycoords=("axes fraction", "data"),
            xytext=(-2, 2),
            textcoords="offset points",
            ha="right",
            va="bottom",
            color=MUTED,
            fontsize=7.5,
            bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.7},
            zorder=5,
        )
    axes.set_ylim(0.0, top)
    axes.set_ylabel("N")
    axes.set_xlabel("time (s)")
    _legend_of_tendons(axes, robot)


def _legend_of_tendons(axes: Axes, robot: RobotSpec) -> None:
    """Puts a legend above the plot, in the largest font that fits, and lowers the top of the plot by its height."""
    figure = axes.get_figure(root=True)
    assert figure is not None  # axes are made by a figure
    box = axes.get_position()
    room, tallest = axes.bbox.width, 0.45 * axes.bbox.height
    for size, beside in itertools.product(_LEGEND_FONTS, range(min(robot.segment_count, 6), 0, -1)):
        legend = _tendon_legend(axes, robot, size, beside)
        extent = legend.get_window_extent()
        if extent.width <= room and extent.height <= tallest:
            break
    lost = extent.height / figure.bbox.height
    axes.set_position((box.x0, box.y0, box.width, box.height - lost))
    axes.set_title("Tendon tensions", pad=72.0 * extent.height / figure.dpi + 6.0)


def _tendon_legend(axes: Axes, robot: RobotSpec, size: float, beside: int) -> Legend:
    """Makes the legend in a font size: so many segments in a row, each after its name."""
    cells: list[list[Line2D]] = []
    for segment in range(robot.segment_count):
        tendons = np.flatnonzero(robot.tendon_segments == segment).tolist()
        head = Line2D([], [], linestyle="none", label=f"segment {segment + 1}")
        style = matplotlib_dash(segment)
        lines = [Line2D([], [], color=tendon_colour(i), linestyle=style, label=f"{i + 1}") for i in tendons]
        cells.append([head, *lines])
    widest = max(len(row) for row in cells)
    blank = Line2D([], [], linestyle="none", label=" ")
    rows = [
        [line for row in cells[start : start + beside] for line in [*row, *[blank] * (widest - len(row))]]
        for start in range(0, len(cells), beside)
    ]
    columns = len(rows[0])
    rows[-1] += [blank] * (columns - len(rows[-1]))
    # matplotlib fills a legend column by column
    handles = [rows[row][column] for column in range(columns) for row in range(len(rows))]
    return axes.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(-0.02, 1.0),
        ncols=columns,
        fontsize=size,
        columnspacing=0.8,
        handlelength=3.0,
        handletextpad=0.4,
        labelspacing=0.25,
        borderaxespad=0.0,
    )


def _legend_above(axes: Axes) -> None:
    """Puts the legend in one row between title and plot, where no curve can run through it."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(-0.02, 0.985),
        ncols=6,
        columnspacing=1.1,
        handlelength=1.5,
        handletextpad=0.5,
        borderaxespad=0.0,
    )
