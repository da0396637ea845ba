"""The scene and its curves as a plotly.js figure: what stays, and what each frame replaces. Lengths in mm."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.body import Kind
from tdcr_planner.collision.roles import find_role
from tdcr_planner.report import plots
from tdcr_planner.report.body_mesh import has_solids, part_mesh, shaft_mesh, sleeve_mesh
from tdcr_planner.report.legend import legend_entry, tendon_entry
from tdcr_planner.report.marks import Mark
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.raster import Camera
from tdcr_planner.report.robot_mesh import Mesh, backbone_curve, disk_mesh, merge_meshes, simplify_mesh, tendon_lines
from tdcr_planner.report.scene_guides import AXIS_COLOURS, GRAVITY_COLOUR, base_axes, entry_disks
from tdcr_planner.report.tendon_style import tendon_colour
from tdcr_planner.report.text import SHORT, plain_text, plotly_text
from tdcr_planner.report.time_traces import arrangements, cursor_traces, time_layout, time_traces
from tdcr_planner.report.viewpoint import body_points, choose_camera, free_corner, points_to_fit, up_direction

MAX_WALL_FACES = 60_000
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"
Trace = dict[str, Any]
_MAX_RIM_CORNERS = 640
# plotly's parallel projection shows a height of 2 of its scene units; a little is left free.
_SHOWN_HEIGHT = 1.94
# width to height of a scene over the whole width of a laptop's page
_WIDE_AT_FULL = 2.1
# Arms of a cross in radii of the disks, which would hide a marker.
_CROSS = 2.5
# Length of a viewing direction, in lengths of the robot.
_VIEW_ARROW = 0.15
_VIEW_HEIGHT_PX = 700
_SCENE_WIDTH = 0.63
_DISK_SHADES = ("#0F4C81", "#4C9AD6")


def build_figure(picture: Picture, shown: IntArray) -> dict[str, Any]:
    """Returns the figure as plotly.js takes it, data, layout and frames, with arrays for its numbers.

    Fixed traces come first, then those that each frame replaces. A trace's `meta` is its entry in the page's legend:
    label as plain text, group, kind of swatch, colour and dash. The layout's `meta` holds the width and the height that
    the view must show, in plotly's scene units, for a page to fit it to another window.

    Args:
        picture: What is shown.
        shown: Indices of the states that become frames.
    """
    camera = choose_camera(picture, int(_VIEW_HEIGHT_PX * _WIDE_AT_FULL * _scene_share(picture)), _VIEW_HEIGHT_PX)
    fixed = [*_wall_traces(picture, camera), *_guide_traces(picture), *_point_traces(picture), *_mark_traces(picture)]
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
        wall = find_role(mesh.role).wall
        smooth = wall.smooth
        lit = np.abs(_normals(vertices, faces, smooth=smooth) @ light)
        traces.append(
            {
                "type": "mesh3d",
                **_xyz(vertices),
                **_ijk(faces),
                **_shades(lit, *wall.shades),
                "intensitymode": "vertex" if smooth else "cell",
                "opacity": wall.opacity,
                "hoverinfo": "none",
                "name": f"{plotly_text(mesh.name)} ({mesh.role})",
                "meta": legend_entry(f"{plain_text(mesh.name, SHORT)} ({mesh.role})", "surface", wall.shades[1]),
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


def _guide_traces(picture: Picture) -> list[Trace]:
    """Entry planes, and in a picture without a path the base frame."""
    traces = []
    for disk in entry_disks(picture):
        rim = _line(disk.rim, "entry plane", GRAVITY_COLOUR, 3)
        rim["line"]["dash"] = "dash"
        rim["meta"] = legend_entry("entry plane", "line", GRAVITY_COLOUR, dash="5,3")
        count = len(disk.rim)
        fan = np.stack([np.full(count - 1, count), np.arange(count - 1), np.arange(1, count)], axis=1)
        traces += [rim, _surface((np.vstack([disk.rim, disk.centre]), fan), "entry plane", GRAVITY_COLOUR, 0.08)]
        traces[-1]["meta"] = rim["meta"]
    if picture.has_path:
        return traces
    origin, rotation = base_axes(picture)
    length = 3.0 * float(picture.robot.disk_radii.max())
    for index, (axis, colour) in enumerate(AXIS_COLOURS.items()):
        arm = _line(np.stack([origin, origin + length * rotation[:, index]]), f"base frame, {axis}", colour, 6)
        traces.append(arm | {"meta": legend_entry("base frame", "line", GRAVITY_COLOUR)})
    return traces


def _point_traces(picture: Picture) -> list[Trace]:
    """The way of the tip, the worst state, start and goals."""
    traces = []
    tips = picture.positions[picture.known][:, -1]
    if picture.has_path and len(tips):
        traces.append(_line(tips, "tip trace", plots.TRACE, 5))
    if picture.has_path and picture.worst_state is not None and picture.known[picture.worst_state]:
        state = picture.worst_state
        outline = _outline(picture, picture.positions[state], picture.rotations[state])
        traces.append({**_line(outline, picture.worst_label, plots.ALERT, 3), "connectgaps": False})
    if len(tips):
        traces.append(_marker(tips[:1], "start", "circle-open", plots.INK, 7))
    for number, goal in enumerate(picture.goals):
        name = "goal" if len(picture.goals) == 1 else f"goal {number + 1}"
        traces.append(_marker(goal.position[None], name, "diamond-open", plots.GOAL, 8))
        if goal.direction is not None:
            ends = np.stack([goal.position, goal.position + _VIEW_ARROW * picture.robot.length * goal.direction])
            traces.append(_line(ends, f"{name}: viewing direction", plots.GOAL, 4))
    return traces


def _mark_traces(picture: Picture) -> list[Trace]:
    """Crosses, outlines and parts of the body that are marked."""
    traces = []
    radius = float(picture.robot.disk_radii.max())
    for mark in picture.marks:
        label = plain_text(mark.label, SHORT)
        entry = legend_entry(label, "cross", plots.ALERT)
        if mark.point is not None:
            arms = _CROSS * radius * np.eye(3)
            ends = np.stack([mark.point - arms, mark.point + arms, np.full((3, 3), np.nan)], axis=1)
            traces.append({**_line(ends.reshape(-1, 3), label, plots.ALERT, 6), "connectgaps": False, "meta": entry})
        if mark.positions is not None and mark.rotations is not None:
            outline = _outline(picture, mark.positions, mark.rotations)
            traces.append({**_line(outline, label, plots.ALERT, 3), "connectgaps": False, "meta": entry})
        part = _marked_part(picture, mark, 0.06 * radius)
        if part is not None:
            traces.append(_surface(part, label, plots.ALERT, 0.6) | {"meta": entry})
    return traces


def _marked_part(picture: Picture, mark: Mark, room: float) -> Mesh | None:
    """The parts of the body that a mark names, where they are drawn; None for none."""
    positions, rotations = mark.positions, mark.rotations
    if positions is None and not picture.has_path and picture.known.all():
        positions, rotations = picture.positions[0], picture.rotations[0]
    if positions is None or rotations is None or not mark.part:
        return None
    parts = [part_mesh(picture.body, positions, rotations, name, room) for name in mark.part.split(" and ")]
    found = [part for part in parts if part is not None]
    return merge_meshes(found) if found else None


def _surface(mesh: Mesh, name: str, colour: str, opacity: float) -> Trace:
    """A surface of one colour, lit from all sides."""
    return {
        "type": "mesh3d",
        **_xyz(mesh[0]),
        **_ijk(mesh[1]),
        "color": colour,
        "opacity": opacity,
        "lighting": {"ambient": 0.85, "diffuse": 0.3, "specular": 0.05, "fresnel": 0.0},
        "name": plotly_text(name),
        "hoverinfo": "none",
        "showlegend": False,
        "meta": legend_entry(name, "surface", colour),
    }


def _outline(picture: Picture, positions: FloatArray, rotations: FloatArray) -> FloatArray:
    """A state as one line: its backbone and the rims of its disks; points that are not numbers end its pieces."""
    robot = picture.robot
    angle = np.linspace(0.0, 2.0 * np.pi, 19)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    rims = positions[:, None] + np.einsum("dij,vj->dvi", rotations, rim) * robot.disk_radii[:, None, None]
    gap = np.full((1, 3), np.nan)
    pieces = [backbone_curve(positions, rotations, robot.arc_lengths, per_gap=2), gap]
    for ring in rims:
        pieces += [ring, gap]
    return np.concatenate(pieces[:-1])


def _marker(point: FloatArray, name: str, symbol: str, colour: str, size: int) -> Trace:
    kind = "ring" if symbol.startswith("circle") else "diamond"
    return {
        "type": "scatter3d",
        **_xyz(point),
        "mode": "markers",
        "marker": {"symbol": symbol, "color": colour, "size": size, "line": {"color": colour, "width": 3}},
        "name": plotly_text(name),
        "hoverinfo": "none",
        "meta": legend_entry(name, kind, colour),
    }


def _line(points: FloatArray, name: str, colour: str, width: int) -> Trace:
    return {
        "type": "scatter3d",
        **_xyz(points),
        "mode": "lines",
        "line": {"color": colour, "width": width},
        "name": plotly_text(name),
        "hoverinfo": "skip",
        "meta": legend_entry(name, "line", colour),
    }


def _moving_traces(picture: Picture, state: int, *, named: bool) -> list[Trace]:
    """The traces of one state, in a fixed order; those that follow the first carry coordinates alone."""
    robot = picture.robot
    positions, rotations = picture.positions[state], picture.rotations[state]
    traces = [_disk_trace(picture, state)]
    if has_solids(picture.body, Kind.SLEEVE):
        sleeve = sleeve_mesh(picture.body, positions, rotations, _rim_corners(picture))
        traces.append(_surface(sleeve, "sleeve (tested)", plots.SLEEVE, 0.3))
    if has_solids(picture.body, Kind.SHAFT):
        traces.append(_surface(shaft_mesh(picture.body, positions, rotations), "shaft (tested)", plots.SHAFT, 1.0))
    if picture.model_positions is not None:
        name = f"{picture.model_name.replace('_', ' ')} shape"
        # a wide band: where both shapes agree, as they should, it shows on both sides of the reference's line
        traces.append({**_line(picture.model_positions[state], name, plots.LEARNED, 14), "opacity": 0.6})
    curve = backbone_curve(positions, rotations, robot.arc_lengths, per_gap=2)
    traces.append(_line(curve, "backbone (reference)", plots.INK, 5))
    for index, line in enumerate(tendon_lines(robot, positions, rotations)):
        traces.append(
            _line(line, f"tendon {index + 1}", tendon_colour(index), 3) | {"meta": tendon_entry(picture, index)}
        )
    if picture.has_path:
        traces += cursor_traces(picture, state)
    if named:
        return traces
    return [{key: trace[key] for key in ("type", "x", "y", "z") if key in trace} for trace in traces]


def _rim_corners(picture: Picture) -> int:
    return int(np.clip(_MAX_RIM_CORNERS // picture.robot.disk_count, 6, 24))


def _disk_trace(picture: Picture, state: int) -> Trace:
    robot = picture.robot
    sides = _rim_corners(picture)
    vertices, faces = disk_mesh(robot, picture.positions[state], picture.rotations[state], sides)
    rim_then_caps = np.repeat([0.1, 0.75], 2 * sides)
    return {
        "type": "mesh3d",
        **_xyz(vertices),
        **_ijk(faces),
        **_shades(np.tile(rim_then_caps, robot.disk_count), *_DISK_SHADES),
        "intensitymode": "cell",
        "name": "disks",
        "hoverinfo": "none",
        "meta": legend_entry("disks", "surface", _DISK_SHADES[1]),
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
        "meta": {
            "right": scale * right * 2.0 / _SHOWN_HEIGHT,
            "above": scale * above * 2.0 / _SHOWN_HEIGHT,
            "corner": free_corner(picture, camera, ("lower left", "lower right", "upper right")),
            "arrangements": arrangements(wide) if picture.has_path else None,
        },
        "hovermode": "closest",
        "showlegend": False,
        "scene": {
            "domain": {"x": [0.0, wide], "y": [0.0, 1.0]},
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
    guides = [disk.rim for disk in entry_disks(picture)]
    room = float(picture.robot.disk_radii.max())
    crosses = [mark.point for mark in picture.marks if mark.point is not None]
    guides += [point + sign * _CROSS * room * np.eye(3) for point in crosses for sign in (-1.0, 1.0)]
    guides += [
        (goal.position + _VIEW_ARROW * picture.robot.length * goal.direction)[None]
        for goal in picture.goals
        if goal.direction is not None
    ]
    if not picture.has_path:
        origin, rotation = base_axes(picture)
        guides.append(origin + 3.0 * room * rotation.T)
    points = np.concatenate([body_points(picture), *guides, *(mesh.vertices for mesh in picture.meshes)])
    return points.min(axis=0) - room, points.max(axis=0) + room


def _xyz(points: FloatArray) -> dict[str, Any]:
    return dict(zip("xyz", 1e3 * points.T, strict=True))


def _ijk(faces: IntArray) -> dict[str, Any]:
    return dict(zip("ijk", faces.T, strict=True))
