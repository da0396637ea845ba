from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.planning.causes import CAUSES, Cause
from tdcr_planner.planning.robot_limits import RobotLimits
from tdcr_planner.planning.validity import ValidityChecker, planning_margins, rejections
from tdcr_planner.robot import load_robot
from tdcr_planner.shape.base import DiskPoses
from tdcr_planner.shape.constant_curvature import ConstantCurvatureShape
from tdcr_planner.statics.solver import solve_statics
from tdcr_planner.statics.strain import largest_bending_strain
from tdcr_planner.statics.tendons import tendon_displacements

MOVING_BASE = {"insertion_m": [0.0, 0.1], "roll_deg": [-180.0, 180.0]}
TURNED = {**MOVING_BASE, "position_m": [0.1, -0.2, 0.3], "quaternion_wxyz": [0.9, 0.1, -0.4, 0.2]}


class Fickle(ConstantCurvatureShape):
    """Has no domain left of zero tension on tendon 1, no shape where it pulls hard, NaN where tendon 2 does."""

    def in_domain(self, tensions, gravity, tip_force):
        return tensions[:, 0] < 3.0

    def disk_poses(self, tensions, *, gravity=None, tip_force=None):
        poses = super().disk_poses(tensions, gravity=gravity, tip_force=tip_force)
        poses.positions[tensions[:, 1] > 3.0, 5] = np.nan
        return DiskPoses(poses.positions, poses.rotations, tensions[:, 2] <= 3.0)


def codes_of(setup, bending):
    return [CAUSES[code - 1] if code else None for code in setup.checker.check(np.array(bending)).tolist()]


@pytest.mark.parametrize("robot", ["paper", "inspection", "two_segment"])
def test_compiled_actuation_equals_the_configuration_space(make_setup, random, robot):
    setup = make_setup(robot, base=TURNED, gravity_m_s2=[1.0, 2.0, -9.0], tip_force_n=[0.1, 0.0, -0.2])
    rows = random.uniform(setup.space.lower, setup.space.upper, (500, setup.space.dimension))
    rows[0] = 0.0
    fast, slow = setup.checker.actuate(rows), setup.space.actuate(rows)
    for name in ("tensions", "gravity", "tip_force", "base_positions", "base_rotations"):
        # 1e-12: rounding of numbers of order 10 in another order of operations.
        np.testing.assert_allclose(getattr(fast, name), getattr(slow, name), rtol=0, atol=1e-12)


def test_world_poses_are_base_poses_moved(make_setup, random):
    setup = make_setup(base=TURNED)
    rows = random.uniform(setup.space.lower, setup.space.upper, (20, setup.space.dimension)) * 0.4
    positions, rotations, solved = setup.checker.world_poses(rows)
    actuation = setup.space.actuate(rows)
    poses = setup.model.disk_poses(actuation.tensions)
    expected = np.einsum("nij,ndj->ndi", actuation.base_rotations, poses.positions) + actuation.base_positions[:, None]
    np.testing.assert_allclose(positions, expected, atol=1e-12)
    np.testing.assert_allclose(rotations, actuation.base_rotations[:, None] @ poses.rotations, atol=1e-12)
    assert solved.all()


def test_each_cause_is_told_and_counted(make_setup):
    setup = make_setup(model=Fickle, boxes=[[[0.03, -0.1, 0.0], [0.2, 0.1, 0.19]]])
    # Tendons of the paper's robot pull towards 90, -30 and 210 degrees.
    directions = np.array([[0.0, 1.0], [np.cos(np.pi / 6), -0.5], [-np.cos(np.pi / 6), -0.5]])
    rows = [*(3.2 * directions), [0.0, 3.6], [1.0, 0.0], [0.0, 0.0]]
    expected = [
        Cause.MODEL_DOMAIN,
        Cause.NOT_FINITE,
        Cause.NO_SHAPE,
        Cause.TENSION_LIMIT,
        Cause.OBSTACLE,
        None,
    ]
    assert codes_of(setup, rows) == expected
    assert setup.checker.states_checked == 6
    assert rejections(setup.checker.rejected) == dict.fromkeys([cause.value for cause in expected if cause], 1)
    np.testing.assert_array_equal(setup.checker.valid(np.array(rows)), [False] * 5 + [True])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_configuration_that_is_not_finite_is_rejected_as_such(make_setup, value):
    setup = make_setup(base=MOVING_BASE)
    rows = np.zeros((5, 4))
    np.fill_diagonal(rows[:4], value)
    assert codes_of(setup, rows) == [Cause.NOT_FINITE] * 4 + [None]
    assert rejections(setup.checker.rejected) == {"nan": 4}
    assert setup.checker.world_poses(rows)[2].tolist() == [False] * 4 + [True]
    assert setup.checker.explain(rows[0]) == "nan"


def test_a_row_does_not_depend_on_its_batch(make_setup, random):
    setup = make_setup(model=Fickle, base=MOVING_BASE, boxes=[[[0.03, -0.1, 0.1], [0.2, 0.1, 0.15]]])
    rows = random.uniform(setup.space.lower, setup.space.upper, (200, setup.space.dimension))
    together = setup.checker.check(rows)
    alone = np.concatenate([setup.checker.check(row[None]) for row in rows])
    np.testing.assert_array_equal(together, alone)
    assert len(np.unique(together)) >= 5


def test_strain_limit(make_setup, paper_robot):
    # At 2 N the arc has curvature 2 N x 8 mm / EI; the outermost fibre of the 0.5 mm rod is strained by that x 0.5 mm.
    strain = 2.0 * 0.008 / paper_robot.backbone.stiffness_bending_torsion[0] * paper_robot.backbone.radius_m
    for factor, expected in ((1.001, None), (0.999, Cause.STRAIN)):
        backbone = paper_robot.backbone.model_copy(update={"max_strain": factor * strain})
        setup = make_setup(spec=paper_robot.model_copy(update={"backbone": backbone}))
        assert codes_of(setup, [[0.0, 2.0], [0.0, 0.0]]) == [expected, None]


def test_tendon_displacement_limit(make_setup, paper_robot):
    # On an arc of angle kappa L a tendon at distance r on the inside is shorter by r kappa L; the pulled tendon and the
    # backbone it compresses, T L / EA, come on top.
    rod = paper_robot.backbone
    curvature = 2.0 * 0.008 / rod.stiffness_bending_torsion[0]
    pulled = 0.2 * (0.008 * curvature + 2.0 / rod.stiffness_shear_extension[2])
    for factor, expected in ((1.001, None), (0.999, Cause.TENDON_DISPLACEMENT)):
        segment = paper_robot.segments[0].model_copy(update={"max_tendon_displacement_m": factor * pulled})
        setup = make_setup(spec=paper_robot.model_copy(update={"segments": (segment,)}))
        assert codes_of(setup, [[0.0, 2.0]]) == [expected]


@pytest.mark.parametrize("robot", ["inspection", "two_segment"])
def test_tendon_displacements_equal_those_of_the_statics(robot, root, random):
    spec = load_robot(root / f"models/robots/{robot}.toml")
    tensions = random.uniform(0.0, 2.0, (12, spec.tendon_count))
    solution = solve_statics(spec, tensions, gravity=[3.0, 4.0, -8.0])
    found = RobotLimits(spec).tendon_displacements(tensions, solution.rotations)
    # The statics integrate |v + u x r| along the rod; to first order in u, from disks 10 mm apart, 20 um are left.
    np.testing.assert_allclose(found, tendon_displacements(spec, solution), atol=2e-5)
    assert np.abs(found).max() > 2e-3


def test_ruled_out_states_are_rejected_near_by_only(make_setup):
    setup = make_setup()
    setup.checker.rule_out(np.array([1.0, 0.0]), 0.002)
    reach = 0.002 / setup.checker.motion_scale[0]
    assert codes_of(setup, [[1.0, 0.0], [1.0 + 0.9 * reach, 0.0], [1.0 + 1.1 * reach, 0.0]]) == [
        Cause.RULED_OUT,
        Cause.RULED_OUT,
        None,
    ]


def test_explanations_name_what_is_wrong(make_setup):
    setup = make_setup(boxes=[[[0.03, -0.1, 0.0], [0.2, 0.1, 0.19]]])
    assert setup.checker.explain(np.zeros(2)) == ""
    assert "disk" in setup.checker.explain(np.array([1.0, 0.0]))
    assert "box.stl" in setup.checker.explain(np.array([1.0, 0.0]))
    assert "tendon 1 needs 4 N of at most 3.5 N" in setup.checker.explain(np.array([0.0, 4.0]))


def test_margins_add_clearance_and_the_models_error_whatever_the_step(make_setup):
    setup = make_setup(planner={"clearance_m": 0.001, "step_m": 0.004})
    setup.model.error_bound = np.linspace(0.0, 0.002, 21)
    np.testing.assert_allclose(planning_margins(setup.scenario, setup.model), np.linspace(0.001, 0.003, 21))


def test_a_model_with_a_fast_path_is_asked_there(make_setup):
    class Fast(ConstantCurvatureShape):
        def disk_poses_unchecked(self, tensions, gravity, tip_force):
            self.asked = len(tensions)
            return super().disk_poses(tensions)

        def disk_poses(self, tensions, *, gravity=None, tip_force=None):
            raise AssertionError("the slow path was taken")

    setup = make_setup(model=Fast)
    assert isinstance(setup.checker, ValidityChecker)
    assert codes_of(setup, [[1.0, 0.0]] * 3) == [None] * 3
    assert setup.model.asked == 3


def test_motion_scale_of_the_base_is_exact(make_setup):
    setup = make_setup(base=MOVING_BASE)
    # An insertion moves every point by itself; a roll moves the tip's rim by its distance from the axis.
    assert setup.checker.motion_scale[2] == pytest.approx(1.0, rel=1e-6)
    assert 0.01 < setup.checker.motion_scale[3] < 0.2


CURVED = [(0.0, 4.0, 0.0), (3.0, -2.0, 0.0), (-2.0, 5.0, 1.5)]


@pytest.mark.parametrize("rest", CURVED)
def test_limits_of_a_curved_robot_count_from_its_rest(two_segment_robot, random, rest):
    backbone = two_segment_robot.backbone.model_copy(update={"rest_curvature_1_m": rest})
    robot = two_segment_robot.model_copy(update={"backbone": backbone})
    limits = RobotLimits(robot)
    tensions = np.concatenate([np.zeros((1, 6)), random.uniform(0.0, 2.0, (12, 6))])
    solution = solve_statics(robot, tensions, gravity=[0.3, 0.4, -0.8])
    unloaded = solve_statics(robot, tensions[:1])
    np.testing.assert_allclose(limits.bending_strain(unloaded.rotations), 0.0, atol=1e-9)
    np.testing.assert_allclose(limits.tendon_displacements(tensions[:1], unloaded.rotations), 0.0, atol=1e-9)
    strain = limits.bending_strain(solution.rotations)
    by_segment = np.stack([strain[:, robot.disk_segments[1:] == index].max(axis=1) for index in range(2)], axis=1)
    # The search sees the mean between disks, the statics the largest within: apart by what loads add over 10 mm.
    np.testing.assert_allclose(by_segment, largest_bending_strain(robot, solution), rtol=0.05, atol=1e-4)
    displaced = limits.tendon_displacements(tensions, solution.rotations)
    np.testing.assert_allclose(displaced, tendon_displacements(robot, solution), atol=3e-5)


@pytest.mark.parametrize("beyond", [False, True])
def test_a_curved_robot_may_rest_and_may_not_be_pulled_straight(paper_robot, beyond):
    backbone = paper_robot.backbone.model_copy(update={"rest_curvature_1_m": (0.0, 4.0, 0.0), "max_strain": 0.0015})
    robot = paper_robot.model_copy(update={"backbone": backbone})
    # Bending by -4 1/m strains the 0.5 mm rod by 0.2 %.
    pull = 4.0 * backbone.stiffness_bending_torsion[0] / 0.008
    tensions = robot.tensions_from_bending([[[-pull if beyond else 0.0, 0.0]]])
    solution = solve_statics(robot, tensions)
    code = RobotLimits(robot).check(tensions, solution.rotations)[0]
    assert bool(code == Cause.STRAIN.code) is beyond


def test_states_at_the_ends_of_their_ranges_are_valid(make_setup):
    setup = make_setup(base={"insertion_m": [0.0, 0.25], "roll_deg": [-12.0, 12.0]})
    row = setup.space.row([[0.0, 3.5]], 0.25 * (1.0 + 1e-12), 12.000000000000002)
    assert (row >= setup.space.lower).all()
    assert (row <= setup.space.upper).all()
    assert setup.checker.valid(row[None])[0]
