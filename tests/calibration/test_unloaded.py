"""Arcs: against an energy minimised by another method, the reference, and closed forms of friction."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import minimize

from tdcr_planner.calibration.simulate import smooth_motion
from tdcr_planner.calibration.unloaded import STIFFEST_SPRING_N_M, solve_arcs, springs_of
from tdcr_planner.statics.solver import solve_statics


def frictionless(robot):
    tables = [{**table.model_dump(), "friction_coefficient": 0.0} for table in robot.tendon_tables]
    return robot.model_copy(update={"tendons": tables})


def pretensions(robot, count):
    return np.tile(robot.drive.pretension, (count, 1))


def chord_energy(robot, bends, displacement):
    """Energy of backbone and springs, each tendon measured from hole to hole through the poses of the disks."""
    total, rotation, origin = 0.0, np.eye(3), np.zeros(3)
    offsets = robot.tendon_offsets
    lengths = np.zeros(robot.tendon_count)
    for index, segment in enumerate(robot.segments):
        x, y = bends[2 * index : 2 * index + 2]
        rod = segment.backbone or robot.backbone
        total += 0.5 * rod.stiffness_bending_torsion[0] * (x * x + y * y) * segment.length_m
        step = segment.length_m / segment.disks
        bend = np.hypot(x, y) + 1e-15
        axis = np.array([-y, x, 0.0]) / bend
        cross = np.cross(np.eye(3), axis)
        angle = bend * step
        turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
        away = np.array([x / bend * (1.0 - np.cos(angle)) / bend, y / bend * (1.0 - np.cos(angle)) / bend,
                         np.sin(angle) / bend])  # fmt: skip
        for _ in range(segment.disks):
            end, after = origin + rotation @ away, rotation @ turn
            passing = robot.tendon_segments >= index
            holes = end + offsets @ after.T - origin - offsets @ rotation.T
            lengths[passing] += np.linalg.norm(holes, axis=1)[passing]
            origin, rotation = end, after
    spring = springs_of(robot)
    stretch = displacement + lengths - robot.rest_path_lengths + robot.drive.pretension / spring
    return total + 0.5 * np.sum(spring * np.maximum(stretch, 0.0) ** 2)


def subdivide(turns, steps):
    parts = [np.linspace(a, b, steps, endpoint=False) for a, b in pairwise(turns)]
    return np.concatenate([*parts, turns[-1:]])


def test_bends_minimise_the_energy_of_springs_from_hole_to_hole(make_robot, random):
    robot = frictionless(make_robot())
    # The energy here has no stretch of the backbone.
    robot = robot.model_copy(update={"backbone": {**robot.backbone.model_dump(), "axial_stiffness_n": 1e12}})
    commands = smooth_motion(6, 12, 0.001, random)[[2, 5, 8]]
    found = solve_arcs(robot, commands, pretensions(robot, 3))
    assert found.solved.all()
    for row, command in enumerate(commands):
        best = minimize(
            lambda bends, command=command: 1e3 * chord_energy(robot, bends, command), np.zeros(4), method="BFGS",
            options={"gtol": 1e-6},
        )  # fmt: skip
        # BFGS with gradients by differences ends within 1e-4 of the minimum.
        np.testing.assert_allclose(found.bends[row, [0, 1, 3, 4]], best.x, atol=1e-3 * np.abs(best.x).max())


@pytest.mark.parametrize(("between", "tolerance"), [("channel", 2e-4), ("straight", 4e-3)])
def test_the_reference_has_the_same_shapes(make_robot, random, between, tolerance):
    robot = frictionless(make_robot(between=between))
    commands = smooth_motion(6, 12, 0.001, random)
    found = solve_arcs(robot, commands, pretensions(robot, 12))
    reference = solve_statics(robot, displacements=commands)
    assert reference.converged.all()
    # In channels both are arcs, but for shear. Between disks the reference bends more in the middle of each gap.
    difference = np.linalg.norm(found.positions - reference.positions, axis=2).max()
    assert difference < tolerance * robot.length
    np.testing.assert_allclose(found.tensions, reference.tensions, atol=0.02 * found.tensions.max())


def test_slack_tendons_carry_nothing(robot):
    commands = np.full((2, 6), -0.01)
    commands[1, 0] = 0.003
    found = solve_arcs(robot, commands, pretensions(robot, 2))
    np.testing.assert_allclose(found.positions[0, -1], [0.0, 0.0, robot.length], atol=1e-9)
    assert found.tensions[1, 0] > 1.0
    assert (found.tensions[1, 1:] == 0.0).all()


def test_the_sheath_takes_tension_on_the_pull_and_gives_it_on_the_release(make_robot):
    robot = make_robot("tension")
    pulls = np.zeros((31, 6))
    pulls[:, 0] = np.concatenate([np.linspace(1.0, 6.0, 16), np.linspace(6.0, 1.0, 16)[1:]])
    found = solve_arcs(robot, np.zeros((31, 6)), pulls)
    exponent = 0.1 * np.pi / 2.0
    np.testing.assert_allclose(found.tensions[15, 0], 6.0 * np.exp(-exponent), rtol=1e-9)
    np.testing.assert_allclose(found.tensions[-1, 0], 1.0 * np.exp(exponent), rtol=1e-9)
    # Just after the turn the tendon sticks: the tension at the base hardly falls.
    assert found.tensions[16, 0] > 0.98 * found.tensions[15, 0]


def test_a_finer_motion_ends_in_the_same_shape(robot, random):
    turns = smooth_motion(6, 9, 0.004, random)
    coarse, fine = (subdivide(turns, steps) for steps in (20, 80))
    tips = [solve_arcs(robot, path, pretensions(robot, len(path))).positions[-1, -1] for path in (coarse, fine)]
    # Tendons turn round between two states of a straight motion, too: that is seen to within an increment.
    assert np.linalg.norm(tips[0] - tips[1]) < 2e-5


def test_a_rigid_drive_is_a_stiff_spring(robot):
    drive = {key: value for key, value in robot.model_dump()["drive"].items() if key == "kind"}
    assert (springs_of(robot.model_copy(update={"drive": drive})) == STIFFEST_SPRING_N_M).all()
