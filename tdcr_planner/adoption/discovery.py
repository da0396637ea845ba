"""Finding a foreign network's convention by the names and shapes of what it takes and gives, and by what it answers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from pydantic import ValidationError

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError, UnknownNameError
from tdcr_planner.learning.dataset import SolvedCases
from tdcr_planner.learning.judge import body_errors
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.convention import WIDTHS, Convention, InputName, OutputName, answer_width, decode, encode
from tdcr_planner.shape.foreign_network import ForeignNetwork

_INPUT_NAMES: dict[InputName, tuple[str, ...]] = {
    "tensions": ("tensions", "tension", "tau", "tendon_tensions", "tendon_forces"),
    "bending": ("bending", "bending_vector", "bending_vectors", "bending_n"),
    "gravity": ("gravity", "g", "gravity_vector", "gravity_m_s2"),
    "tip_force": ("tip_force", "force", "f", "f_tip", "external_force", "tip_force_n"),
    "arc_length": ("arc_length", "arc_lengths", "s"),
}
_OUTPUT_NAMES: dict[OutputName, tuple[str, ...]] = {
    "positions": ("positions", "position", "p", "points", "xyz", "centres", "centers"),
    "rotations": ("rotations", "rotation", "r", "rotation_matrices", "orientations"),
    "poses": ("poses", "pose", "t", "transforms", "transformations"),
    "quaternions_wxyz": ("quaternions_wxyz", "quaternions", "quaternion", "quat", "q"),
    "quaternions_xyzw": ("quaternions_xyzw",),
    "rotations_6d": ("rotations_6d", "rotation_6d", "r6d"),
    "rotation_vectors": ("rotation_vectors", "rotation_vector", "theta"),
}
# What one argument without a telling name may hold, and what one answer may.
_JOINED_INPUTS: tuple[tuple[InputName, ...], ...] = tuple(
    (actuation, *loads)
    for actuation in ("tensions", "bending")
    for loads in ((), ("gravity",), ("tip_force",), ("gravity", "tip_force"), ("tip_force", "gravity"))
)
_ROTATIONS: tuple[OutputName, ...] = (
    "rotations", "rotation_vectors", "quaternions_wxyz", "quaternions_xyzw", "rotations_6d",
)  # fmt: skip
_STATES = 5  # asked for shapes; a prime that no robot's numbers are multiples of by chance


@dataclass(frozen=True)
class Given:
    """What the user says of a network's convention; the rest is found.

    Attributes:
        inputs: See `Convention.inputs`.
        outputs: See `Convention.outputs`.
        others: Other fields of `Convention`, by name.
    """

    inputs: tuple[InputName, ...] | None = None
    outputs: tuple[OutputName, ...] | None = None
    others: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Found:
    """A convention that a network answers to.

    Attributes:
        convention: The convention.
        error: Median error of the tip's disk on the cases, m.
    """

    convention: Convention
    error: float


def check_names(name: str, given: str, kind: Literal["inputs", "outputs"]) -> tuple[Any, ...]:
    """Returns names given with commas between them.

    Raises:
        UnknownNameError: One is none of those that are known.
        InputError: One is there twice, or those are missing without which there is no shape.
    """
    known = get_args(InputName) if kind == "inputs" else get_args(OutputName)
    names = tuple(part.strip() for part in given.split(","))
    for part in names:
        if part not in known:
            raise UnknownNameError(name, part, known)
    needed = ("tensions", "bending") if kind == "inputs" else ("positions", "poses")
    if not set(needed) & set(names) or len(set(names)) != len(names):
        raise InputError(name, f"{' or '.join(needed)} among them, and each once", given)
    return names


def find_convention(network: ForeignNetwork, robot: RobotSpec, given: Given, solved: SolvedCases) -> Found:
    """Returns the convention under which a network's answers are nearest to the reference's.

    Args:
        network: The network.
        robot: The robot.
        given: What is known of it.
        solved: A few cases with their shapes.

    Raises:
        InputError: It answers to no convention for this robot; says what it takes and gives.
    """
    problems: list[str] = []
    found: list[Found] = []
    for inputs, joined in _input_candidates(network, robot, given):
        found += _answering(network, robot, given, solved, inputs, joined, problems)
    if found:
        return min(found, key=lambda one: one.error)
    takes = ", ".join(network.arguments) or "nothing"
    raise InputError(
        "network",
        f"one that answers for robot {robot.name!r} of {robot.tendon_count} tendons and {robot.disk_count} disks, base "
        "included; say what it takes and gives with --inputs and --outputs",
        f"one that takes {takes}: {problems[-1] if problems else 'no known inputs'}",
    )


def convention_error(network: ForeignNetwork, robot: RobotSpec, convention: Convention, solved: SolvedCases) -> float:
    """Returns the median error of the tip's disk under a convention, m, as `body_errors` measures it; inf for NaN.

    Raises:
        InputError: The network does not answer to it.
    """
    positions, rotations = ask(network, robot, convention, solved)
    if not (np.isfinite(positions).all() and np.isfinite(rotations).all()):
        return float("inf")
    return float(np.median(body_errors(robot, positions, rotations, solved)[:, -1]))


def ask(
    network: ForeignNetwork, robot: RobotSpec, convention: Convention, solved: SolvedCases
) -> tuple[FloatArray, FloatArray]:
    """Returns a network's positions and rotations of solved cases; see `decode`."""
    cases = solved.cases
    answers = network(encode(convention, robot, cases.tensions, cases.gravity, cases.tip_force))
    return decode(convention, robot, len(cases), list(answers.values()))


def _input_candidates(
    network: ForeignNetwork, robot: RobotSpec, given: Given
) -> Iterator[tuple[tuple[InputName, ...], bool]]:
    """Yields what the network may take, and whether side by side in one argument."""
    arguments = network.arguments
    if given.inputs is not None:
        if len(arguments) == len(given.inputs):
            yield given.inputs, False
        if len(arguments) == 1:
            yield given.inputs, True
        return
    by_name = [_named(argument, _INPUT_NAMES) for argument in arguments]
    if all(by_name) and by_name and {"tensions", "bending"} & set(by_name):
        yield tuple(by_name), False
        return
    if len(arguments) == 1:
        with_arc = [
            combination
            for inputs in _JOINED_INPUTS
            for combination in ((("arc_length", *inputs)), ((*inputs, "arc_length")))
        ]
        for inputs in (*_JOINED_INPUTS, *with_arc):
            width = sum(
                {"tensions": robot.tendon_count, "bending": 2 * robot.segment_count, "arc_length": 1}.get(name, 3)
                for name in inputs
            )
            if network.widths[0] in (None, width):
                yield inputs, True
        return
    # Names that say nothing: tensions first, the loads in their order.
    for inputs in _JOINED_INPUTS:
        if len(inputs) == len(arguments):
            yield inputs, False


def _named(name: str, table: dict[Any, tuple[str, ...]]) -> Any:
    plain = name.lower().removesuffix(".1")
    return next((known for known, names in table.items() if plain in names), None)


def _answering(
    network: ForeignNetwork,
    robot: RobotSpec,
    given: Given,
    solved: SolvedCases,
    inputs: tuple[InputName, ...],
    joined: bool,
    problems: list[str],
) -> list[Found]:
    """Returns the conventions with some inputs that the network answers to."""
    found: list[Found] = []
    few = SolvedCases(
        solved.cases.take(slice(0, _STATES)),
        solved.base_moment[:_STATES],
        solved.positions[:_STATES],
        solved.rotations[:_STATES],
        _STATES,
    )
    bases = (given.others["with_base"],) if "with_base" in given.others else (True, False)
    numbers = (given.others["number"],) if "number" in given.others else network.numbers
    for number, with_base in itertools.product(numbers, bases):
        try:
            start = Convention(
                inputs=inputs,
                inputs_joined=joined,
                rows="points" if "arc_length" in inputs else "states",
                outputs=("positions",),
                **(
                    {"tendon_order": tuple(range(1, robot.tendon_count + 1))}
                    | given.others
                    | {"number": number, "with_base": with_base}
                ),
            )
            cases = few.cases
            answers = network(encode(start, robot, cases.tensions, cases.gravity, cases.tip_force))
        except ValidationError as error:
            raise InputError("convention", "one that fits together", error.errors()[0]["msg"]) from error
        except InputError as error:
            problems.append(str(error.got))
            continue
        disks = robot.disk_count - (0 if with_base else 1)
        for outputs, outputs_joined in _output_candidates(answers, disks, given):
            try:
                convention = start.model_copy(update={"outputs": outputs, "outputs_joined": outputs_joined})
                decode(convention, robot, _STATES, list(answers.values()))
                found.append(Found(convention, convention_error(network, robot, convention, solved)))
            except InputError as error:
                problems.append(str(error))
        if not found:
            shapes = ", ".join(f"{name} {value.dtype} {value.shape}" for name, value in answers.items())
            problems.append(f"for {_STATES} states it gives {shapes}")
        elif number == numbers[0] and not joined:
            break
    return found


def _output_candidates(
    answers: dict[str, Any], disks: int, given: Given
) -> Iterator[tuple[tuple[OutputName, ...], bool]]:
    """Yields what answers may be, and whether side by side in one of them."""
    if given.outputs is not None:
        yield given.outputs, False
        if len(answers) == 1 and len(given.outputs) > 1:
            yield given.outputs, True
        return
    named = [_named(name, _OUTPUT_NAMES) for name in answers]
    if {"positions", "poses"} & set(named):
        yield tuple(name or "ignored" for name in named), False
        return
    widths = [answer_width(np.shape(answer), _STATES, disks) or 0 for answer in answers.values()]
    kinds = [[name for name, width in WIDTHS.items() if width == found] or ["ignored"] for found in widths]
    for outputs in itertools.islice(itertools.product(*kinds), 64):
        places = [name for name in outputs if name in ("positions", "poses")]
        turns = [name for name in outputs if name in _ROTATIONS]
        if len(places) == 1 and len(turns) <= (0 if places == ["poses"] else 1):
            yield outputs, False  # type: ignore[misc]
    if len(answers) == 1:
        for rotation in _ROTATIONS:
            if widths[0] == 3 + WIDTHS[rotation]:
                yield ("positions", rotation), True
            elif widths[0] > 3 + WIDTHS[rotation]:
                yield ("positions", rotation, "ignored"), True
