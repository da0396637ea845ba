"""Entries of the page's legend, which has room for every name: the page draws it from the traces' `meta`."""

from __future__ import annotations

from typing import Any

from tdcr_planner.report.picture import Picture
from tdcr_planner.report.tendon_style import css_dash, tendon_colour

Trace = dict[str, Any]
_SWATCH_LINE_PX = 2.0


def legend_entry(label: str, kind: str, colour: str, group: str = "", dash: str = "") -> Trace:
    """Returns a trace's entry in the page's legend.

    Args:
        label: Plain text; traces of one group and label share an entry.
        kind: "surface", "line", "ring", "diamond" or "cross".
        colour: As CSS has it.
        group: What the entry stands under; empty for the scene.
        dash: Lengths in px drawn and left out in turn; empty for a solid line.
    """
    return {"label": label, "kind": kind, "colour": colour, "group": group, "dash": dash}


def tendon_entry(picture: Picture, index: int) -> Trace:
    """Returns the entry in the legend of a tendon's line in the scene and of its curve."""
    segment = int(picture.robot.tendon_segments[index])
    dash = css_dash(segment, _SWATCH_LINE_PX)
    return legend_entry(f"{index + 1}", "line", tendon_colour(index), f"tendons of segment {segment + 1}", dash)
