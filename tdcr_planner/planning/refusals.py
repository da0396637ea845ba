"""Refusals: what makes a query impossible before anything is searched, and what most likely does."""

from __future__ import annotations

import numpy as np

from tdcr_planner.planning.scenario import Goal
from tdcr_planner.planning.validity import ValidityChecker

_BEHIND_ENTRY_M = 1e-4  # how far behind an entry plane its opening is asked about


def impossible_tip(checker: ValidityChecker, goal: Goal) -> str:
    """Returns why no tip can be where a goal wants it, whatever the shape; empty where none is known.

    The ball inscribed in the last disk, grown by the required margin, must fit around a point within the tolerance.

    Args:
        checker: The validity checker; without a scene that knows distances of points nothing is told.
        goal: The goal; a configuration is never refused here.
    """
    scene = checker.scene
    if goal.tip_position_m is None or not hasattr(scene, "nearest_mesh"):
        return ""
    distance, mesh = scene.nearest_mesh(goal.tip_position_m)
    robot = checker.robot
    inscribed = float(min(robot.disk_radii[-1], 0.5 * robot.disk_thicknesses[-1]))
    margin = float(scene.body.margins[-1])  # type: ignore[attr-defined]
    missing = inscribed + margin - (distance + goal.tip_tolerance_m)
    if missing <= 0.0:
        return ""
    place = ", ".join(f"{value:g}" for value in goal.tip_position_m)
    where = f"{_mm(-distance)} on the wrong side of" if distance < 0.0 else f"{_mm(distance)} from"
    return (
        f"the tip position ({place}) m lies {where} {mesh}; "
        f"the middle of the last disk needs {_mm(inscribed + margin)} ({_mm(inscribed)} of body, "
        f"{_mm(margin)} of margin), which with the tolerance of {_mm(goal.tip_tolerance_m)} lacks {_mm(missing)}"
    )


def missed_entries(checker: ValidityChecker) -> str:
    """Returns which cavities' entries the base's axis passes by, and how far; empty where it meets all of them.

    A robot may bend into an entry that its base does not face, so this forbids nothing; where no goal state is found it
    most likely is the reason.
    """
    scene = checker.scene
    if not hasattr(scene, "nearest_mesh"):
        return ""
    position, rotation, _, _ = checker.space.world
    axis = rotation[:, 2]
    told = []
    for mesh in scene.meshes:  # type: ignore[attr-defined]
        if mesh.entry is None:
            continue
        along = float(axis @ mesh.entry.normal)
        ahead = float((mesh.entry.point - position) @ mesh.entry.normal)
        if along <= 1e-6 or ahead < 0.0:
            continue
        crossing = position + axis * ahead / along + _BEHIND_ENTRY_M * np.asarray(mesh.entry.normal)
        distance, name = scene.nearest_mesh(crossing)
        if distance < 0.0 and name == mesh.name:
            told.append(f"the base's axis meets the entry plane of {name} {_mm(-distance)} outside of its opening")
    return "; ".join(told)


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g} mm"
