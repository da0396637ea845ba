"""Shortfalls: what a rejected configuration lacks, told by disk, mesh and parts of the required clearance."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.causes import CAUSES, Cause
from tdcr_planner.planning.validity import ValidityChecker

_TOUCHES = (Cause.OBSTACLE, Cause.CAVITY)


def describe_shortfall(checker: ValidityChecker, row: FloatArray) -> str:
    """Returns why a configuration, shape (dimension,), is rejected and what is missing; empty when it is valid.

    Beside what `ValidityChecker.explain` says of a contact it tells how deep the body alone is in a wall, and whether
    only the shape model's error bound forbids the configuration.
    """
    problem = checker.explain(row)
    scene = checker.scene
    shapes = checker.shapes(row[None])
    if shapes.codes[0] == 0:
        checker.collide(shapes)
    cause = CAUSES[shapes.codes[0] - 1] if shapes.codes[0] else None
    if cause not in _TOUCHES or not hasattr(scene, "with_margins"):
        return problem
    kept = float(scene.clearance(shapes.positions, shapes.rotations)[0])
    margin = float(np.max(scene.body.margins))  # type: ignore[attr-defined]
    if kept < 0.0:
        return f"{problem}; the body alone is {_mm(-kept)} too deep, and {_mm(margin)} are required"
    if count_free_without_bound(checker, row[None]) and checker.model.error_bound.max() > 0.0:
        return f"{problem}; only the model's error bound forbids it"
    return problem


def count_free_without_bound(checker: ValidityChecker, rows: FloatArray) -> int:
    """Returns how many configurations (n, dimension) would be free if the shape model had no error bound."""
    scene = checker.scene
    if not len(rows) or not hasattr(scene, "with_margins"):
        return 0
    positions, rotations, solved = checker.world_poses(rows)
    margins = np.asarray(scene.body.margins) - np.asarray(checker.model.error_bound)  # type: ignore[attr-defined]
    bare = scene.with_margins(np.maximum(margins, 0.0))
    return int((bare.check(positions[solved], rotations[solved]) == 0).sum())


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g} mm"
