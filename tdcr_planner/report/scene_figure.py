"""The scene and its curves as a plotly.js figure: what stays, and what each frame replaces. Lengths in mm."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.report import plots
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera
from tdcr_planner.report.robot_mesh import backbone_curve, disk_mesh, simplify_mesh, tendon_lines
from tdcr_planner.report.time_traces import cursor_traces, time_layout, time_traces
from tdcr_planner.report.viewpoint import body_points, choose_camera, points_to_fit, up_direction

MAX_WALL_FACES = 60_000
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"
Trace = dict[str, Any]
_MAX_RIM_CORNERS = 640
# plotly's parallel projection shows a height of 2 of its scene units; a little is left free.
_SHOWN_HEIGHT = 1.94
# width to height of a scene over the whole width of a laptop's page
_WIDE_AT_FULL = 2.1
_VIEW_HEIGHT_PX = 700
_SCENE_WIDTH = 0.63
_WALL_SHADES = {"cavity": ("#5E7891", "#D5E2EE"), "obstacle": ("#7B6A56", "#E9E1D6")}
_WALL_OPACITY = {"cavity": 0.30, "obstacle": 0.55}
_DISK_SHADES = ("#0F4C81", "#4C9AD6")


def build_figure(picture: Picture, shown: IntArray) -> dict[str, Any]:
    """Returns the figure as plotly.js takes it, data, layout and frames, with arrays for its numbers.

    Fixed traces come first, then those that each frame replaces. The layout's `meta` holds the width and the height
    that the view must show, in plotly's scene units, for a page to fit it to another window.

    Args:
        picture: What is shown.
        shown: Indices of the states that become frames.
    """
    camera = choose_camera(picture, int(_VIEW_HEIGHT_PX * _WIDE_AT_FULL * _scene_share(picture)), _VIEW_HEIGHT_PX)
    fixed = [*_wall_traces(picture, camera), *_mark_traces(picture)]
    if picture.has_path:
        fixed += time_traces(picture)
    moving = [] if not len(shown) else _moving_traces(picture, int(shown[0]), named=True)
    frames = []
    if picture.has_path:
        indices = list(range(len(fixed), len(fixed) + len(moving)))
        frames = [
            {"name": str(number), "traces": indices, "data": _moving_traces(picture, int(state), named=False)}
            for number, state in enumerate(shown)
        ]
    return {"data": [*fixed, *moving], "layout": _layout(picture, camera), "frames": frames}


def _wall_traces(picture: Picture, camera: Camera) -> list[Trace]:
    total = sum(len(mesh.faces) for mesh in picture.meshes)
    light = np.array([-0.45, 0.6, 0.66]) @ camera.rotation
    traces = []
    for mesh in picture.meshes:
        share = max(500, int(MAX_WALL_FACES * len(mesh.faces) / max(total, 1)))
        vertices, faces = simplify_mesh(mesh.vertices, mesh.faces, share)
        smooth = mesh.role == "cavity"
        lit = np.abs(_normals(vertices, faces, smooth=smooth) @ light)
        traces.append(
            {
                "type": "mesh3d",
                **_xyz(vertices),
                **_ijk(faces),
                **_shades(lit, *_WALL_SHADES[mesh.role]),
                "intensitymode": "vertex" if smooth else "cell",
                "opacity": _WALL_OPACITY[mesh.role],
                "hoverinfo": "skip",
                "name": f"{mesh.name} ({mesh.role})",
                "showlegend": True,
            }
        )
    return traces


def _shades(light: FloatArray, dark: str, bright: str) -> Trace:
    """Light that stays where it is when the scene turns: colours between dark (0) and bright (1)."""
    return {
        "intensity": light,
        "cmin": 0.0,
        "cmax": 1.0,
        "colorscale": [[0.0, dark], [1.0, bright]],
        "showscale": False,
        "lighting": {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0},
    }


def _normals(vertices: FloatArray, faces: IntArray, *, smooth: bool) -> FloatArray:
    """Unit normals of the vertices, shape (v, 3), or of the faces, shape (f, 3)."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if smooth:
        total = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(total, faces[:, corner], normals)
        normals = total
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))


def _mark_traces(picture: Picture) -> list[Trace]:
    traces = []
    tips = picture.positions[picture.known][:, -1]
    if picture.has_path and len(tips):
        traces.append(_line(tips, "tip trace", plots.TRACE, 5))
    if picture.has_path and picture.worst_state is not None and picture.known[picture.worst_state]:
        traces.append(_worst_trace(picture, picture.worst_state))
    if len(tips):
        traces.append(_marker(tips[:1], "start", "circle-open", plots.INK, 7))
    if picture.contact is not None:
        # a cross in space, larger than the disks that would hide a marker
        arms = 2.5 * picture.robot.disk_radii.max() * np.eye(3)
        ends = np.stack([picture.contact - arms, picture.contact + arms, np.full((3, 3), np.nan)], axis=1)
        traces.append({**_line(ends.reshape(-1, 3), "contact of the start", plots.ALERT, 6), "connectgaps": False})
    for number, goal in enumerate(picture.goals):
        name = "goal" if len(picture.goals) == 1 else f"goal {number + 1}"
        traces.append(_marker(goal.position[None], name, "diamond-open", plots.GOAL, 8))
        if goal.direction is not None:
            ends = np.stack([goal.position, goal.position + 0.15 * picture.robot.length * goal.direction])
            traces.append(_line(ends, f"{name}: viewing direction", plots.GOAL, 4))
    return traces


def _worst_trace(picture: Picture, state: int) -> Trace:
    """The state of least clearance as one thin line: its backbone and the rims of its disks."""
    robot, positions, rotations = picture.robot, picture.positions[state], picture.rotations[state]
    angle = np.linspace(0.0, 2.0 * np.pi, 19)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    rims = positions[:, None] + np.einsum("dij,vj->dvi", rotations, rim) * robot.disk_radii[:, None, None]
    # a point that is not a number ends a piece of the line
    gap = np.full((1, 3), np.nan)
    pieces = [backbone_curve(positions, rotations, robot.arc_lengths, per_gap=2), gap]
    for ring in rims:
        pieces += [ring, gap]
    name = f"worst state, {1e3 * picture.clearance[state]:.2f} mm"
    return {**_line(np.concatenate(pieces[:-1]), name, plots.ALERT, 3), "connectgaps": False}


def _marker(point: FloatArray, name: str, symbol: str, colour: str, size: int) -> Trace:
    return {
        "type": "scatter3d",
        **_xyz(point),
        "mode": "markers",
        "marker": {"symbol": symbol, "color": colour, "size": size, "line": {"color": colour, "width": 3}},
        "name": name,
        "hovertemplate": f"{name}<br>%{{x:.1f}}, %{{y:.1f}}, %{{z:.1f}} mm<extra></extra>",
    }


def _line(points: FloatArray, name: str, colour: str, width: int, *, legend: bool = True) -> Trace:
    return {
        "type": "scatter3d",
        **_xyz(points),
        "mode": "lines",
        "line": {"color": colour, "width": width},
        "name": name,
        "showlegend": legend,
        "hoverinfo": "skip",
    }


def _moving_traces(picture: Picture, state: int, *, named: bool) -> list[Trace]:
    """The traces of one state, in a fixed order; those that follow the first carry coordinates alone."""
    robot = picture.robot
    positions, rotations = picture.positions[state], picture.rotations[state]
    traces = [_disk_trace(picture, state)]
    if picture.model_positions is not None:
        name = f"{picture.model_name.replace('_', ' ')} shape"
        # a wide band: where both shapes agree, as they should, it shows on both sides of the reference's line
        traces.append({**_line(picture.model_positions[state], name, plots.LEARNED, 14), "opacity": 0.6})
    curve = backbone_curve(positions, rotations, robot.arc_lengths, per_gap=2)
    traces.append(_line(curve, "backbone (reference)", plots.INK, 5))
    for index, line in enumerate(tendon_lines(robot, positions, rotations)):
        traces.append(_line(line, f"tendon {index + 1}", plots.tendon_colour(index), 3, legend=False))
    if picture.has_path:
        traces += cursor_traces(picture, state)
    if named:
        return traces
    return [{key: trace[key] for key in ("type", "x", "y", "z") if key in trace} for trace in traces]


def _disk_trace(picture: Picture, state: int) -> Trace:
    robot = picture.robot
    sides = int(np.clip(_MAX_RIM_CORNERS // robot.disk_count, 6, 24))
    vertices, faces = disk_mesh(robot, picture.positions[state], picture.rotations[state], sides)
    rim_then_caps = np.repeat([0.1, 0.75], 2 * sides)
    return {
        "type": "mesh3d",
        **_xyz(vertices),
        **_ijk(faces),
        **_shades(np.tile(rim_then_caps, robot.disk_count), *_DISK_SHADES),
        "intensitymode": "cell",
        "name": "disks",
        "showlegend": True,
        "hoverinfo": "skip",
    }


def _layout(picture: Picture, camera: Camera) -> dict[str, Any]:
    low, high = _bounds(picture)
    shown = points_to_fit(picture, body_points(picture)) @ camera.rotation.T
    room = float(picture.robot.disk_radii.max())
    right, above = np.ptp(shown[:, :2], axis=0) + 2.0 * room
    wide = _scene_share(picture)
    scale = min(_SHOWN_HEIGHT / above, _SHOWN_HEIGHT * _WIDE_AT_FULL * wide / right)
    centre = scale * (camera.centre - 0.5 * (low + high))
    eye = centre + 1.6 * camera.rotation[2]
    layout: dict[str, Any] = {
        "margin": {"l": 8, "r": 16, "t": 8, "b": 8, "autoexpand": False},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "font": {"family": FONT, "size": 12, "color": plots.INK},
        "uirevision": "fixed",
        "meta": {"right": scale * right * 2.0 / _SHOWN_HEIGHT, "above": scale * above * 2.0 / _SHOWN_HEIGHT},
        "hovermode": "closest",
        "legend": {
            "x": 0.0,
            "y": 0.0,
            "xanchor": "left",
            "yanchor": "bottom",
            "orientation": "h",
            "font": {"size": 11},
        },
        "scene": {
            "domain": {"x": [0.0, wide], "y": [0.08, 1.0]},
            "aspectmode": "manual",
            "aspectratio": dict(zip("xyz", (scale * (high - low)).tolist(), strict=True)),
            "camera": {
                "eye": dict(zip("xyz", eye.tolist(), strict=True)),
                "center": dict(zip("xyz", centre.tolist(), strict=True)),
                "up": dict(zip("xyz", up_direction(picture).tolist(), strict=True)),
                "projection": {"type": "orthographic"},
            },
            "dragmode": "orbit",
            **{
                f"{axis}axis": {"visible": False, "showspikes": False, "range": [1e3 * low[i], 1e3 * high[i]]}
                for i, axis in enumerate("xyz")
            },
        },
    }
    return layout | time_layout(picture) if picture.has_path else layout


def _scene_share(picture: Picture) -> float:
    """Part of the page's width that the scene takes: all of it where there are no curves."""
    return _SCENE_WIDTH if picture.has_path else 1.0


def _bounds(picture: Picture) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corner of everything drawn, shape (3,) each, m."""
    points = np.concatenate([body_points(picture), *(mesh.vertices for mesh in picture.meshes)])
    room = float(picture.robot.disk_radii.max())
    return points.min(axis=0) - room, points.max(axis=0) + room


def _xyz(points: FloatArray) -> dict[str, Any]:
    return dict(zip("xyz", 1e3 * points.T, strict=True))


def _ijk(faces: IntArray) -> dict[str, Any]:
    return dict(zip("ijk", faces.T, strict=True))
