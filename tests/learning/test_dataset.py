"""Drawn cases lie where they should, and the reference's answers belong to them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_planner.errors import InputError
from tdcr_planner.learning.dataset import draw_cases, draw_mixture, solve_cases
from tdcr_planner.learning.settings import DomainSettings


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
