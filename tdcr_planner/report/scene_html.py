"""The moving picture: one self-contained HTML page with scene, robot, clearance and tensions that plays offline."""

from __future__ import annotations

import html
import itertools
import json
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import plotly.graph_objects as go

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.report import plots
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.robot_mesh import backbone_curve, disk_mesh, simplify_mesh, tendon_lines
from tdcr_planner.report.scene_png import summary_line
from tdcr_planner.report.viewpoint import choose_camera, up_direction

MAX_FRAMES = 64
MAX_WALL_FACES = 24_000
_MAX_RIM_CORNERS = 640
# plotly's parallel projection shows a height of about 2.5 of its scene units.
_SCENE_FILL = 2.3
_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"


def write_html(picture: Picture, file: str | Path) -> None:
    """Writes the moving picture of a result or a scenario as one HTML file that needs no network."""
    Path(file).write_text(render_html(picture), encoding="utf-8")


def render_html(picture: Picture) -> str:
    """Returns the page as text."""
    shown = frame_states(picture)
    figure = build_figure(picture, shown)
    plot = figure.to_html(
        full_html=False,
        include_plotlyjs=True,
        auto_play=False,
        div_id="plot",
        default_width="100%",
        default_height="100%",
        config={
            "displaylogo": False,
            "responsive": True,
            "scrollZoom": True,
            "modeBarButtonsToRemove": ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d", "autoScale2d", "hoverClosest3d"],
        },
    )
    template = Template(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=html.escape(picture.title),
        status=html.escape(picture.status.replace("_", " ")),
        status_colour=plots.STATUS_COLOURS.get(picture.status, plots.MUTED),
        summary=html.escape(summary_line(picture)),
        message=html.escape(picture.message),
        font=_FONT,
        ink=plots.INK,
        muted=plots.MUTED,
        accent=plots.ROBOT,
        alert=plots.ALERT,
        plot=plot,
        states=_script_json(_readouts(picture, shown)),
        controls="" if picture.has_path and len(shown) > 1 else "hidden",
    )


def frame_states(picture: Picture, most: int = MAX_FRAMES) -> IntArray:
    """Returns the states that become frames: evenly spread over the time; the first, last and worst are among them."""
    known = np.flatnonzero(picture.known)
    if len(known) <= most:
        return known
    times = picture.times[known]
    wanted = np.linspace(times[0], times[-1], most - 1)
    chosen = np.searchsorted(times, wanted - 1e-12).clip(0, len(known) - 1)
    worst = picture.worst_state
    extra = [worst] if worst is not None and picture.known[worst] else []
    return np.unique(np.concatenate([known[chosen], np.array(extra, dtype=np.int64)]))


def build_figure(picture: Picture, shown: IntArray) -> go.Figure:
    """Returns the plotly figure: fixed traces first, then those that each frame replaces.

    Args:
        picture: What is shown.
        shown: Indices of the states that become frames.
    """
    fixed = [*_wall_traces(picture), *_mark_traces(picture)]
    if picture.has_path:
        fixed += [*_clearance_traces(picture), *_tension_traces(picture)]
    first = int(shown[0]) if len(shown) else None
    moving = [] if first is None else _moving_traces(picture, first, named=True)
    figure = go.Figure(data=[*fixed, *moving])
    if picture.has_path:
        indices = list(range(len(fixed), len(fixed) + len(moving)))
        figure.frames = [
            go.Frame(data=_moving_traces(picture, int(state), named=False), traces=indices, name=str(number))
            for number, state in enumerate(shown)
        ]
    figure.update_layout(_layout(picture))
    return figure


def _wall_traces(picture: Picture) -> list[Any]:
    total = sum(len(mesh.faces) for mesh in picture.meshes)
    traces = []
    for mesh in picture.meshes:
        share = max(500, int(MAX_WALL_FACES * len(mesh.faces) / max(total, 1)))
        vertices, faces = simplify_mesh(mesh.vertices, mesh.faces, share)
        traces.append(
            go.Mesh3d(
                **_xyz(vertices),
                **dict(zip("ijk", faces.T.astype(np.int32), strict=True)),
                color=plots.WALL if mesh.role == "cavity" else plots.OBSTACLE,
                opacity=0.24 if mesh.role == "cavity" else 0.5,
                lighting={"ambient": 0.45, "diffuse": 0.75, "specular": 0.3, "roughness": 0.4, "fresnel": 0.4},
                lightposition={"x": -4e3, "y": 6e3, "z": 8e3},
                flatshading=False,
                hoverinfo="skip",
                name=f"{mesh.name} ({mesh.role})",
                showlegend=True,
            )
        )
    return traces


def _mark_traces(picture: Picture) -> list[Any]:
    traces = []
    tips = picture.positions[picture.known][:, -1]
    if picture.has_path and len(tips):
        traces.append(
            go.Scatter3d(
                **_xyz(tips),
                mode="lines",
                line={"color": plots.TRACE, "width": 5},
                name="tip trace",
                hoverinfo="skip",
            )
        )
    if len(tips):
        traces.append(_marker(tips[:1], "start", "circle-open", plots.INK, 7))
    for number, goal in enumerate(picture.goals):
        name = "goal" if len(picture.goals) == 1 else f"goal {number + 1}"
        traces.append(_marker(goal.position[None], name, "diamond-open", plots.GOAL, 8))
        if goal.direction is not None:
            reach = 0.15 * picture.robot.length
            ends = np.stack([goal.position, goal.position + reach * goal.direction])
            traces.append(
                go.Scatter3d(
                    **_xyz(ends),
                    mode="lines",
                    line={"color": plots.GOAL, "width": 4},
                    name="viewing direction",
                    showlegend=number == 0,
                    hoverinfo="skip",
                )
            )
    return traces


def _marker(point: FloatArray, name: str, symbol: str, colour: str, size: int) -> Any:
    return go.Scatter3d(
        **_xyz(point),
        mode="markers",
        marker={"symbol": symbol, "color": colour, "size": size, "line": {"color": colour, "width": 3}},
        name=name,
        hovertemplate=f"{name}<br>%{{x:.4f}}, %{{y:.4f}}, %{{z:.4f}} m<extra></extra>",
    )


def _moving_traces(picture: Picture, state: int, *, named: bool) -> list[Any]:
    """The traces of one state, in a fixed order; only the first state's carry names and looks."""
    robot = picture.robot
    positions, rotations = picture.positions[state], picture.rotations[state]
    sides = int(np.clip(_MAX_RIM_CORNERS // robot.disk_count, 6, 24))
    vertices, faces = disk_mesh(robot, positions, rotations, sides)
    traces: list[Any] = []
    disks = _xyz(vertices)
    if named:
        disks |= dict(zip("ijk", faces.T.astype(np.int32), strict=True))
        disks |= {
            "color": plots.ROBOT,
            "name": "disks",
            "showlegend": True,
            "flatshading": True,
            "hoverinfo": "skip",
            "lighting": {"ambient": 0.55, "diffuse": 0.7, "specular": 0.2, "roughness": 0.6},
        }
    traces.append(go.Mesh3d(**disks))
    curve = backbone_curve(positions, rotations, robot.arc_lengths, per_gap=2)
    traces.append(_line(curve, named, "backbone (reference)", plots.INK, 6))
    for index, line in enumerate(tendon_lines(robot, positions, rotations)):
        traces.append(_line(line, named, f"tendon {index + 1}", plots.tendon_colour(index), 3, legend=False))
    if picture.model_positions is not None:
        name = f"{picture.model_name.replace('_', ' ')} shape"
        traces.append(_line(picture.model_positions[state], named, name, plots.LEARNED, 5, dash="dash"))
    if picture.has_path:
        traces += _cursors(picture, state, named=named)
    return traces


def _line(
    points: FloatArray, named: bool, name: str, colour: str, width: int, *, dash: str = "solid", legend: bool = True
) -> Any:
    look: dict[str, Any] = {}
    if named:
        look = {
            "mode": "lines",
            "line": {"color": colour, "width": width, "dash": dash},
            "name": name,
            "showlegend": legend,
            "hoverinfo": "skip",
        }
    return go.Scatter3d(**_xyz(points), **look)


def _cursors(picture: Picture, state: int, *, named: bool) -> list[Any]:
    time = float(picture.times[state])
    look: dict[str, Any] = {}
    dot: dict[str, Any] = {}
    if named:
        line = {"color": plots.MUTED, "width": 1.5}
        look = {"mode": "lines", "line": line, "showlegend": False, "hoverinfo": "skip"}
        dot = {
            "mode": "markers",
            "marker": {"color": plots.PALETTE["blue"], "size": 9, "line": {"color": "white", "width": 2}},
            "showlegend": False,
            "hoverinfo": "skip",
        }
    low, high = _clearance_range(picture)
    top = _tension_top(picture)
    value = float(1e3 * picture.clearance[state])
    return [
        go.Scatter(x=[time, time], y=[low, high], **look, **_axes("x", "y", named)),
        go.Scatter(x=[time], y=[value if np.isfinite(value) else None], **dot, **_axes("x", "y", named)),
        go.Scatter(x=[time, time], y=[0.0, top], **look, **_axes("x2", "y2", named)),
    ]


def _axes(x: str, y: str, named: bool) -> dict[str, str]:
    return {"xaxis": x, "yaxis": y} if named else {}


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


def _clearance_traces(picture: Picture) -> list[Any]:
    times, values = picture.times, 1e3 * picture.clearance
    limit = 1e3 * picture.required_clearance
    shared = {"xaxis": "x", "yaxis": "y", "showlegend": False}
    traces = [
        go.Scatter(
            x=times,
            y=values,
            mode="lines",
            line={"color": plots.PALETTE["blue"], "width": 2.5},
            hovertemplate="%{x:.2f} s: %{y:.3f} mm<extra>clearance</extra>",
            **shared,
        ),
        go.Scatter(
            x=[times[0], times[-1]],
            y=[limit, limit],
            mode="lines",
            line={"color": plots.ALERT, "width": 1.5, "dash": "dash"},
            hovertemplate=f"required: {limit:g} mm<extra></extra>",
            **shared,
        ),
    ]
    worst = picture.worst_state
    if worst is not None:
        traces.append(
            go.Scatter(
                x=[times[worst]],
                y=[values[worst]],
                mode="markers+text",
                text=[f"worst {values[worst]:.2f} mm"],
                textposition="top right" if worst < 0.6 * len(times) else "top left",
                textfont={"color": plots.ALERT, "size": 12},
                marker={"symbol": "circle-open", "size": 13, "color": plots.ALERT, "line": {"width": 2.5}},
                hovertemplate=f"worst state {worst}: %{{y:.3f}} mm<extra></extra>",
                cliponaxis=False,
                **shared,
            )
        )
    return traces


def _tension_traces(picture: Picture) -> list[Any]:
    dashes = ("solid", "dash", "dashdot", "dot")
    return [
        go.Scatter(
            x=picture.times,
            y=picture.tensions[:, index],
            mode="lines",
            line={
                "color": plots.tendon_colour(index),
                "width": 2,
                "dash": dashes[int(picture.robot.tendon_segments[index]) % len(dashes)],
            },
            name=f"tendon {index + 1}",
            legend="legend2",
            xaxis="x2",
            yaxis="y2",
            hovertemplate=f"%{{x:.2f}} s: %{{y:.3f}} N<extra>tendon {index + 1}</extra>",
        )
        for index in range(picture.tensions.shape[1])
    ]


def _layout(picture: Picture) -> dict[str, Any]:
    camera = choose_camera(picture, 900, 700)
    towards, up = camera.rotation[2], up_direction(picture)
    hidden = {"visible": False, "showspikes": False}
    low, high = _bounds(picture)
    span = high - low
    corners = np.array(list(itertools.product(*np.stack([low, high], axis=1)))) @ camera.rotation.T
    right, above = np.ptp(corners[:, 0]), np.ptp(corners[:, 1])
    ratio = _SCENE_FILL * span / max(above, right / 1.2)
    scene_end = 0.62 if picture.has_path else 1.0
    layout: dict[str, Any] = {
        "margin": {"l": 8, "r": 16, "t": 8, "b": 8},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "font": {"family": _FONT, "size": 12, "color": plots.INK},
        "uirevision": "fixed",
        "hovermode": "closest",
        "legend": {"x": 0.0, "y": 0.0, "xanchor": "left", "yanchor": "bottom", "bgcolor": "rgba(255,255,255,0.75)"},
        "scene": {
            "domain": {"x": [0.0, scene_end], "y": [0.0, 1.0]},
            "aspectmode": "manual",
            "aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
            "camera": {
                "eye": dict(zip("xyz", (1.6 * towards).tolist(), strict=True)),
                "up": dict(zip("xyz", up.tolist(), strict=True)),
                "projection": {"type": "orthographic"},
            },
            "dragmode": "orbit",
            **{f"{axis}axis": {**hidden, "range": [low[i], high[i]]} for i, axis in enumerate("xyz")},
        },
    }
    if picture.has_path:
        layout |= _time_axes(picture)
    return layout


def _time_axes(picture: Picture) -> dict[str, Any]:
    shared = {"gridcolor": plots.GRID, "linecolor": "#AEB8C4", "zeroline": False, "ticks": "outside", "ticklen": 4}
    span = [0.0, max(float(picture.times[-1]), 1e-6)]
    low, high = _clearance_range(picture)
    side = {"domain": [0.69, 1.0], "range": span, **shared}
    captions = (("Clearance", 1.0), ("Tendon tensions", 0.44))
    return {
        "xaxis": {**side, "anchor": "y", "matches": "x2", "showticklabels": False},
        "yaxis": {**shared, "domain": [0.57, 0.95], "anchor": "x", "range": [low, high], "title": "mm"},
        "xaxis2": {**side, "anchor": "y2", "title": {"text": "time (s)", "standoff": 4}},
        "yaxis2": {
            **shared,
            "domain": [0.07, 0.39],
            "anchor": "x2",
            "range": [0.0, _tension_top(picture)],
            "title": "N",
        },
        "legend2": {
            "x": 0.69,
            "y": 0.40,
            "xanchor": "left",
            "yanchor": "bottom",
            "orientation": "h",
            "font": {"size": 11},
            "bgcolor": "rgba(0,0,0,0)",
        },
        "annotations": [
            {
                "text": f"<b>{text}</b>",
                "x": 0.69,
                "y": y,
                "xref": "paper",
                "yref": "paper",
                "xanchor": "left",
                "yanchor": "top" if y == 1.0 else "bottom",
                "showarrow": False,
                "font": {"size": 14},
            }
            for text, y in captions
        ],
    }


def _bounds(picture: Picture) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corner of everything drawn, shape (3,) each, m."""
    parts = [picture.positions[picture.known].reshape(-1, 3), picture.scenario.base_position[None]]
    parts += [goal.position[None] for goal in picture.goals] + [mesh.vertices for mesh in picture.meshes]
    points = np.concatenate(parts)
    room = float(picture.robot.disk_radii.max())
    return points.min(axis=0) - room, points.max(axis=0) + room


def _xyz(points: FloatArray) -> dict[str, Any]:
    return dict(zip("xyz", np.ascontiguousarray(points.T, dtype=np.float32), strict=True))


def _readouts(picture: Picture, shown: IntArray) -> list[dict[str, Any]]:
    """What the page writes beside the slider for each frame."""

    def known(value: float, digits: int) -> float | None:
        return round(float(value), digits) if np.isfinite(value) else None

    return [
        {
            "state": int(state),
            "time_s": round(float(picture.times[state]), 3),
            "clearance_mm": known(1e3 * picture.clearance[state], 3),
            "deviation_mm": known(1e3 * picture.deviation[state], 3),
            "insertion_mm": round(1e3 * float(picture.insertion[state]), 2),
            "roll_deg": round(float(np.rad2deg(picture.roll[state])), 1),
            "worst": int(state) == picture.worst_state,
        }
        for state in shown
    ]


def _script_json(value: Any) -> str:
    """Returns JSON that may stand inside a script element."""
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c")
