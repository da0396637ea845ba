from __future__ import annotations

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.files import FileModel, parse_table
from tdcr_planner.strict_numbers import describe_value


@pytest.mark.parametrize(
    "value",
    [pytest.param(10**5000, id="digits"), [10**5000], "x" * 5000, [*range(5000)], {"a": [[["b"] * 50] * 50] * 50}],
)
def test_values_are_shown_in_short(value: object) -> None:
    assert 0 < len(describe_value(value)) < 1000


class Numbers(FileModel):
    real: float = 1.0
    whole: int = 1
    flag: bool = True
    many: tuple[float, ...] = ()
    named: dict[str, int] = {}


@pytest.mark.parametrize(
    "value",
    [True, "1", "", 1e31, -1e31, pytest.param(10**5000, id="digits"), float("inf"), float("nan"), [1.0], {}, None],
)
@pytest.mark.parametrize("key", ["real", "whole", "many", "named"])
def test_a_number_is_a_number(key: str, value: object) -> None:
    given = {"many": [0.0, value], "named": {"a": value}}.get(key, value)
    with pytest.raises(FormatError, match=f"a.toml: {key}") as caught:
        parse_table(Numbers, {key: given}, "a.toml")
    assert len(str(caught.value)) < 300


def test_numbers_that_are_whole_serve_both_kinds() -> None:
    table = parse_table(Numbers, {"real": 2, "whole": 3.0, "many": [1, 2.5], "named": {"a": 4}}, "a.toml")
    assert (table.real, table.whole, table.many, table.named) == (2.0, 3, (1.0, 2.5), {"a": 4})


@pytest.mark.parametrize("value", [1, 0, "true", 1.0])
def test_a_flag_is_true_or_false(value: object) -> None:
    with pytest.raises(FormatError, match="flag"):
        parse_table(Numbers, {"flag": value}, "a.toml")
