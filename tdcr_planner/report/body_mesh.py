"""The tested solids that are no disks, backbone or tendons, as triangles: the sleeve between disks and the shaft."""

from __future__ import annotations

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.body import Kind, RobotBody, Shaft, place_solids
from tdcr_planner.planning.scenario import Scenario
from tdcr_planner.report.robot_mesh import Mesh, merge_meshes, tendon_lines, tube_mesh


def tested_body(scenario: Scenario) -> RobotBody:
    """Returns the body that is tested against a scenario's meshes, without margins."""
    radius = scenario.file.base.shaft_radius_m
    shaft = None if radius is None else Shaft(radius, scenario.base_position)
    return RobotBody(scenario.robot, None, shaft)


def has_solids(body: RobotBody, kind: Kind) -> bool:
    """Returns whether a body has solids of a kind."""
    return bool((body.arrays.kind == kind).any())


def solid_ends(
    body: RobotBody, kind: Kind, positions: FloatArray, rotations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns both ends of the axis of each solid of a kind, as it is tested, base first.

    Args:
        body: The body.
        kind: Which solids.
        positions: Disk centres, shape (d, 3), m, world frame.
        rotations: world_from_disk, shape (d, 3, 3).

    Returns:
        Ends, shape (n, 2, 3), m, and radii, shape (n,), m. A shaft that is not out has both ends at the base.
    """
    chosen = np.flatnonzero(body.arrays.kind == kind)[::-1]  # the body lists its parts tip first
    arrays = [np.ascontiguousarray(array, dtype=np.float64) for array in (positions, rotations)]
    centres, frames, halves = place_solids(body.arrays, *arrays)
    reach = halves[chosen, None] * frames[chosen, :, 2]
    ends = np.stack([centres[chosen] - reach, centres[chosen] + reach], axis=1)
    ends[halves[chosen] < 0.0] = positions[0]
    return ends, body.arrays.radius[chosen]


def sleeve_mesh(body: RobotBody, positions: FloatArray, rotations: FloatArray, sides: int = 24) -> Mesh:
    """Returns the sleeve: a cylinder without end faces for each gap between disks; no triangles without a sleeve."""
    return cylinder_meshes(*solid_ends(body, Kind.SLEEVE, positions, rotations), sides)


def shaft_mesh(body: RobotBody, positions: FloatArray, rotations: FloatArray, sides: int = 24) -> Mesh:
    """Returns the shaft behind the base as a closed cylinder, all in one point where it is not out."""
    return cylinder_meshes(*solid_ends(body, Kind.SHAFT, positions, rotations), sides, closed=True)


def part_mesh(body: RobotBody, positions: FloatArray, rotations: FloatArray, part: str, room: float) -> Mesh | None:
    """Returns one part of the body, a little larger than it is so that it covers what is drawn of it.

    Args:
        body: The body.
        positions: Shape (d, 3), m.
        rotations: Shape (d, 3, 3).
        part: "disk 7", "gap 3" (what lies between disks 2 and 3) or "shaft", as contacts name them.
        room: How much larger, m.

    Returns:
        The disk, the shaft, or what is tested of the gap: its sleeve, or backbone and tendons; None for a part that
        the body does not have.
    """
    robot = body.robot
    kind, _, number = part.partition(" ")
    if kind == "shaft" and has_solids(body, Kind.SHAFT):
        ends, radii = solid_ends(body, Kind.SHAFT, positions, rotations)
        return cylinder_meshes(ends, radii + room, 24, closed=True)
    if not number.isdecimal() or not 1 <= int(number) < robot.disk_count:
        return None
    if kind == "disk":
        one = slice(int(number), int(number) + 1)
        half = (0.5 * robot.disk_thicknesses[one] + room)[:, None] * rotations[one, :, 2]
        ends = np.stack([positions[one] - half, positions[one] + half], axis=1)
        return cylinder_meshes(ends, robot.disk_radii[one] + room, 24, closed=True)
    if kind == "gap" and has_solids(body, Kind.SLEEVE):
        ends, radii = solid_ends(body, Kind.SLEEVE, positions, rotations)
        one = slice(int(number) - 1, int(number))
        return cylinder_meshes(ends[one], radii[one] + room, 24)
    if kind == "gap":
        between = slice(int(number) - 1, int(number) + 1)
        lines = [tendon[between] for tendon in tendon_lines(robot, positions, rotations) if len(tendon) > int(number)]
        tubes = [tube_mesh(line, robot.body.tendon_radius_m + 3.0 * room, sides=6) for line in lines]
        return merge_meshes([tube_mesh(positions[between], robot.backbone.radius_m + 2.0 * room), *tubes])
    return None


def cylinder_meshes(ends: FloatArray, radii: FloatArray, sides: int, *, closed: bool = False) -> Mesh:
    """Returns cylinders as one mesh.

    Args:
        ends: Ends of their axes, shape (n, 2, 3), m.
        radii: Shape (n,), m.
        sides: Corners of each rim.
        closed: Whether they have end faces.

    Returns:
        Vertices, shape (n * (2 * sides + 2), 3), m, and faces. A cylinder of no length is one point.
    """
    if not len(ends):
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    axes = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    axes = axes / np.maximum(lengths, 1e-15)
    helper = np.eye(3)[np.argmin(np.abs(axes), axis=1)]
    first = np.cross(axes, helper)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-15)
    second = np.cross(axes, first)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    ring *= np.where(lengths > 0.0, radii[:, None], 0.0)[:, None]
    vertices = np.concatenate([ends[:, :1] + ring, ends[:, 1:] + ring, ends], axis=1)
    i = np.arange(sides)
    j = (i + 1) % sides
    one = [np.stack([i, j, sides + j], axis=1), np.stack([i, sides + j, sides + i], axis=1)]
    if closed:
        low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
        one += [np.stack([low, j, i], axis=1), np.stack([high, sides + i, sides + j], axis=1)]
    faces = np.concatenate(one)[None] + (2 * sides + 2) * np.arange(len(ends))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)
