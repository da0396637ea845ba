import pytest

from tdcr_planner.errors import InputError
from tdcr_planner.planning.offered import OMPL_TRAITS
from tdcr_planner.planning.planner import Planner, convert_parameter
from tdcr_planner.planning.planners import PLANNERS, FunctionPlanner, find_planner


def test_every_ompl_planner_is_found_by_its_name():
    assert PLANNERS.names() == tuple(OMPL_TRAITS)
    for name in OMPL_TRAITS:
        planner = find_planner(name)
        assert isinstance(planner, Planner)
        assert (planner.name, planner.repairs) == (name, True)


def test_a_function_by_import_is_a_planner_without_parameters_or_repairs():
    planner = find_planner("math:sqrt")
    assert isinstance(planner, FunctionPlanner)
    assert not planner.repairs
    with pytest.raises(InputError, match="range"):
        planner.check_parameters({"range": 0.5})


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("math:", "module:function"),
        ("math:no_such", "a function of module math"),
        ("no_such_module:search", "No module named"),
        ("math:pi", "a function of module math"),
    ],
)
def test_a_function_that_is_none_is_refused(name, message):
    with pytest.raises(InputError, match=message):
        find_planner(name)


@pytest.mark.parametrize(("value", "kind"), [(True, int), (1.5, int), (-1, int), ("a", bool), (float("nan"), float)])
def test_parameters_of_another_type_are_refused(value, kind):
    with pytest.raises(InputError, match="planner.parameters.size"):
        convert_parameter("size", value, kind)
