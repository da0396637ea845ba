"""The bending map: from a bending vector a segment to the tensions or displacements of its tendons, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from tdcr_planner.arrays import FloatArray, IntArray, check_array
from tdcr_planner.errors import InputError
from tdcr_planner.robot.paths import PolarPath
from tdcr_planner.robot.segments import widest_gap

if TYPE_CHECKING:
    from tdcr_planner.robot.spec import RobotSpec


def straight_paths(robot: RobotSpec) -> list[PolarPath]:
    """Returns the path of every tendon, all of which must be straight.

    Raises:
        InputError: Names the first tendon that is not straight, and what to use instead.
    """
    paths = []
    for index, tendon in enumerate(robot.tendons):
        path = tendon.straight_path
        if path is None:
            raise InputError(
                f"robot {robot.name!r}",
                "straight tendons, each at one angle and radius",
                f"tendon {index + 1} ({', '.join(sorted(tendon.path.kinds))}); robot.tendons has the path of any, and "
                "tensions or displacements of each tendon take the place of a bending vector",
            )
        paths.append(path)
    return paths


def segment_circles(robot: RobotSpec) -> tuple[tuple[IntArray, float], ...]:
    """Returns the tendons that end in each segment, and the radius of the circle on which they stand.

    Raises:
        InputError: A segment's tendons are not straight, not on one circle, or do not surround the backbone.
    """
    straight_paths(robot)
    circles = []
    for index in range(robot.segment_count):
        columns = np.flatnonzero(robot.tendon_segments == index)
        name, wanted = f"segment {index + 1} of robot {robot.name!r}", "three or more tendons around the backbone"
        instead = "give tensions or displacements a tendon in place of a bending vector"
        if len(columns) < 3:
            raise InputError(name, wanted, f"{len(columns)}; {instead}")
        gap = widest_gap(tuple(np.rad2deg(robot.tendon_angles[columns])))
        if gap >= 180.0 - 1e-6:
            raise InputError(name, wanted, f"a gap of {gap:g} degrees between neighbours; {instead}")
        radii = robot.tendon_radii[columns]
        if np.ptp(radii) > 1e-9 * radii.max():
            low, high = radii.min(), radii.max()
            raise InputError(name, "tendons on one circle", f"distances from {low:g} to {high:g} m; {instead}")
        circles.append((columns, float(radii[0])))
    return tuple(circles)


def tensions_from_bending(robot: RobotSpec, bending: ArrayLike) -> FloatArray:
    """Returns the tensions of least sum that produce a bending vector; see `RobotSpec.tensions_from_bending`."""
    array = check_array("bending", bending, (None, robot.segment_count, 2))
    tensions = np.tile(robot.pretensions, (len(array), 1))
    for index, (columns, _) in enumerate(robot.segment_circles):
        order = columns[np.argsort(np.mod(robot.tendon_angles[columns], 2.0 * np.pi), kind="stable")]
        angles = np.mod(robot.tendon_angles[order], 2.0 * np.pi)
        x, y = array[:, index, 0], array[:, index, 1]
        direction = np.mod(np.arctan2(y, x), 2.0 * np.pi)
        left = (np.searchsorted(angles, direction, side="right") - 1) % len(order)
        right = (left + 1) % len(order)
        sine = np.sin(angles[right] - angles[left])
        first = (x * np.sin(angles[right]) - y * np.cos(angles[right])) / sine
        second = (y * np.cos(angles[left]) - x * np.sin(angles[left])) / sine
        rows = np.arange(len(array))
        np.add.at(tensions, (rows, order[left]), np.maximum(first, 0.0))
        np.add.at(tensions, (rows, order[right]), np.maximum(second, 0.0))
    return tensions


def bending_from_tensions(robot: RobotSpec, tensions: ArrayLike) -> FloatArray:
    """Returns the bending vectors of tensions; see `RobotSpec.bending_from_tensions`."""
    array = robot.check_tensions(tensions)
    directions = np.stack([np.cos(robot.tendon_angles), np.sin(robot.tendon_angles)], axis=1)
    bending = np.zeros((len(array), robot.segment_count, 2))
    for index in range(robot.segment_count):
        columns = robot.tendon_segments == index
        bending[:, index] = array[:, columns] @ directions[columns]
    return bending


def displacements_from_bending(robot: RobotSpec, bending: ArrayLike, *, compensated: bool) -> FloatArray:
    """Returns the tendon displacements of a bending vector.

    A segment that bends as an arc shortens the way of a tendon at radius r and angle a by
    (r / r_k) b_k . (cos a, sin a), b_k being the segment's bending vector at its own circle of radius r_k.

    Args:
        robot: The robot, with straight tendons.
        bending: Shape (n, segments, 2), m at the tendon circle, base x and y.
        compensated: Whether a tendon also follows what the segments that it passes take of it, so that each segment
            bends by its own vector alone; else each tendon follows the segment alone in which it ends.

    Returns:
        Shape (n, t), m; released tendons are negative.

    Raises:
        InputError: The shape is wrong, tendons are not straight, or a segment passed has no circle of tendons.
    """
    array = check_array("bending", bending, (None, robot.segment_count, 2))
    directions = np.stack([np.cos(robot.tendon_angles), np.sin(robot.tendon_angles)], axis=1)
    displacements = np.einsum("ntk,tk->nt", array[:, robot.tendon_segments], directions)
    if not compensated or robot.segment_count == 1:
        return np.asarray(displacements)
    for index, (_, radius) in enumerate(robot.segment_circles):
        passing = robot.tendon_segments > index
        lever = robot.tendon_radii[passing, None] / radius * directions[passing]
        displacements[:, passing] += array[:, index] @ lever.T
    return np.asarray(displacements)
