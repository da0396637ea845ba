"""The way into a cavity: whether the body can get in at all from where its base stands, and what is wrong where not."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.connected import connected_parts
from tdcr_planner.collision.meshes import SceneMesh, format_point
from tdcr_planner.collision.topology import signed_volumes


def obstruction(mesh: SceneMesh, base: FloatArray, body_radius: float) -> str | None:
    """Returns why no part of the body can be inside of a cavity, with advice; None where nothing forbids it for sure.

    The body hangs together from its base on. With the base outside of the closed surface, and no opening on or behind
    the entry plane, a part inside means that another one is in the wall.

    Args:
        mesh: A mesh of any role.
        base: Where the base stands, shape (3,), m, world frame.
        body_radius: Radius of the smallest disk, m.
    """
    if not mesh.keeps_inside or mesh.entry is None or mesh.entrances or mesh.contains(base[None])[0]:
        return None
    where = f"the base, at {format_point(base)}, is outside of it"
    if len(mesh.caps):
        return (
            f"as a cavity: no opening lies on or behind its entry plane, and {where}, so the body cannot get in; "
            "put the entry plane at the opening where the body enters, or the base inside"
        )
    thickness = _mean_thickness(mesh)
    remedy = "use it as an 'obstacle', or export its inner surface alone, open where the body enters"
    if thickness < body_radius or _has_passage(mesh):
        return (
            f"as a cavity: is closed and {where}; it seems to be a wall with its thickness (on average "
            f"{thickness:.3g} m), whose inside is the material; {remedy}"
        )
    return (
        f"as a cavity: is closed and {where}, so the body cannot get in; cut it open where the body enters, on or "
        f"behind the entry plane, or put the base inside (if its wall was modelled with its thickness, {remedy})"
    )


def _mean_thickness(mesh: SceneMesh) -> float:
    """Returns twice the volume by the area of a closed mesh, m: the thickness of a plate, the radius of a pipe."""
    corners = mesh.vertices[mesh.faces]
    area = 0.5 * float(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    )
    volume = signed_volumes(mesh.vertices, mesh.faces, np.zeros(len(mesh.faces), dtype=np.int64), 1, ())[0]
    return 2.0 * abs(float(volume)) / area


def _has_passage(mesh: SceneMesh) -> bool:
    """Returns whether a closed mesh has handles, as a pipe's wall has: its Euler number tells."""
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    count = len(mesh.vertices)
    pieces, _ = connected_parts(count, edges)
    return count - len(np.unique(edges, axis=0)) + len(mesh.faces) < 2 * pieces


def missed_by(mesh: SceneMesh, base: FloatArray, axis: FloatArray) -> str | None:
    """Returns how far the straight line along the base's axis misses every opening at the entry plane, or None.

    Args:
        mesh: A mesh of any role.
        base: Where the base stands, shape (3,), m, world frame.
        axis: The base's z axis, shape (3,), unit, world frame.
    """
    entry = mesh.entry
    if entry is None or not mesh.entrances or mesh.contains(base[None])[0]:
        return None
    slope = float(axis @ entry.normal)
    if slope <= 1e-6:
        return (
            "the base's z axis does not point into the cavity (it makes "
            f"{np.rad2deg(np.arccos(np.clip(slope, -1.0, 1.0))):.0f} degrees with the entry's normal)"
        )
    point = base - entry.depth(base) / slope * axis
    misses = [_outside_by(mesh.vertices[loop.edges], point, entry.normal) for loop in mesh.entrances]
    nearest = int(np.argmin(misses))
    if misses[nearest] <= 0.0:
        return None
    loop = mesh.entrances[nearest]
    return (
        f"the base's z axis meets the entry plane at {format_point(point)}, {misses[nearest]:.3g} m beside the opening "
        f"at {format_point(loop.centre)}, {loop.diameter:.3g} m across; is the base where it should be?"
    )


def _outside_by(edges: FloatArray, point: FloatArray, normal: FloatArray) -> float:
    """Returns how far a point lies outside of a rim, both seen along the normal, m; 0 within it.

    Args:
        edges: The rim, shape (e, 2, 3), m.
        point: Shape (3,), m.
        normal: Shape (3,), unit.
    """
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    flat = (edges - point) @ np.stack([first, np.cross(normal, first)], axis=1)
    begin, end = flat[:, 0], flat[:, 1]
    crosses = (begin[:, 1] > 0.0) != (end[:, 1] > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = begin[:, 0] - begin[:, 1] * (end[:, 0] - begin[:, 0]) / (end[:, 1] - begin[:, 1])
    if int((crosses & (at > 0.0)).sum()) % 2:
        return 0.0
    way = end - begin
    length = np.einsum("ei,ei->e", way, way)
    share = np.clip(-np.einsum("ei,ei->e", begin, way) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    return float(np.linalg.norm(begin + share[:, None] * way, axis=1).min())
