"""The moving picture: one self-contained HTML page with scene, robot, clearance and tensions that plays offline."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from tdcr_planner.arrays import IntArray
from tdcr_planner.report import plots
from tdcr_planner.report.picture import Picture
from tdcr_planner.report.scene_figure import FONT, build_figure
from tdcr_planner.report.scene_guides import AXIS_COLOURS, GRAVITY_COLOUR, gravity_direction, gravity_label
from tdcr_planner.report.scene_png import summary_line
from tdcr_planner.report.text import page_text

MAX_FRAMES = 64
_MESSAGE_LETTERS = 1200


@dataclass(frozen=True)
class Beside:
    """What a page shows beside scene, robot and curves.

    Attributes:
        traces: plotly.js traces that stay, in mm; of those of points, `text` is shown for what the mouse points at.
        html: Elements laid over the scene.
        summary: Line below the title; empty for the page's own.
        script: JavaScript run before the page's own; the event "tdcr-state" tells it the number of each frame shown.
    """

    traces: list[dict[str, Any]] = field(default_factory=list)
    html: str = ""
    summary: str = ""
    script: str = ""


def write_html(picture: Picture, file: str | Path) -> None:
    """Writes the moving picture of a result or a scenario as one HTML file that needs no network."""
    Path(file).write_text(render_html(picture), encoding="utf-8")


def render_html(picture: Picture, beside: Beside | None = None) -> str:
    """Returns the page as text, plotly.js included.

    Args:
        picture: What is shown.
        beside: What is shown besides; None for nothing.
    """
    from plotly.offline import get_plotlyjs

    shown = picture.frame_states(MAX_FRAMES)
    figure = build_figure(picture, shown) | {
        "config": {
            "displaylogo": False,
            "typesetMath": False,
            "scrollZoom": True,
            "modeBarButtonsToRemove": ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d", "autoScale2d"],
        }
    }
    beside = beside or Beside()
    # Behind all others: the frames name the traces that they replace by number.
    figure["data"] = [*figure["data"], *beside.traces]
    template = Template(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=page_text(picture.title),
        status=page_text(picture.status.replace("_", " ")),
        status_colour=plots.STATUS_COLOURS.get(picture.status, plots.MUTED),
        summary=page_text(beside.summary or summary_line(picture), _MESSAGE_LETTERS),
        message=page_text(picture.message, _MESSAGE_LETTERS),
        font=FONT,
        ink=plots.INK,
        muted=plots.MUTED,
        accent=plots.ROBOT,
        alert=plots.ALERT,
        plotly=get_plotlyjs(),
        figure=_script_json(figure),
        states=_script_json(_readouts(picture, shown)),
        compass=_script_json(_compass(picture)),
        beside=beside.html,
        script=beside.script,
        controls="" if picture.has_path and len(shown) > 1 else "hidden",
    )


def _compass(picture: Picture) -> list[dict[str, Any]]:
    """The arrows of the page's compass, which turns with the scene: the world's axes and gravity."""
    arrows = [
        {"name": name, "colour": colour, "arm": np.eye(3)[index].tolist()}
        for index, (name, colour) in enumerate(AXIS_COLOURS.items())
    ]
    direction = gravity_direction(picture)
    if direction is not None:
        arrows.append({"name": gravity_label(picture), "colour": GRAVITY_COLOUR, "arm": (1.2 * direction).tolist()})
    return arrows


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
    """Returns JSON that may stand inside a script element; arrays become plotly.js's typed arrays."""
    return json.dumps(value, allow_nan=False, default=_typed_array).replace("<", "\\u003c")


def _typed_array(value: Any) -> dict[str, str]:
    """Returns an array in single precision as plotly.js reads it: the kind of number, and the bytes in base 64."""
    array = np.ascontiguousarray(value)
    kind = "i4" if np.issubdtype(array.dtype, np.integer) else "f4"
    return {"dtype": kind, "bdata": base64.b64encode(array.astype(f"<{kind}").tobytes()).decode("ascii")}
