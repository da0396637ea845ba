"""The look of every figure: colours that colour-blind readers tell apart, fonts, axes, and how figures are saved."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tdcr_planner.arrays import FloatArray, IntArray

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
_TENDON_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#AA4499", "#E69F00", "#56B4E9", "#332288", "#882255")
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
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
    figure.savefig(path, metadata=undated.get(suffix), facecolor="white")


def tendon_colour(index: int) -> str:
    """Returns the colour of a tendon, the same in every figure; colours repeat after eight tendons."""
    return _TENDON_COLOURS[index % len(_TENDON_COLOURS)]


def tendon_dash(segment: int) -> str:
    """Returns matplotlib's line style for the tendons of a segment, so that segments differ without colour too."""
    return ("-", "--", "-.", ":")[segment % 4]


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
        )
        low, high = min(0.0, millimetres[worst]), max(limit, float(np.nanmax(millimetres)))
        pad = 0.08 * max(high - low, 1e-3)
        axes.set_ylim(low - (pad if low < 0.0 else 0.0), high + pad)
    axes.set_title("Clearance", pad=26.0)
    axes.set_ylabel("mm")
    _legend_above(axes)


def draw_tensions(axes: Axes, times: FloatArray, tensions: FloatArray, segments: IntArray, limit: float) -> None:
    """Draws each tendon's tension against time.

    Args:
        axes: Where to draw.
        times: Shape (k,), s.
        tensions: Shape (k, t), N.
        segments: Segment at whose end each tendon ends, shape (t,).
        limit: Largest tension of any tendon, N; drawn where the tensions come near it.
    """
    for index in range(tensions.shape[1]):
        segment = int(segments[index])
        axes.plot(
            times,
            tensions[:, index],
            color=tendon_colour(index),
            linestyle=tendon_dash(segment),
            label=f"{index + 1}",
        )
    top = float(tensions.max()) if tensions.size else limit
    if top > 0.6 * limit:
        axes.axhline(limit, color=MUTED, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1)
        axes.annotate(
            "limit",
            (1.0, limit),
            xycoords=("axes fraction", "data"),
            xytext=(-2, 2),
            textcoords="offset points",
            ha="right",
            va="bottom",
            color=MUTED,
            fontsize=8.0,
        )
        top = limit
    axes.set_ylim(0.0, 1.08 * max(top, 1e-3))
    axes.set_title("Tendon tensions", pad=26.0)
    axes.set_ylabel("N")
    axes.set_xlabel("time (s)")
    _legend_above(axes)


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
