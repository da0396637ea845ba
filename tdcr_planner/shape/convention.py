"""The convention of a foreign network: what it takes and gives, in which order, units and frame, and back to ours."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.files import FileModel
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import rotation_from_quaternion, rotation_from_vector
from tdcr_planner.shape.tangents import rotations_along

InputName = Literal["tensions", "bending", "gravity", "tip_force", "arc_length"]
OutputName = Literal[
    "positions", "rotations", "poses", "quaternions_wxyz", "quaternions_xyzw", "rotations_6d", "rotation_vectors",
    "ignored",
]  # fmt: skip
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
FORCES = {"N": 1.0, "mN": 0.001}
# Numbers a disk of each output; "ignored" has any.
WIDTHS = {
    "positions": 3, "rotations": 9, "poses": 16, "quaternions_wxyz": 4, "quaternions_xyzw": 4, "rotations_6d": 6,
    "rotation_vectors": 3,
}  # fmt: skip
_ORTHOGONAL = 1e-6  # beyond it a matrix is replaced by the nearest rotation


class Convention(FileModel):
    """How a foreign network is asked and what it answers.

    Attributes:
        inputs: What it takes, in order. "bending": the bending vector of each segment, x and y, in the unit of force.
        inputs_joined: Whether all of them stand side by side in one argument.
        rows: "states": a row a state, all disks in the answer; "points": a row a disk of a state, with its arc length.
        outputs: What it gives, in order. "rotations_6d": the first two columns of the rotation, one after the other.
        outputs_joined: Whether all of them stand side by side in one answer; what follows them there is left out.
        with_base: Whether the answer has the base as its first disk.
        length_unit: Unit of positions and arc lengths.
        force_unit: Unit of tensions, bending vectors and tip force.
        tendon_order: For each of the network's tendons the robot's, counted from 1.
        base_quaternion_wxyz: The robot's base frame as the network's frame has it (network_from_base).
        transposed: Whether rotations are disk_from_base.
        disk_order: Order of the disks in the answer.
        number: Type of number that it takes.
    """

    inputs: Annotated[tuple[InputName, ...], Field(min_length=1)]
    inputs_joined: bool = False
    rows: Literal["states", "points"] = "states"
    outputs: Annotated[tuple[OutputName, ...], Field(min_length=1)]
    outputs_joined: bool = False
    with_base: bool = True
    length_unit: Literal["m", "cm", "mm"] = "m"
    force_unit: Literal["N", "mN"] = "N"
    tendon_order: tuple[Annotated[int, Field(ge=1)], ...]
    base_quaternion_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    transposed: bool = False
    disk_order: Literal["base_to_tip", "tip_to_base"] = "base_to_tip"
    number: Literal["float32", "float64"] = "float64"

    @model_validator(mode="after")
    def _check_consistency(self) -> Convention:
        if len(set(self.inputs)) != len(self.inputs):
            raise ValueError(f"inputs: expected each once, got {', '.join(self.inputs)}")
        if ("arc_length" in self.inputs) != (self.rows == "points"):
            raise ValueError("inputs: arc_length goes with rows 'points', and rows 'points' with arc_length")
        if not {"tensions", "bending"} & set(self.inputs):
            raise ValueError(f"inputs: expected tensions or bending among them, got {', '.join(self.inputs)}")
        if not {"positions", "poses"} & set(self.outputs):
            raise ValueError(f"outputs: expected positions or poses among them, got {', '.join(self.outputs)}")
        if sorted(self.tendon_order) != list(range(1, len(self.tendon_order) + 1)):
            raise ValueError(f"tendon_order: expected each tendon once, got {list(self.tendon_order)}")
        if self.outputs_joined and "ignored" in self.outputs[:-1]:
            raise ValueError("outputs: of one joined answer only the end can be ignored")
        if not 0.9 < sum(value**2 for value in self.base_quaternion_wxyz) < 1.1:
            raise ValueError(f"base_quaternion_wxyz: expected length 1, got {list(self.base_quaternion_wxyz)}")
        return self

    def input_width(self, robot: RobotSpec, name: InputName) -> int:
        """Returns how many columns an input has."""
        widths = {"tensions": robot.tendon_count, "bending": 2 * robot.segment_count, "arc_length": 1}
        return widths.get(name, 3)

    def describe(self) -> str:
        """Returns the convention as a line or two."""
        joined = " side by side" if self.inputs_joined and len(self.inputs) > 1 else ""
        lines = [
            f"takes {', '.join(self.inputs)}{joined} in {self.force_unit} and {self.length_unit}, {self.number}, "
            f"a row a {self.rows.removesuffix('s')}",
            f"gives {', '.join(self.outputs)}{' side by side' if self.outputs_joined else ''}, "
            f"{'with' if self.with_base else 'without'} the base, {self.disk_order.replace('_', ' ')}",
        ]
        if self.tendon_order != tuple(range(1, len(self.tendon_order) + 1)):
            lines.append("its tendons are the robot's " + ", ".join(map(str, self.tendon_order)))
        if self.base_quaternion_wxyz != (1.0, 0.0, 0.0, 0.0):
            lines.append("its base frame is turned by the quaternion " + ", ".join(map(str, self.base_quaternion_wxyz)))
        if self.transposed:
            lines.append("its rotations are transposed")
        return "\n".join(lines)


def encode(
    convention: Convention, robot: RobotSpec, tensions: FloatArray, gravity: FloatArray, tip_force: FloatArray
) -> list[Any]:
    """Returns the arguments of a network for a batch of states.

    Args:
        convention: The network's convention.
        robot: The robot.
        tensions: Shape (n, t), N.
        gravity: Shape (n, 3), m/s^2, base frame.
        tip_force: Shape (n, 3), N, base frame.
    """
    per_force = 1.0 / FORCES[convention.force_unit]
    turn = rotation_from_quaternion(np.array(convention.base_quaternion_wxyz))
    columns: list[FloatArray] = []
    for name in convention.inputs:
        if name == "tensions":
            columns.append(tensions[:, np.array(convention.tendon_order) - 1] * per_force)
        elif name == "bending":
            bending = robot.bending_from_tensions(tensions) @ turn[:2, :2].T
            columns.append(bending.reshape(len(tensions), -1) * per_force)
        elif name == "gravity":
            columns.append(gravity @ turn.T)
        elif name == "tip_force":
            columns.append(tip_force @ turn.T * per_force)
        else:
            columns.append(np.empty((len(tensions), 0)))
    if convention.rows == "points":
        stops = robot.arc_lengths if convention.with_base else robot.arc_lengths[1:]
        arc_lengths = np.tile(stops / LENGTHS[convention.length_unit], len(tensions))[:, None]
        columns = [
            arc_lengths if name == "arc_length" else np.repeat(column, len(stops), axis=0)
            for name, column in zip(convention.inputs, columns, strict=True)
        ]
    if convention.inputs_joined:
        columns = [np.concatenate(columns, axis=1)]
    return [np.ascontiguousarray(column, dtype=convention.number) for column in columns]


def decode(convention: Convention, robot: RobotSpec, count: int, answers: list[Any]) -> tuple[FloatArray, FloatArray]:
    """Returns positions (n, d, 3), m, and rotations (n, d, 3, 3), base frame, of a network's answers.

    Where it gives positions alone, the rotations follow the curve through them without twist.

    Args:
        convention: The network's convention.
        robot: The robot.
        count: How many states were asked.
        answers: The network's answers.

    Raises:
        InputError: An answer is of another shape or type than the convention says.
    """
    disks = robot.disk_count - (0 if convention.with_base else 1)
    parts = _split(convention, count, disks, answers)
    positions = parts.get("positions")
    rotations: FloatArray | None = None
    if "poses" in parts:
        poses = parts["poses"].reshape(count, disks, 4, 4)
        positions, rotations = poses[..., :3, 3], poses[..., :3, :3]
    elif "rotations" in parts:
        rotations = parts["rotations"].reshape(count, disks, 3, 3)
    elif "quaternions_wxyz" in parts:
        rotations = _from_quaternions(parts["quaternions_wxyz"])
    elif "quaternions_xyzw" in parts:
        rotations = _from_quaternions(parts["quaternions_xyzw"][..., [3, 0, 1, 2]])
    elif "rotations_6d" in parts:
        rotations = _from_columns(parts["rotations_6d"])
    elif "rotation_vectors" in parts:
        rotations = rotation_from_vector(parts["rotation_vectors"])
    assert positions is not None  # the convention names positions or poses
    turn = rotation_from_quaternion(np.array(convention.base_quaternion_wxyz))
    positions = positions * LENGTHS[convention.length_unit] @ turn
    if rotations is not None:
        rotations = np.swapaxes(rotations, -1, -2) if convention.transposed else rotations
        rotations = turn.T @ _orthogonal(rotations) @ turn
    if convention.disk_order == "tip_to_base":
        positions = positions[:, ::-1]
        rotations = None if rotations is None else rotations[:, ::-1]
    if not convention.with_base:
        positions = np.concatenate([np.zeros((count, 1, 3)), positions], axis=1)
        if rotations is not None:
            rotations = np.concatenate([np.broadcast_to(np.eye(3), (count, 1, 3, 3)), rotations], axis=1)
    if rotations is None:
        rotations = rotations_along(robot.arc_lengths, positions)
    return np.ascontiguousarray(positions), np.ascontiguousarray(rotations)


def answer_width(shape: tuple[int, ...], count: int, disks: int) -> int | None:
    """Returns how many numbers a disk an answer of a shape has; None where its axes are not those of states and disks.

    Args:
        shape: Of the answer: (n, d, ...), (n d, ...) or (n, d k).
        count: How many states n were asked.
        disks: How many disks d an answer has.
    """
    size = math.prod(shape)
    by_row = len(shape) > 0 and shape[0] == count * disks
    by_state = len(shape) > 1 and shape[0] == count and (shape[1] == disks or len(shape) == 2)
    if not (by_row or by_state) or not size or size % (count * disks):
        return None
    return size // (count * disks)


def _split(convention: Convention, count: int, disks: int, answers: list[Any]) -> dict[str, FloatArray]:
    """Returns the answers by name, each of shape (n, disks, numbers)."""
    if convention.outputs_joined:
        names = [name for name in convention.outputs if name != "ignored"]
        whole = _numbers("the joined answer", answers[0], count, disks, sum(WIDTHS[name] for name in names), more=True)
        parts: dict[str, FloatArray] = {}
        at = 0
        for name in names:
            parts[name] = whole[:, :, at : at + WIDTHS[name]]
            at += WIDTHS[name]
        return parts
    if len(answers) < len(convention.outputs):
        raise InputError("outputs", f"{len(convention.outputs)} answers of the network", f"{len(answers)}")
    return {
        name: _numbers(name, answer, count, disks, WIDTHS[name])
        for name, answer in zip(convention.outputs, answers, strict=False)
        if name != "ignored"
    }


def _numbers(name: str, answer: Any, count: int, disks: int, width: int, *, more: bool = False) -> FloatArray:
    """Returns an answer as shape (count, disks, width or, with `more`, at least that), float64."""
    array = np.asarray(answer)
    if array.dtype not in (np.float32, np.float64):
        raise InputError(name, "an answer of type float32 or float64", str(array.dtype))
    found = answer_width(array.shape, count, disks)
    if found is None or found < width or (found != width and not more):
        raise InputError(name, f"{width} numbers for each of {disks} disks of {count} states", f"shape {array.shape}")
    return array.reshape(count, disks, found).astype(np.float64)


def _from_quaternions(quaternions: FloatArray) -> FloatArray:
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        w, x, y, z = np.moveaxis(quaternions / length, -1, 0)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return np.stack(rows, axis=-1).reshape(*quaternions.shape[:-1], 3, 3)


def _from_columns(columns: FloatArray) -> FloatArray:
    """Returns rotations of their first two columns (Zhou et al. 2019, eq. 15), shape (..., 6) to (..., 3, 3)."""
    first, second = columns[..., :3], columns[..., 3:]
    with np.errstate(invalid="ignore", divide="ignore"):
        x = first / np.linalg.norm(first, axis=-1, keepdims=True)
        y = second - (x * second).sum(axis=-1, keepdims=True) * x
        y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _orthogonal(rotations: FloatArray) -> FloatArray:
    """Returns matrices that are none as the nearest rotations, by the polar decomposition; the others as they are."""
    off = np.abs(np.swapaxes(rotations, -1, -2) @ rotations - np.eye(3)).max(axis=(-1, -2))
    wrong = (off > _ORTHOGONAL) & np.isfinite(off)
    if not wrong.any():
        return rotations
    rotations = rotations.copy()
    left, _, right = np.linalg.svd(rotations[wrong])
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    rotations[wrong] = left @ right
    return rotations
