import pytest

from tdcr_planner.compare.paths import PlannedPath, path_rates, plan_path


def path(status, repairs=0, model="learned"):
    return PlannedPath(model, 1, status, repairs, None, None, 0.1)


@pytest.mark.parametrize(
    ("status", "repairs", "found", "at_once"),
    [
        ("verified", 0, True, True),
        ("verified", 2, True, False),
        ("unverified", 0, True, False),
        ("no_path", 0, False, False),
        ("no_path", 1, True, False),
        ("invalid_goal", 0, False, False),
    ],
)
def test_what_the_first_search_came_to(status, repairs, found, at_once):
    assert (path(status, repairs).found, path(status, repairs).verified_at_once) == (found, at_once)


def test_rates_are_of_the_models_own_queries():
    paths = [path("verified"), path("verified", 1), path("no_path"), path("unverified", 3, "constant_curvature")]
    learned, arc = path_rates(paths, ("learned", "constant_curvature"))
    assert (learned.found.count, learned.found.total) == (2, 3)
    assert (learned.verified_at_once.count, learned.verified_at_once.total) == (1, 2)
    assert (learned.verified.count, learned.verified.total) == (2, 3)
    assert (arc.found.count, arc.verified_at_once.count, arc.verified.count, arc.verified.total) == (1, 0, 0, 1)


def test_plans_with_the_model_that_is_asked_for(make_session):
    session = make_session(goal={"bending_n": [[-0.3, 0.0]]})
    first = plan_path(session, "learned", 3)
    assert (first.model, first.seed, first.status) == ("learned", 3, "verified")
    assert first.clearance_m >= 0.0005
    assert first.deviation_m < 1e-9
    assert plan_path(session, "constant_curvature", 3).deviation_m > 0.01
