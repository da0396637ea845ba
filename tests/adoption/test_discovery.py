"""Conventions are found by names, shapes and answers; mistakes and faults are named."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdcr_planner.adoption.discovery import Found, Given, ask, check_names, find_convention
from tdcr_planner.adoption.faults import check_faults
from tdcr_planner.adoption.mistakes import explain_error
from tdcr_planner.errors import InputError
from tdcr_planner.learning.dataset import SolvedCases, draw_cases, solve_cases
from tdcr_planner.robot import RobotSpec
from tdcr_planner.se3 import rotation_distance
from tdcr_planner.shape.card import Domain
from tdcr_planner.shape.foreign_network import ForeignNetwork, load_network

Load = Callable[[Any], ForeignNetwork]


@pytest.fixture(scope="module")
def solved(paper_robot: RobotSpec) -> SolvedCases:
    domain = Domain(max_tension_n=tuple(paper_robot.max_tensions), gravity_m_s2=0.0, tip_force_n=0.0)
    return solve_cases(paper_robot, draw_cases(paper_robot, domain, "planner", 40, np.random.default_rng(1)))


@pytest.fixture(scope="module")
def load(networks: Any) -> Load:
    def load_module(module: Any) -> ForeignNetwork:
        return load_network(Path("mine.pt"), networks.to_bytes(networks.script(module.eval())))

    return load_module


def others(networks: Any, robot: RobotSpec) -> dict[str, tuple[Any, dict[str, Any]]]:
    return {
        "millimetres": (networks.Converted(robot, scale=1e3), {"length_unit": "mm"}),
        "tendon order": (networks.Converted(robot, order=(1, 2, 0)), {"tendon_order": (3, 1, 2)}),
        "row per point": (networks.RowPerPoint(robot), {}),
        "quaternions": (networks.Quaternions(robot), {}),
        "positions alone": (networks.PositionsAlone(robot), {}),
        "fewer loads": (networks.TableOutputs(robot), {}),
    }


@pytest.mark.parametrize(
    "name", ["millimetres", "tendon order", "row per point", "quaternions", "positions alone", "fewer loads"]
)
def test_other_conventions_answer_as_ours(
    name: str, networks: Any, load: Load, paper_robot: RobotSpec, solved: SolvedCases
) -> None:
    ours = networks.Converted(paper_robot).eval()
    import torch

    positions, rotations = (array.numpy() for array in ours(torch.from_numpy(solved.cases.tensions)))
    module, given = others(networks, paper_robot)[name]
    found = find_convention(load(module), paper_robot, Given(others=given), solved)
    p, R = ask(load(module), paper_robot, found.convention, solved)
    np.testing.assert_allclose(p, positions, atol=1e-9)
    # Along the curve's tangents, not from the network, where it gives positions alone: some (u h)^3 / 24.
    assert rotation_distance(R, rotations).max() < (1e-3 if name == "positions alone" else 1e-6)


def test_what_the_names_say_is_found(networks: Any, load: Load, paper_robot: RobotSpec, solved: SolvedCases) -> None:
    convention = find_convention(load(networks.make("plain", paper_robot)), paper_robot, Given(), solved).convention
    assert convention.inputs == ("tensions", "gravity", "tip_force")
    assert convention.outputs == ("positions", "rotations")
    convention = find_convention(load(networks.RowPerPoint(paper_robot)), paper_robot, Given(), solved).convention
    assert convention.inputs == ("arc_length", "tensions")
    assert convention.outputs == ("positions", "rotation_vectors", "ignored")
    convention = find_convention(load(networks.Quaternions(paper_robot)), paper_robot, Given(), solved).convention
    assert (convention.outputs, convention.with_base) == (("positions", "quaternions_wxyz"), False)


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        ({"scale": 1e3}, "lengths in mm (--length-unit mm)"),
        ({"order": (2, 1, 0)}, "tendons in the order 3,2,1 (--tendon-order 3,2,1)"),
        ({"transposed": True}, "rotations transposed (--transposed)"),
        ({"turn_deg": 30.0}, "base turned by 30 degrees (--base-turn-deg 30)"),
        ({"turn_deg": 270.0}, "base turned by 270 degrees (--base-turn-deg 270)"),
        ({"reverse": True}, "disks from tip to base (--disk-order tip_to_base)"),
        ({"scale": 1e3, "turn_deg": 90.0}, "lengths in mm (--length-unit mm) and base turned by 90 degrees"),
    ],
)
def test_mistakes_are_named(
    mistake: dict[str, Any], words: str, networks: Any, load: Load, paper_robot: RobotSpec, solved: SolvedCases
) -> None:
    network = load(networks.Converted(paper_robot, **mistake))
    found = find_convention(network, paper_robot, Given(), solved)
    assert found.error > 1e-3
    assert any(words in reason for reason in explain_error(network, paper_robot, found, solved))


def test_a_plainly_bad_network_has_no_explanation(
    networks: Any, load: Load, paper_robot: RobotSpec, solved: SolvedCases
) -> None:
    network = load(networks.Converted(paper_robot, scale=0.8))
    found = find_convention(network, paper_robot, Given(), solved)
    assert explain_error(network, paper_robot, found, solved) == []


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("nan", "NaN or infinity in"),
        ("batch", "alone and in a batch"),
        ("random", "dropout"),
        ("shape", "--inputs and --outputs"),
        ("half", "float16"),
        ("gpu", "CUDA"),
        ("memory", "memory"),
    ],
)
def test_faults_are_refused(
    fault: str, words: str, networks: Any, load: Load, paper_robot: RobotSpec, solved: SolvedCases
) -> None:
    network = load(networks.Faulty(paper_robot, fault))
    with pytest.raises(InputError) as caught:
        found = find_convention(network, paper_robot, Given(), solved)
        check_faults(network, paper_robot, found.convention, solved)
    assert words in str(caught.value)


def test_a_sound_network_has_no_faults(networks: Any, load: Load, paper_robot: RobotSpec, solved: SolvedCases) -> None:
    network = load(networks.Faulty(paper_robot, "none"))
    found = find_convention(network, paper_robot, Given(), solved)
    check_faults(network, paper_robot, found.convention, solved)


def test_a_robot_that_does_not_fit_is_refused(
    networks: Any, load: Load, paper_robot: RobotSpec, two_segment_robot: RobotSpec
) -> None:
    domain = Domain(max_tension_n=tuple(two_segment_robot.max_tensions), gravity_m_s2=0.0, tip_force_n=0.0)
    cases = solve_cases(
        two_segment_robot, draw_cases(two_segment_robot, domain, "planner", 6, np.random.default_rng(1))
    )
    with pytest.raises(InputError, match="6 tendons"):
        find_convention(load(networks.PositionsAlone(paper_robot)), two_segment_robot, Given(), cases)


def test_given_names_are_kept_and_unknown_ones_refused(
    networks: Any, load: Load, paper_robot: RobotSpec, solved: SolvedCases
) -> None:
    assert check_names("--inputs", "arc_length, tensions", "inputs") == ("arc_length", "tensions")
    with pytest.raises(InputError, match="did you mean 'tensions'"):
        check_names("--inputs", "tension", "inputs")
    given = Given(inputs=("arc_length", "tensions"), outputs=("positions", "rotation_vectors", "ignored"))
    found = find_convention(load(networks.RowPerPoint(paper_robot)), paper_robot, given, solved)
    assert isinstance(found, Found)
    assert found.error < 1e-4
    wrong = dataclasses.replace(given, inputs=("tensions", "arc_length"))
    assert find_convention(load(networks.RowPerPoint(paper_robot)), paper_robot, wrong, solved).error > 1e-2
