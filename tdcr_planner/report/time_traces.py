"""Clearance and tensions against time as plotly.js traces, with the cursor that each frame moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdcr_planner.report import plots
from tdcr_planner.report.picture import Picture

Trace = dict[str, Any]
_LEFT = 0.7
_DASHES = ("solid", "dash", "dashdot", "dot")


def time_traces(picture: Picture) -> list[Trace]:
    """Returns the curves of clearance (mm, axes x, y) and tensions (N, axes x2, y2), the worst state marked."""
    return [*_clearance_traces(picture), *_tension_traces(picture)]


def cursor_traces(picture: Picture, state: int) -> list[Trace]:
    """Returns the cursor of a state: a line in each plot and a dot on the clearance curve."""
    time = float(picture.times[state])
    value = float(1e3 * picture.clearance[state])
    quiet = {"type": "scatter", "showlegend": False, "hoverinfo": "skip"}
    line = {**quiet, "x": [time, time], "mode": "lines", "line": {"color": plots.MUTED, "width": 1.5}}
    return [
        {**line, "y": list(_clearance_range(picture)), "xaxis": "x", "yaxis": "y"},
        {
            **quiet,
            "x": [time],
            "y": [value if np.isfinite(value) else None],
            "mode": "markers",
            "marker": {"color": plots.PALETTE["blue"], "size": 9, "line": {"color": "white", "width": 2}},
            "cliponaxis": False,
            "xaxis": "x",
            "yaxis": "y",
        },
        {**line, "y": [0.0, _tension_top(picture)], "xaxis": "x2", "yaxis": "y2"},
    ]


def time_layout(picture: Picture) -> dict[str, Any]:
    """Returns the axes, captions and legend of the plots."""
    shared = {"gridcolor": plots.GRID, "linecolor": "#AEB8C4", "zeroline": False, "ticks": "outside", "ticklen": 4}
    end = max(float(picture.times[-1]), 1e-6)
    side = {"domain": [_LEFT, 1.0], "range": [0.0, end], **shared}
    note = f"required {1e3 * picture.required_clearance:g} mm"
    worst = picture.worst_state
    if worst is not None:
        note = f"<b>worst {1e3 * picture.clearance[worst]:.2f} mm</b> at {picture.times[worst]:.1f} s, {note}"
    return {
        "xaxis": {**side, "anchor": "y", "matches": "x2", "showticklabels": False},
        "yaxis": {
            **shared,
            "domain": [0.56, 0.93],
            "range": list(_clearance_range(picture)),
            "title": {"text": "mm", "standoff": 6},
        },
        "xaxis2": {**side, "anchor": "y2", "title": {"text": "time (s)", "standoff": 4}},
        "yaxis2": {
            **shared,
            "domain": [0.13, 0.41],
            "anchor": "x2",
            "range": [0.0, _tension_top(picture)],
            "title": {"text": "N", "standoff": 6},
        },
        "legend2": {
            "x": _LEFT - 0.005,
            "y": 0.415,
            "xanchor": "left",
            "yanchor": "bottom",
            "orientation": "h",
            "entrywidth": 18,
            "font": {"size": 11},
            "bgcolor": "rgba(0,0,0,0)",
        },
        "annotations": [
            {**_caption("<b>Clearance</b>", _LEFT, "left", 0.94), "font": {"size": 14}},
            {**_caption(note, 1.0, "right", 0.94), "font": {"size": 12, "color": plots.ALERT}},
            {**_caption("<b>Tendon tensions</b>", _LEFT, "left", 0.465), "font": {"size": 14}},
        ],
    }


def _caption(text: str, x: float, anchor: str, y: float) -> dict[str, Any]:
    place = {"x": x, "y": y, "xref": "paper", "yref": "paper", "xanchor": anchor, "yanchor": "bottom"}
    return {"text": text, "showarrow": False, **place}


def _clearance_range(picture: Picture) -> tuple[float, float]:
    """Range of the clearance axis, mm."""
    values = 1e3 * picture.clearance[np.isfinite(picture.clearance)]
    limit = 1e3 * picture.required_clearance
    low, high = min(0.0, float(values.min(initial=0.0))), max(limit, float(values.max(initial=0.1)))
    pad = 0.08 * (high - low)
    return low - (pad if low < 0.0 else 0.0), high + pad


def _tension_top(picture: Picture) -> float:
    limit = float(picture.robot.max_tensions.max())
    top = float(picture.tensions.max(initial=0.0))
    return 1.05 * max(limit if top > 0.6 * limit else top, 1e-3)


def _clearance_traces(picture: Picture) -> list[Trace]:
    times, values = picture.times, 1e3 * picture.clearance
    limit = 1e3 * picture.required_clearance
    shared = {"type": "scatter", "xaxis": "x", "yaxis": "y", "showlegend": False}
    traces = [
        {
            **shared,
            "x": times,
            "y": values,
            "mode": "lines",
            "line": {"color": plots.PALETTE["blue"], "width": 2.5},
            "name": "clearance",
            "hovertemplate": "%{x:.2f} s: %{y:.3f} mm<extra>clearance</extra>",
        },
        {
            **shared,
            "x": [float(times[0]), float(times[-1])],
            "y": [limit, limit],
            "mode": "lines",
            "line": {"color": plots.ALERT, "width": 1.5, "dash": "dash"},
            "hovertemplate": f"required: {limit:g} mm<extra></extra>",
        },
    ]
    worst = picture.worst_state
    if worst is not None:
        traces.append(
            {
                **shared,
                "x": [float(times[worst])],
                "y": [float(values[worst])],
                "mode": "markers",
                "marker": {"symbol": "circle-open", "size": 13, "color": plots.ALERT, "line": {"width": 2.5}},
                "name": "worst state",
                "hovertemplate": f"worst state {worst}: %{{y:.3f}} mm<extra></extra>",
                "cliponaxis": False,
            }
        )
    return traces


def _tension_traces(picture: Picture) -> list[Trace]:
    limit = float(picture.robot.max_tensions.max())
    limits: list[Trace] = []
    if _tension_top(picture) > limit:
        limits.append(
            {
                "type": "scatter",
                "x": [float(picture.times[0]), float(picture.times[-1])],
                "y": [limit, limit],
                "mode": "lines",
                "line": {"color": plots.MUTED, "width": 1.5, "dash": "dash"},
                "showlegend": False,
                "hovertemplate": f"limit: {limit:g} N<extra></extra>",
                "xaxis": "x2",
                "yaxis": "y2",
            }
        )
    return limits + [
        {
            "type": "scatter",
            "x": picture.times,
            "y": picture.tensions[:, index],
            "mode": "lines",
            "line": {
                "color": plots.tendon_colour(index),
                "width": 2,
                "dash": _DASHES[int(picture.robot.tendon_segments[index]) % len(_DASHES)],
            },
            "name": f"{index + 1}",
            "legend": "legend2",
            "xaxis": "x2",
            "yaxis": "y2",
            "hovertemplate": f"%{{x:.2f}} s: %{{y:.3f}} N<extra>tendon {index + 1}</extra>",
        }
        for index in range(picture.tensions.shape[1])
    ]
