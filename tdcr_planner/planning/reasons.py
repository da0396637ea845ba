"""Reasons: what a rejected state meets, and which part of the required distance is missing."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdcr_planner.arrays import FloatArray


def contact_reason(scene: Any, error_bound: FloatArray, positions: FloatArray, rotations: FloatArray) -> str:
    """Returns a sentence on what one state's body meets: a contact of the body, or a distance below the required one.

    Args:
        scene: The scene with the body grown by its margins; see `tdcr_planner.collision.scene.CollisionScene`. Of a
            scene that cannot tell the body from its margins only the first contact is named.
        error_bound: The part of the margins that is the shape model's error bound, shape (d,), m.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).

    Returns:
        The sentence; empty where the scene names no contact.
    """
    contact = scene.first_contact(positions, rotations)
    if contact is None or not hasattr(scene, "with_margins"):
        return "" if contact is None else str(contact)
    bare = scene.with_margins(np.zeros(len(positions)))
    touching = bare.first_contact(positions, rotations)
    if touching is not None:
        return str(touching)
    body = scene.body
    bounds = body.part_margins(error_bound)
    if contact.triangle < 0:
        part = body.part_names.index(contact.part.split(" and ")[0])
        each = _required(scene.prover.required[part], bounds[part])
        return f"{contact.part} are nearer to each other than each must keep: {each}"
    part, mesh, distance = scene.prover.nearest(positions, rotations)
    required = _required(scene.prover.required[part], bounds[part])
    reason = f"{body.part_names[part]} is {1e3 * distance:.2f} mm from {scene.meshes[mesh].name}; required {required}"
    if distance >= scene.prover.required[part]:
        reason += ", kept on all sides of a cylinder, whose edge then reaches farther"
    return reason


def _required(margin: float, bound: float) -> str:
    """Returns a margin with the parts that it is made of, m, as text."""
    clearance = max(margin - bound, 0.0)
    parts = f" = {1e3 * clearance:.2f} clearance + {1e3 * bound:.2f} model error bound" if bound > 0.0 else " clearance"
    return f"{1e3 * margin:.2f} mm{parts}"
