"""Several models side by side: one table, and one plot of error against time."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tdcr_planner.files import write_folder_whole
from tdcr_planner.report.plots import PALETTE, new_figure, plot_style, save_figure
from tdcr_planner.report.tables import format_markdown
from tdcr_planner.report.text import figure_text, markdown_text

if TYPE_CHECKING:
    from tdcr_planner.compare.side_by_side import SideBySide
    from tdcr_planner.rates import Rate

PLOT = "error_against_time.png"
_SMALLEST_MM = 1e-6  # drawn; the reference's own error is none


def describe_models(found: SideBySide) -> str:
    """Returns the table of several models as Markdown."""
    header = [
        "model", "error median mm", "99 % mm", "margin mm", "us a shape", "us a verdict", "false valid",
        "false invalid", "verified", "plan s",
    ]  # fmt: skip
    rows = [
        [
            markdown_text(row.name),
            *(f"{1e3 * value:.3g}" for value in (*row.error_m, row.margin_m)),
            f"{row.shape_us:.3g}",
            f"{row.check_us:.3g}",
            _percent(row.false_valid),
            _percent(row.false_invalid),
            f"{row.verified.count} of {row.verified.total}",
            "-" if row.plan_s is None else f"{row.plan_s:.2g}",
        ]
        for row in found.rows
    ]
    return format_markdown(header, rows)


def write_models(found: SideBySide, out: Path) -> None:
    """Writes `compare.json` and `compare.md` into a folder, all or nothing."""
    content = {
        "format": "tdcr-models/1",
        "scenario": str(found.scenario.path),
        "scenario_sha256": found.scenario.sha256,
        "states": found.states,
        "models": [
            {
                "name": row.name,
                "file": None if row.file is None else str(row.file),
                "error_median_m": row.error_m[0],
                "error_p99_m": row.error_m[1],
                "margin_m": row.margin_m,
                "shape_us": row.shape_us,
                "check_us": row.check_us,
                "false_valid": row.false_valid.as_dict(),
                "false_invalid": row.false_invalid.as_dict(),
                "verified": row.verified.as_dict(),
                "plan_s": row.plan_s,
            }
            for row in found.rows
        ],
    }
    with write_folder_whole(out, last="compare.json") as staging:
        (staging / "compare.md").write_text(describe_models(found), encoding="utf-8")
        (staging / "compare.json").write_text(json.dumps(content, indent=1), encoding="utf-8")


def draw_error_against_time(points: Sequence[tuple[str, float, float, float]], path: Path) -> None:
    """Draws models by time and error.

    Args:
        points: Name, microseconds a shape, median and 99th percentile of the error in mm, a row a model.
        path: The picture.
    """
    with plot_style():
        figure = new_figure(760, 520)
        figure.set_layout_engine("constrained")
        axes = figure.subplots()
        colours = [colour for name, colour in PALETTE.items() if name != "black"]
        for number, (name, micro, median, high) in enumerate(points):
            low, top = max(median, _SMALLEST_MM), max(high, _SMALLEST_MM)
            colour = colours[number % len(colours)]
            axes.loglog([micro, micro], [low, top], "-", color=colour, lw=1.5)
            axes.loglog([micro], [low], "o", color=colour, label=figure_text(name, 40))
            axes.loglog([micro], [top], "_", color=colour, ms=12)
        axes.set_xlabel("time a shape, us")
        axes.set_ylabel("error, mm: median (dot) to 99 % (bar)")
        axes.legend(fontsize="small")
        save_figure(figure, path)


def _percent(rate: Rate) -> str:
    return "-" if not rate.total else f"{100.0 * rate.value:.3g} %"
