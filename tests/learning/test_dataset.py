"""Drawn cases lie where they should, and the reference's answers belong to them."""

from __future__ import annotations

import dataclasses
import multiprocessing
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.cluster import dask_backend
from tdcr_planner.errors import InputError
from tdcr_planner.learning import dataset
from tdcr_planner.learning.dataset import Cases, draw_cases, draw_mixture, solve_cases
from tdcr_planner.learning.limit_use import LimitUse
from tdcr_planner.learning.settings import DomainSettings
from tdcr_planner.statics.solver import solve_statics
from tdcr_planner.statics.strain import largest_bending_strain, within_strain_limits
from tdcr_planner.statics.tendons import tendon_displacements, within_displacement_limits
from tdcr_planner.workers import Outcome, WorkersError, local_backend


@settings(max_examples=25, deadline=None)
@given(
    sample=st.sampled_from(["uniform", "planner"]),
    share=st.floats(0.05, 1.0),
    gravity=st.floats(0.0, 20.0),
    force=st.floats(0.0, 0.2),
    seed=st.integers(0, 1000),
)
def test_cases_lie_in_the_domain(two_segment_robot, sample, share, gravity, force, seed):
    domain = DomainSettings(tension_share=share, gravity_m_s2=gravity, tip_force_n=force).for_robot(two_segment_robot)
    cases = draw_cases(two_segment_robot, domain, sample, 50, np.random.default_rng(seed))
    assert (cases.tensions >= 0.0).all()
    assert (cases.tensions <= np.array(domain.max_tension_n) * (1 + 1e-12)).all()
    assert (np.linalg.norm(cases.gravity, axis=1) <= gravity * (1 + 1e-12)).all()
    assert (np.linalg.norm(cases.tip_force, axis=1) <= force * (1 + 1e-12)).all()


def test_planner_cases_have_tensions_of_least_sum(two_segment_robot, random):
    domain = DomainSettings().for_robot(two_segment_robot)
    cases = draw_cases(two_segment_robot, domain, "planner", 300, random)
    least = two_segment_robot.tensions_from_bending(two_segment_robot.bending_from_tensions(cases.tensions))
    np.testing.assert_allclose(cases.tensions, least, atol=1e-9)
    assert 0.3 < (cases.tip_force == 0.0).all(axis=1).mean() < 0.7


def test_a_seed_decides_the_cases(paper_robot):
    domain = DomainSettings().for_robot(paper_robot)
    first, second = (draw_mixture(paper_robot, domain, 0.3, 40, np.random.default_rng(9)) for _ in range(2))
    np.testing.assert_array_equal(first.tensions, second.tensions)
    np.testing.assert_array_equal(first.gravity, second.gravity)
    assert len(first) == 40


def test_solutions_do_not_depend_on_threads_and_progress_is_told(small_robot, random):
    domain = DomainSettings().for_robot(small_robot)
    cases = draw_cases(small_robot, domain, "uniform", 60, random)
    told = []
    one = solve_cases(small_robot, cases, threads=1, progress=lambda *news: told.append(news), stage="here")
    two = solve_cases(small_robot, cases, threads=2)
    np.testing.assert_array_equal(one.base_moment, two.base_moment)
    assert one.asked == 60
    assert told[-1] == ("here", 60, 60, "")


def test_loads_that_the_robot_cannot_carry_are_refused(small_robot, random):
    domain = DomainSettings(gravity_m_s2=1e5).for_robot(small_robot)
    cases = draw_cases(small_robot, domain, "planner", 20, random)
    with pytest.raises(InputError, match="no stable equilibrium"):
        solve_cases(small_robot, cases)


def test_no_cases_are_refused(small_robot, random):
    with pytest.raises(InputError, match="count"):
        draw_cases(small_robot, DomainSettings().for_robot(small_robot), "uniform", 0, random)


@pytest.fixture
def many_cases(small_robot, random):
    return draw_cases(small_robot, DomainSettings().for_robot(small_robot), "uniform", 3000, random)


def assert_same(found, expected):
    for name in ("base_moment", "positions", "rotations"):
        # A process that compiles the solver for itself may round otherwise; cases differ from each other by far more.
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0.0, atol=1e-13)
    for field in dataclasses.fields(expected.cases):
        np.testing.assert_array_equal(getattr(found.cases, field.name), getattr(expected.cases, field.name))
    assert found.asked == expected.asked


@settings(max_examples=10, deadline=None)
@given(block=st.integers(1, 80), backwards=st.booleans())
def test_neither_blocks_nor_their_order_matter(small_robot, block, backwards):
    cases = draw_cases(small_robot, DomainSettings().for_robot(small_robot), "uniform", 60, np.random.default_rng(4))

    def solve_some(robot, tensions, **loads):
        """Calls cases of little tension unstable, so that blocks have answers of different lengths."""
        return dataclasses.replace(solve_statics(robot, tensions, **loads), stable=tensions[:, 0] > 0.8)

    def backend(function, jobs):
        order = range(len(jobs))
        for index in reversed(order) if backwards else order:
            yield Outcome(index, function(jobs[index]))

    with patch.object(dataset, "solve_statics", solve_some):
        whole = solve_cases(small_robot, cases)
        with patch.object(dataset, "_BLOCK", block):
            found = solve_cases(small_robot, cases, backend=backend)
    assert_same(found, whole)
    kept = cases.tensions[:, 0] > 0.8
    assert 0 < kept.sum() < 60
    np.testing.assert_array_equal(found.cases.tensions, cases.tensions[kept])


def test_processes_of_which_one_is_killed_give_the_same(small_robot, many_cases, monkeypatch):
    monkeypatch.setattr(dataset, "_BLOCK", 100)
    told = []

    def progress(stage, done, total, remark):
        told.append(done)
        if done == 500:
            multiprocessing.active_children()[0].kill()

    found = solve_cases(small_robot, many_cases, backend=local_backend(2, losses=1), progress=progress)
    assert told == list(range(0, 3001, 100))
    assert_same(found, solve_cases(small_robot, many_cases))


def test_a_cluster_of_which_a_worker_is_killed_gives_the_same(small_robot, many_cases, start_cluster, monkeypatch):
    monkeypatch.setattr(dataset, "_BLOCK", 50)
    cluster = start_cluster()
    cluster.add_worker()
    cluster.add_worker()
    told = []

    def progress(stage, done, total, remark):
        told.append(done)
        if done == 500:
            cluster.workers[0].kill()

    found = solve_cases(small_robot, many_cases, backend=dask_backend(cluster.address), progress=progress)
    assert cluster.workers[0].wait() == -9
    assert told == list(range(0, 3001, 50))
    assert_same(found, solve_cases(small_robot, many_cases))


def test_a_block_that_fails_is_not_left_out(small_robot, many_cases):
    def backend(function, jobs):
        yield Outcome(1, None, "MemoryError: no room")

    with pytest.raises(WorkersError, match="block 2 of 3 failed: MemoryError"):
        solve_cases(small_robot, many_cases, backend=backend)


def test_ctrl_c_ends_the_processes(small_robot, many_cases, monkeypatch):
    monkeypatch.setattr(dataset, "_BLOCK", 100)

    def progress(stage, done, total, remark):
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve_cases(small_robot, many_cases, backend=local_backend(1), progress=progress)
    assert not multiprocessing.active_children()


LIMITED = [
    {"max_strain": 0.002},
    {"max_strain": 1e-4},
    {"max_strain": 0.004, "displacement": 0.003},
    {"displacement": 1e-3},
]


def limited(robot, limits):
    """A robot that may do only part of what its tensions could."""
    backbone = robot.backbone.model_copy(update={"max_strain": limits.get("max_strain")})
    segments = [
        segment.model_copy(update={"max_tendon_displacement_m": limits.get("displacement")})
        for segment in robot.segments
    ]
    return robot.model_copy(update={"backbone": backbone, "segments": segments})


@pytest.mark.parametrize("sample", ["uniform", "planner"])
@pytest.mark.parametrize("limits", LIMITED)
def test_only_what_the_robot_may_do_is_drawn_and_solved(two_segment_robot, random, limits, sample):
    robot = limited(two_segment_robot, limits)
    cases = draw_cases(robot, DomainSettings().for_robot(robot), sample, 200, random)
    assert len(cases) == 200
    unloaded = solve_statics(robot, cases.tensions)
    # The linear estimate leaves out the compression of backbone and tendons, some 1e-4 of the length.
    assert (largest_bending_strain(robot, unloaded) <= limits.get("max_strain", np.inf) * 1.02).all()
    assert (np.abs(tendon_displacements(robot, unloaded)) <= limits.get("displacement", np.inf) + 1e-4).all()
    solved = solve_cases(robot, Cases(cases.tensions, 0.0 * cases.gravity, 0.0 * cases.tip_force))
    again = solve_statics(robot, solved.cases.tensions)
    assert within_strain_limits(robot, again).all()
    assert within_displacement_limits(robot, again).all()
    assert len(solved.cases) > 100


def test_use_of_the_limits_is_linear_and_none_without_limits(two_segment_robot, random):
    tensions = random.uniform(0.0, 3.0, (20, 6))
    use = LimitUse(limited(two_segment_robot, {"max_strain": 0.002, "displacement": 0.002}))
    assert use.any
    np.testing.assert_allclose(use.largest(0.5 * tensions), 0.5 * use.largest(tensions), rtol=1e-12)
    assert not LimitUse(two_segment_robot).any
