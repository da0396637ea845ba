"""How tendons are told apart in every picture: a colour and a dash each, grouped by segment, and their limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

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


def matplotlib_dash(segment: int) -> Literal["-"] | tuple[float, tuple[float, ...]]:
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


def limit_labels(robot: RobotSpec, apart_n: float) -> list[tuple[float, str]]:
    """Returns labels of a robot's limits and the tension at which each stands, lowest first.

    Args:
        robot: The robot.
        apart_n: Limits that follow each other within this, N, share a label at the highest of them.
    """
    groups: list[list[TensionLimit]] = []
    for limit in tension_limits(robot):
        if groups and limit.newton - groups[-1][-1].newton < apart_n:
            groups[-1].append(limit)
        else:
            groups.append([limit])
    return [(group[-1].newton, describe_limits(group, robot)) for group in groups]


def describe_limits(limits: Sequence[TensionLimit], robot: RobotSpec) -> str:
    """Returns one or more limits as a label; which segments have them, where not all do."""
    low, high = limits[0].newton, limits[-1].newton
    text = f"limit {low:g} N" if len(limits) == 1 else f"limits {low:g} to {high:g} N"
    segments = sorted(segment for limit in limits for segment in limit.segments)
    if len(segments) == robot.segment_count:
        return text
    runs: list[list[int]] = []
    for segment in segments:
        if runs and segment == runs[-1][-1] + 1:
            runs[-1].append(segment)
        else:
            runs.append([segment])
    names = ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)
    return f"{text}, segment{'s' if len(segments) > 1 else ''} {names}"
