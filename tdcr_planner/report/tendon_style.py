"""How tendons are told apart in every picture: a colour and a dash each, grouped by segment, and their limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tdcr_planner.robot import RobotSpec

# The first eight from Okabe and Ito 2008 and Tol 2021, which colour-blind readers tell apart.
COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#AA4499",
    "#E69F00",
    "#56B4E9",
    "#332288",
    "#882255",
    "#8A8A00",
    "#00C2B2",
    "#7A4A2B",
    "#FF7FB0",
)
# Lengths drawn and left out in turn, in widths of the line; none for a solid line. With three or four tendons a
# segment, no two tendons of twenty segments have the same colour and dash; with any number, none of seven segments.
_DASHES: tuple[tuple[float, ...], ...] = (
    (),
    (5.0, 2.0),
    (1.2, 1.4),
    (5.0, 1.6, 1.2, 1.6),
    (9.0, 2.5),
    (5.0, 1.6, 1.2, 1.6, 1.2, 1.6),
    (2.6, 1.4),
)


class TensionLimit(NamedTuple):
    """A largest tension and the segments, counted from 1, whose tendons have it."""

    newton: float
    segments: tuple[int, ...]


def tendon_colour(index: int) -> str:
    """Returns the colour of a tendon, the same in every picture; twelve tendons have twelve colours."""
    return COLOURS[index % len(COLOURS)]


def tendon_dash(segment: int) -> tuple[float, ...]:
    """Returns the dashes of a segment's tendons in widths of the line, drawn and left out in turn; empty for solid."""
    return _DASHES[segment % len(_DASHES)]


def matplotlib_dash(segment: int) -> str | tuple[float, tuple[float, ...]]:
    """Returns matplotlib's line style for the tendons of a segment."""
    dash = tendon_dash(segment)
    return (0.0, dash) if dash else "-"


def css_dash(segment: int, width: float) -> str:
    """Returns the dashes of a segment's tendons in pixels for a line of a width in pixels; empty for solid."""
    return ",".join(f"{part * width:.1f}" for part in tendon_dash(segment))


def tension_limits(robot: RobotSpec) -> list[TensionLimit]:
    """Returns the different limits of a robot's tendons, lowest first, each with its segments."""
    limits = []
    for value in np.unique(robot.max_tensions):
        segments = np.unique(robot.tendon_segments[robot.max_tensions == value]) + 1
        limits.append(TensionLimit(float(value), tuple(segments.tolist())))
    return limits


def describe_limit(limit: TensionLimit, robot: RobotSpec) -> str:
    """Returns a limit as a label; which segments have it, where not all of them do."""
    if len(limit.segments) == robot.segment_count:
        return f"limit {limit.newton:g} N"
    runs: list[list[int]] = []
    for segment in limit.segments:
        if runs and segment == runs[-1][-1] + 1:
            runs[-1].append(segment)
        else:
            runs.append([segment])
    names = ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)
    return f"limit {limit.newton:g} N, segment{'s' if len(limit.segments) > 1 else ''} {names}"
