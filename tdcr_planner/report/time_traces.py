"""Clearance and tensions against time as plotly.js traces, with the cursor that each frame moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdcr_planner.report import plots
from tdcr_planner.report.legend import tendon_entry
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.tendon_style import css_dash, describe_limits, limit_labels, tendon_colour, tension_limits

Trace = dict[str, Any]
_CURVE_PX = 2.0
_LEFT = 0.7


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
    """Returns the axes and captions of the plots."""
    shared = {"gridcolor": plots.GRID, "linecolor": "#AEB8C4", "zeroline": False, "ticks": "outside", "ticklen": 4}
    end = max(float(picture.times[-1]), 1e-6)
    side = {"range": [0.0, end], **shared}
    wide = arrangements(_LEFT)["wide"]
    note = f"required {1e3 * picture.required_clearance:g} mm"
    worst = picture.worst_state
    if worst is not None and np.isfinite(picture.clearance[worst]):
        name = "fails with" if picture.failure else "worst"
        note = f"<b>{name} {1e3 * picture.clearance[worst]:.2f} mm</b> at {picture.times[worst]:.1f} s, {note}"
    return {
        "xaxis": {**side, "anchor": "y", "domain": wide["xaxis.domain"], "matches": "x2", "showticklabels": False},
        "yaxis": {
            **shared,
            "domain": wide["yaxis.domain"],
            "range": list(_clearance_range(picture)),
            "title": {"text": "mm", "standoff": 6},
        },
        "xaxis2": {
            **side,
            "anchor": "y2",
            "domain": wide["xaxis2.domain"],
            "title": {"text": "time (s)", "standoff": 4},
        },
        "yaxis2": {
            **shared,
            "domain": wide["yaxis2.domain"],
            "anchor": "x2",
            "range": [0.0, _tension_top(picture)],
            "title": {"text": "N", "standoff": 6},
        },
        "annotations": [
            _caption("<b>Clearance</b>", "", 20, plots.INK, 14),
            _caption(note, "", 3, plots.ALERT, 11),
            _caption("<b>Tendon tensions</b>", "2", 5, plots.INK, 14),
            *_limit_labels(picture),
        ],
    }


def arrangements(scene_width: float) -> dict[str, dict[str, Any]]:
    """Returns the domains of scene and plots as plotly.js's relayout takes them, for a wide and for a narrow window.

    Args:
        scene_width: Part of a wide window that the scene takes, 0 to 1.
    """
    return {
        "wide": {
            "scene.domain": {"x": [0.0, min(scene_width, _LEFT - 0.07)], "y": [0.0, 1.0]},
            "xaxis.domain": [_LEFT, 1.0],
            "yaxis.domain": [0.58, 0.91],
            "xaxis2.domain": [_LEFT, 1.0],
            "yaxis2.domain": [0.11, 0.45],
            "xaxis.showticklabels": False,
        },
        "narrow": {
            "scene.domain": {"x": [0.0, 1.0], "y": [0.47, 1.0]},
            "xaxis.domain": [0.08, 0.45],
            "yaxis.domain": [0.11, 0.35],
            "xaxis2.domain": [0.58, 1.0],
            "yaxis2.domain": [0.11, 0.35],
            "xaxis.showticklabels": True,
        },
    }


def _caption(text: str, axis: str, above_px: int, colour: str, size: int) -> dict[str, Any]:
    """A line of text above a plot, at its left end."""
    place = {"xref": f"x{axis} domain", "yref": f"y{axis} domain", "x": 0.0, "y": 1.0, "yshift": above_px}
    font = {"size": size, "color": colour}
    return {
        "text": text,
        "showarrow": False,
        "xanchor": "left",
        "yanchor": "bottom",
        "align": "left",
        "font": font,
        **place,
    }


def _limit_labels(picture: Picture) -> list[dict[str, Any]]:
    """Labels of the limits at the right end of their lines; those that are near each other share one."""
    place = {"xref": "x2 domain", "yref": "y2", "x": 1.0, "xanchor": "right", "yanchor": "bottom"}
    look = {"showarrow": False, "font": {"size": 10, "color": plots.MUTED}, "borderpad": 0}
    labels = limit_labels(picture.robot, 0.1 * _tension_top(picture))
    return [{"text": label, "y": value, **place, **look} for value, label in labels]


def _clearance_range(picture: Picture) -> tuple[float, float]:
    """Range of the clearance axis, mm."""
    values = 1e3 * picture.clearance[np.isfinite(picture.clearance)]
    limit = 1e3 * picture.required_clearance
    low, high = min(0.0, float(values.min(initial=0.0))), max(limit, float(values.max(initial=0.1)))
    pad = 0.08 * (high - low)
    return low - (pad if low < 0.0 else 0.0), high + pad


def _tension_top(picture: Picture) -> float:
    """Upper end of the tension axis, N: above every limit, with room for its label."""
    return 1.12 * max(float(picture.robot.max_tensions.max()), float(picture.tensions.max(initial=0.0)))


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
    if worst is not None and np.isfinite(values[worst]):
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
    shared = {"type": "scatter", "mode": "lines", "showlegend": False, "xaxis": "x2", "yaxis": "y2"}
    limits: list[Trace] = [
        {
            **shared,
            "x": [float(picture.times[0]), float(picture.times[-1])],
            "y": [limit.newton, limit.newton],
            "line": {"color": plots.MUTED, "width": 1.2, "dash": "dash"},
            "hovertemplate": f"{describe_limits([limit], picture.robot)}<extra></extra>",
        }
        for limit in tension_limits(picture.robot)
    ]
    return limits + [
        {
            **shared,
            "x": picture.times,
            "y": picture.tensions[:, index],
            "line": {
                "color": tendon_colour(index),
                "width": _CURVE_PX,
                "dash": css_dash(int(picture.robot.tendon_segments[index]), _CURVE_PX) or "solid",
            },
            "name": f"tendon {index + 1}, tension",
            "meta": tendon_entry(picture, index),
            "hovertemplate": f"%{{x:.2f}} s: %{{y:.3f}} N<extra>tendon {index + 1}</extra>",
        }
        for index in range(picture.tensions.shape[1])
    ]
