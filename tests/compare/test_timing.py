from tdcr_planner.compare.timing import measure_times
from tdcr_planner.compare.verdicts import sample_configurations


def test_times_every_model_on_the_same_states(make_session):
    session = make_session()
    rows, _ = sample_configurations(session.space, 20, 1)
    times = measure_times(session, rows)
    assert [item.model for item in times] == ["learned", "constant_curvature", "reference"]
    assert all(item.batch == 20 and item.shape_us > 0.0 and item.check_us > 0.0 for item in times)
