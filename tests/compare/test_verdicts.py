import numpy as np
import pytest
from scipy.stats import kstest

from tdcr_planner.compare.verdicts import (
    MODELS,
    REFERENCE_VERDICTS,
    join_verdicts,
    judge,
    sample_configurations,
    variants_of,
)
from tdcr_planner.planning.spaces import ConfigurationSpace
from tdcr_planner.planning.validity import planning_margins

LEARNED, BARE, ARC, LEARNED_PLANNED, ARC_PLANNED = variants_of(MODELS)


@pytest.fixture
def rows(make_session):
    return sample_configurations(make_session().space, 150, 3)[0]


class TestSampling:
    def test_keeps_tension_limits_and_counts_draws(self, make_scenario):
        space = ConfigurationSpace(make_scenario("paper"))
        rows, drawn = sample_configurations(space, 3000, 1)
        assert rows.shape == (3000, 2)
        assert (space.actuate(rows).tensions <= space.robot.max_tensions + 1e-9).all()
        # Three tendons at 120 degrees of at most T reach a hexagon of side T: 3 sqrt(3) / 2 T^2 of a box of (2 T)^2.
        share = 3.0 * np.sqrt(3.0) / 8.0
        assert 3000 / drawn == pytest.approx(share, abs=4.0 * np.sqrt(share * (1.0 - share) / drawn))

    def test_is_uniform(self, make_scenario):
        space = ConfigurationSpace(make_scenario("paper", base={"insertion_m": [0.0, 0.2]}))
        rows, _ = sample_configurations(space, 3000, 1)
        assert kstest(rows[:, 2], "uniform", (0.0, 0.2)).pvalue > 0.001
        assert abs(rows[:, 0].mean()) < 4.0 * rows[:, 0].std() / np.sqrt(3000)

    def test_same_seed_same_states_and_a_longer_list_begins_with_the_shorter(self, make_scenario):
        space = ConfigurationSpace(make_scenario("paper"))
        short, _ = sample_configurations(space, 10, 4)
        long, _ = sample_configurations(space, 2500, 4)
        np.testing.assert_array_equal(short, long[:10])
        assert not np.array_equal(short, sample_configurations(space, 10, 5)[0])


def test_margins_are_what_the_variants_names_say(make_session):
    session = make_session(bound=2e-4)
    scenario, model = session.scenario, session.model("learned")
    asked = scenario.planner.clearance_m
    expected = {
        "learned": asked + 2e-4,
        "learned_without_bound": asked,
        "constant_curvature": asked,
        "learned_as_planned": asked + 2e-4,
        "constant_curvature_as_planned": asked,
    }
    for variant in variants_of(MODELS):
        bound = session.model(variant.model).error_bound
        np.testing.assert_allclose(variant.margins(scenario, bound), expected[variant.name])
    planned = LEARNED_PLANNED.margins(scenario, model.error_bound)
    np.testing.assert_allclose(planned, planning_margins(scenario, model))


def test_a_perfect_model_is_never_falsely_valid(make_session, rows):
    verdicts = judge(make_session(), rows)
    truth = verdicts.reference_valid
    assert 0 < truth.sum() < len(rows)
    assert not (verdicts.valid(LEARNED) & ~truth).any()
    assert verdicts.deviation_of("learned").max() < 1e-12
    # The margin grows cylinders with their edges, the clearance is a distance: at an edge 0.5 mm may ask for 0.71 mm.
    disagree = verdicts.valid(LEARNED) != truth
    assert (verdicts.clearance[disagree] - 0.0005 < 0.00021).all()


def test_the_reference_asks_for_the_clearance(make_session, rows):
    verdicts = judge(make_session(), rows)
    valid = verdicts.reference_valid
    assert (verdicts.clearance[valid] >= 0.0005).all()
    low = verdicts.reference == REFERENCE_VERDICTS.index("clearance")
    assert (verdicts.clearance[low] < 0.0005).all()


def test_an_error_away_from_the_wall_is_a_false_valid_verdict_and_the_bound_prevents_it(make_session, rows):
    shift = -0.004
    bare = judge(make_session(shift=shift, bound=0.0), rows)
    false_valid = bare.valid(LEARNED) & ~bare.reference_valid
    assert false_valid.any()
    np.testing.assert_allclose(bare.deviation_of("learned"), 0.004, atol=1e-12)
    assert (bare.clearance[false_valid] > 0.0005 + shift).all()
    bounded = judge(make_session(shift=shift, bound=0.004), rows)
    assert not (bounded.valid(LEARNED) & ~bounded.reference_valid).any()
    np.testing.assert_array_equal(bounded.valid(BARE), bare.valid(BARE))


def test_constant_curvature_has_no_bound_and_does_not_know_gravity(make_session, rows):
    verdicts = judge(make_session(), rows)
    assert verdicts.deviation_of("constant_curvature").max() > 0.02
    assert (verdicts.valid(ARC) & ~verdicts.reference_valid).any()
    assert (verdicts.valid(ARC_PLANNED) <= verdicts.valid(ARC)).all()
    weightless = judge(make_session(gravity_m_s2=[0.0, 0.0, 0.0]), rows)
    assert weightless.deviation_of("constant_curvature").max() < 1e-4


def test_batches_join_in_order(make_session, rows):
    session = make_session(shift=-0.002)
    whole = judge(session, rows[:40])
    parts = join_verdicts([judge(session, rows[:15]), judge(session, rows[15:40])])
    for name in ("rows", "reference", "codes"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    np.testing.assert_allclose(parts.clearance, whole.clearance, atol=1e-9)
    np.testing.assert_allclose(parts.deviation, whole.deviation, atol=1e-9)
    assert parts.deviation.shape == (40, len(MODELS))
