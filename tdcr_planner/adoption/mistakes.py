"""Obvious mistakes of convention: which one would explain a large error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from tdcr_planner.adoption.discovery import Found, convention_error
from tdcr_planner.errors import InputError
from tdcr_planner.learning.dataset import SolvedCases
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.convention import FORCES, LENGTHS, Convention
from tdcr_planner.shape.foreign_network import ForeignNetwork

_EXPLAINS = 0.25
"""An alternative explains the error when it leaves at most this part of it."""
_AS_GOOD = 1.5
"""Alternatives within this factor of the best explain it as well: turns of a symmetric robot and orders of tendons."""
_MOST_ORDERS = 24
_TURN_DEG = 30


def explain_error(network: ForeignNetwork, robot: RobotSpec, found: Found, solved: SolvedCases) -> list[str]:
    """Returns what would explain a large error, the likeliest first, each with the option that says it; empty if none.

    Args:
        network: The network.
        robot: The robot.
        found: Its convention and error.
        solved: Cases with their shapes.
    """
    tried: list[tuple[float, str]] = []
    for text, convention in _alternatives(robot, found.convention):
        try:
            tried.append((convention_error(network, robot, convention, solved), text))
        except InputError:
            continue
    best = min((error for error, _ in tried), default=math.inf)
    if not best <= _EXPLAINS * found.error:
        return []
    good = [(error, text) for error, text in tried if error <= _AS_GOOD * best + 1e-9]
    return [f"{text} (leaves {1e3 * error:.3g} mm)" for error, text in sorted(good)]


def _alternatives(robot: RobotSpec, convention: Convention) -> Iterator[tuple[str, Convention]]:
    """Yields conventions that differ in one thing, or in the unit of length and one more."""
    singles = list(_single_changes(robot, convention))
    yield from singles
    for unit in LENGTHS:
        if unit != convention.length_unit:
            for text, changed in singles:
                if changed.length_unit == convention.length_unit:
                    yield (
                        f"lengths in {unit} (--length-unit {unit}) and {text}",
                        changed.model_copy(update={"length_unit": unit}),
                    )


def _single_changes(robot: RobotSpec, convention: Convention) -> Iterator[tuple[str, Convention]]:
    def changed(**changes: object) -> Convention:
        return convention.model_copy(update=changes)

    for unit in LENGTHS:
        if unit != convention.length_unit:
            yield f"lengths in {unit} (--length-unit {unit})", changed(length_unit=unit)
    for unit in FORCES:
        if unit != convention.force_unit:
            yield f"forces in {unit} (--force-unit {unit})", changed(force_unit=unit)
    yield "rotations transposed (--transposed)", changed(transposed=not convention.transposed)
    other = "tip_to_base" if convention.disk_order == "base_to_tip" else "base_to_tip"
    yield f"disks from {other.replace('_', ' ')} (--disk-order {other})", changed(disk_order=other)
    for name, swapped in (("wxyz", "xyzw"), ("xyzw", "wxyz")):
        if f"quaternions_{name}" in convention.outputs:
            outputs = tuple(f"quaternions_{swapped}" if "quat" in one else one for one in convention.outputs)
            yield f"quaternions as {swapped} (--outputs {','.join(outputs)})", changed(outputs=outputs)
    for order in _tendon_orders(robot):
        if order != convention.tendon_order and "tensions" in convention.inputs:
            text = ",".join(map(str, order))
            yield f"tendons in the order {text} (--tendon-order {text})", changed(tendon_order=order)
    for angle in range(_TURN_DEG, 360, _TURN_DEG):
        half = math.radians(angle) / 2.0
        quaternion = (math.cos(half), 0.0, 0.0, math.sin(half))
        yield f"base turned by {angle} degrees (--base-turn-deg {angle})", changed(base_quaternion_wxyz=quaternion)


def _tendon_orders(robot: RobotSpec) -> Iterator[tuple[int, ...]]:
    """Yields orders of the tendons: all of few, and of many those turned or reversed within each segment."""
    count = robot.tendon_count
    if math.factorial(count) <= _MOST_ORDERS:
        yield from itertools.permutations(range(1, count + 1))
        return
    segments = [np.flatnonzero(robot.tendon_segments == index) + 1 for index in range(robot.segment_count)]
    for reverse in (False, True):
        for turn in range(max(len(columns) for columns in segments)):
            order = [np.roll(columns[::-1] if reverse else columns, turn) for columns in segments]
            yield tuple(np.concatenate(order).tolist())
            yield tuple(np.concatenate(order[::-1]).tolist())
