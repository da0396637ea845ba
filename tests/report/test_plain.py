from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tdcr_planner.report.plain import plain_json


def test_every_value_becomes_what_json_has() -> None:
    value = {
        1: np.array([[1.0, np.nan], [np.inf, 2.0]]),
        "flag": np.bool_(True),
        "count": np.int64(3),
        "pair": (0.5, float("-inf")),
        "file": Path("a/b"),
    }
    plain = plain_json(value)
    expected = {"1": [[1.0, None], [None, 2.0]], "flag": True, "count": 3, "pair": [0.5, None], "file": "a/b"}
    assert plain == expected
    assert json.loads(json.dumps(plain, allow_nan=False)) == expected
