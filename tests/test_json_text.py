from __future__ import annotations

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.json_text import parse_json


def test_an_object_is_read() -> None:
    content = {"a": [1, 2.5, None, True, "x"], "b": {}}
    assert parse_json('{"a": [1, 2.5, null, true, "x"], "b": {}}', "a.json") == content
    assert parse_json(b'{"a": 1}', "a.json") == {"a": 1}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, "not valid JSON"),
        ('{"a": ' * 100_000, "not valid JSON"),
        ('{"a": ' + "9" * 5000 + "}", "digits"),
        ('{"a": 1e999}', "1e999 is beyond"),
        ('{"a": NaN}', "NaN is no number"),
        ('{"a": -Infinity}', "Infinity is no number"),
        ('{"a": 1, "a": 2}', "'a' stands there twice"),
        ("[1]", "expected a JSON object, got list"),
        ("", "not valid JSON"),
    ],
)
def test_json_that_is_none_is_refused(text: str, words: str) -> None:
    with pytest.raises(FormatError, match=f"a.json: .*{words}"):
        parse_json(text, "a.json")
