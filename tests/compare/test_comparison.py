import numpy as np
import pytest

from tdcr_planner.compare import comparison
from tdcr_planner.compare.comparison import compare
from tdcr_planner.compare.verdicts import MODELS, sample_configurations, variants_of
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.planning.scenario import load_scenario
from tdcr_planner.planning.spaces import ConfigurationSpace


@pytest.fixture(scope="module")
def scenario(root):
    return load_scenario(root / "scenes/duct/scenario_sag.toml")


@pytest.fixture(scope="module")
def found(scenario):
    return compare(scenario, samples=150, paths=1, seed=2)


def test_states_are_the_seeds(scenario, found):
    rows, drawn = sample_configurations(ConfigurationSpace(scenario), 150, 2)
    np.testing.assert_array_equal(found.verdicts.rows, rows)
    assert found.drawn == drawn


def test_every_model_is_planned_with_and_timed(found):
    assert [(path.model, path.seed) for path in found.paths] == [("learned", 1), ("constant_curvature", 1)]
    assert [item.model for item in found.times] == ["learned", "constant_curvature", "reference"]


def test_disagreements_are_the_worst_wrong_verdicts_with_their_shapes(found):
    arc = next(variant for variant in variants_of(MODELS) if variant.name == "constant_curvature")
    wrong = found.verdicts.valid(arc) & ~found.verdicts.reference_valid
    assert wrong.any()
    worst = found.verdicts.clearance[wrong].min()
    shown = [item for item in found.disagreements if item.variant == arc.name and item.kind == "false_valid"]
    assert shown[0].clearance == worst
    for item in found.disagreements:
        np.testing.assert_array_equal(item.row, found.verdicts.rows[item.state])
        apart = np.linalg.norm(item.positions - item.model_positions, axis=1).max()
        assert apart == pytest.approx(item.deviation, abs=1e-6)  # float32 in the network


def test_verdicts_do_not_depend_on_the_workers(scenario, monkeypatch):
    monkeypatch.setattr(comparison, "BATCH", 20)
    alone, shared = (compare(scenario, samples=50, paths=0, seed=2, jobs=jobs).verdicts for jobs in (1, 2))
    for name in ("rows", "reference", "codes", "clearance", "deviation"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(shared, name))


@pytest.mark.parametrize(("name", "value"), [("samples", 0), ("paths", -1), ("seed", -1), ("jobs", 0)])
def test_refuses_numbers_out_of_range(scenario, name, value):
    with pytest.raises(InputError, match=name):
        compare(scenario, **{name: value})


def test_refuses_a_scenario_without_a_learned_model(make_scenario):
    with pytest.raises(FormatError, match="shape_model"):
        compare(make_scenario())
