"""Shortfalls: what a rejected configuration lacks, told by disk, mesh and parts of the required clearance."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.planning.validity import CAUSES, Cause, ValidityChecker

_TOUCHES = (Cause.OBSTACLE, Cause.CAVITY)


def describe_shortfall(checker: ValidityChecker, row: FloatArray) -> str:
    """Returns why a configuration, shape (dimension,), is rejected and what is missing; empty when it is valid.

    A contact names part and mesh, what the body alone keeps there, and what is required: the clearance asked for and
    the shape model's error bound.
    """
    problem = checker.explain(row)
    if not problem:
        return ""
    shapes = checker.shapes(row[None])
    scene = checker.scene
    if shapes.codes[0] == 0:
        checker.collide(shapes)
    if CAUSES[shapes.codes[0] - 1] not in _TOUCHES or not hasattr(scene, "with_margins"):
        return problem
    margins = np.asarray(scene.body.margins)  # type: ignore[attr-defined]
    bound = np.asarray(checker.model.error_bound)
    kept = float(scene.clearance(shapes.positions, shapes.rotations)[0])
    has = f"the body alone has {_mm(kept)} there" if kept > 0.0 else f"the body alone is {_mm(-kept)} too deep"
    needs = f"{_mm(float(margins.max()))} are required"
    if bound.max() > 0.0:
        clearance = float((margins - bound).max())
        needs += f", {_mm(clearance)} of clearance and up to {_mm(float(bound.max()))} for the model's error bound"
        bare = scene.with_margins(np.maximum(margins - bound, 0.0))
        if bare.check(shapes.positions, shapes.rotations)[0] == 0:
            needs += "; only the error bound forbids it"
    return f"{problem}; {has}, {needs}"


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
