"""The moving picture of an inspection: the scene with its coverage map, and beside it what the camera sees."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from tdcr_planner.inspection.answer import Inspection
from tdcr_planner.report import raster
from tdcr_planner.report.coverage_map import CLASSES, COLOURS, PaintedMesh, point_classes
from tdcr_planner.report.coverage_picture import CoveragePicture
from tdcr_planner.report.legend import legend_entry
from tdcr_planner.report.scene_html import Beside, render_html

_QUALITY = 80
_LIFT_M = 2e-4  # of the map over the surface that it lies on


def write_coverage_html(shown: CoveragePicture, file: str | Path) -> None:
    """Writes the moving picture of an inspection as one HTML file that needs no network."""
    picture, moves = shown.picture, len(shown.shown) > 0
    beside = Beside(
        traces=[*_map_traces(shown.inspection, shown.painted), _point_trace(shown.inspection)],
        html=_HTML if moves else "",
        summary=f"robot {picture.robot.name}  ·  {picture.message}" if picture.has_path else "",
        script=_script(shown) if moves else "",
    )
    Path(file).write_text(render_html(picture, beside), encoding="utf-8")


def _map_traces(inspection: Inspection, painted: list[PaintedMesh]) -> list[dict[str, Any]]:
    """The painted faces of each class, lifted off the surface a little, as one trace a class."""
    traces = []
    targets = inspection.coverage.targets
    tree = cKDTree(targets.points)
    for index in range(1, len(CLASSES)):
        vertices, faces, offset = [], [], 0
        for mesh in painted:
            chosen = mesh.faces[mesh.classes == index]
            if not len(chosen):
                continue
            corners = mesh.vertices[chosen]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
            _, nearest = tree.query(corners.mean(axis=1))
            normals *= np.where((normals * targets.normals[nearest]).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
            vertices.append((corners + _LIFT_M * normals[:, None]).reshape(-1, 3))
            faces.append(offset + np.arange(3 * len(chosen)).reshape(-1, 3))
            offset += 3 * len(chosen)
        if not vertices:
            continue
        points, triangles = 1e3 * np.concatenate(vertices), np.concatenate(faces)
        traces.append(
            {
                "type": "mesh3d",
                **dict(zip("xyz", points.T, strict=True)),
                **dict(zip("ijk", triangles.T, strict=True)),
                "color": COLOURS[index],
                "flatshading": True,
                "lighting": {"ambient": 0.75, "diffuse": 0.45, "specular": 0.05, "fresnel": 0.0},
                "name": CLASSES[index],
                "hoverinfo": "skip",
                "meta": legend_entry(CLASSES[index], "surface", COLOURS[index]),
            }
        )
    return traces


def _point_trace(inspection: Inspection) -> dict[str, Any]:
    """The points, each with what is known of it under the mouse."""
    coverage, path = inspection.coverage, inspection.plan.path
    sight, classes = coverage.sight, point_classes(coverage)
    incidence = sight.incidence_deg
    texts = []
    for index, kind in enumerate(classes.tolist()):
        cause = coverage.causes[index]
        if kind == 1 and path is not None:
            texts.append(
                f"seen from {path.times[sight.first[index]]:.1f} s, nearest {1e3 * sight.distance[index]:.0f} mm, "
                f"least incidence {incidence[index]:.0f} degrees"
            )
        elif kind == 2:
            texts.append("could be seen, the path leaves it out")
        else:
            texts.append(f"cannot be seen: {cause.value if cause is not None else 'not tried'}")
    lifted = coverage.targets.points + 2.0 * _LIFT_M * coverage.targets.normals
    return {
        "type": "scatter3d",
        **dict(zip("xyz", 1e3 * lifted.T, strict=True)),
        "mode": "markers",
        "marker": {"size": 2.2, "color": [COLOURS[kind] for kind in classes], "opacity": 0.9},
        "text": texts,
        "hoverinfo": "none",
        "name": "points",
        "meta": legend_entry("points", "ring", "#6B7785"),
    }


def _script(shown: CoveragePicture) -> str:
    """The page's script with the tip views and the coverage in each shown state."""
    coverage = shown.inspection.coverage
    first, areas = coverage.sight.first, coverage.targets.areas
    total = float(areas.sum())
    data = {
        "views": [_as_jpeg(view) for view in shown.views],
        "covered": [
            round(100.0 * float(areas[(first >= 0) & (first <= state)].sum()) / total, 2) for state in shown.shown
        ],
        "visible": round(100.0 * coverage.visible, 2),
        "times": [round(float(shown.picture.times[state]), 3) for state in shown.shown],
    }
    return _SCRIPT.replace("DATA", json.dumps(data, allow_nan=False).replace("<", "\\u003c"))


def _as_jpeg(image: raster.Image) -> str:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(raster.to_bytes(image)).save(stream, format="JPEG", quality=_QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


_HTML = """
<div id="tip" style="position:absolute;left:14px;top:30px;width:244px;background:rgba(255,255,255,0.92);
border:1px solid #D5DBE2;border-radius:10px;padding:6px 8px 4px;font-size:12px">
  <div style="display:flex;justify-content:space-between"><b>Tip view</b><span id="tip-note"></span></div>
  <img id="tip-image" alt="what the camera sees" width="240" height="240"
    style="border-radius:6px;display:block;margin:4px 0">
  <svg id="tip-curve" width="240" height="74" aria-label="coverage along the path"></svg>
</div>
"""

_SCRIPT = """
(function () {
  "use strict";
  const data = DATA, image = document.getElementById("tip-image"), note = document.getElementById("tip-note");
  const curve = document.getElementById("tip-curve"), left = 28, right = 236, top = 6, bottom = 58;
  const end = Math.max(data.times[data.times.length - 1], 1e-6), most = Math.max(data.visible, 1);
  const x = function (time) { return left + (right - left) * time / end; };
  const y = function (value) { return bottom - (bottom - top) * value / most; };
  function part(name, attributes, text) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    Object.keys(attributes).forEach(function (key) { made.setAttribute(key, attributes[key]); });
    if (text !== undefined) { made.textContent = text; }
    curve.appendChild(made);
    return made;
  }
  part("line", {x1: left, x2: right, y1: bottom, y2: bottom, stroke: "#AEB8C4"});
  part("line", {x1: left, x2: right, y1: top, y2: top, stroke: "#E8A317", "stroke-dasharray": "4,3"});
  function label(x, y, anchor, text) {
    part("text", {x: x, y: y, "text-anchor": anchor, "font-size": 10, fill: "#6B7785"}, text);
  }
  label(left - 3, top + 8, "end", most.toFixed(0) + "%");
  label(left - 3, bottom, "end", "0");
  label(right, bottom + 13, "end", end.toFixed(1) + " s");
  label(left, bottom + 13, "start", "share of the surfaces seen");
  part("polyline", {fill: "none", stroke: "#12A594", "stroke-width": 2,
    points: data.times.map(function (time, index) { return x(time) + "," + y(data.covered[index]); }).join(" ")});
  const dot = part("circle", {r: 4, fill: "#12A594", stroke: "white", "stroke-width": 1.5});
  function show(index) {
    image.src = data.views[index];
    note.textContent = data.covered[index].toFixed(1) + " of " + data.visible.toFixed(1) + " %";
    dot.setAttribute("cx", x(data.times[index]));
    dot.setAttribute("cy", y(data.covered[index]));
  }
  document.addEventListener("tdcr-state", function (event) { show(event.detail); });
  show(0);
})();
"""
